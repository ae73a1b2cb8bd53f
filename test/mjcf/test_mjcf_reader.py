"""How an MJCF is read: names, points, classes, files, problems with their lines, and the list of what was left out."""

import re

import pytest

from mbd_sim.errors import MechanismError
from mbd_sim.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism_file.yaml_writer import mechanism_text
from test.mjcf.models import EQUALITIES, FORCES, LINKS

BODY = '<body name="b"><joint name="j"/><geom name="g" size="0.1"/></body>'


def model(world="", rest=""):
    return f"<mujoco>\n<worldbody>\n{BODY}\n{world}\n</worldbody>\n{rest}\n</mujoco>"


def notes_of(text):
    return "\n".join(parse_mechanism(text).source.notes)


def test_the_mechanism_can_be_written_out_and_read_again():
    for text in (FORCES, LINKS.replace("EQUALITY", EQUALITIES["connect"] + EQUALITIES["joint_polynomial"])):
        source = parse_mechanism(text).source
        assert source.format == "MJCF"
        assert parse_mechanism(mechanism_text(source)).source.data == source.data


def test_sites_are_points_and_bodies_without_a_name_get_one():
    mechanism = parse_mechanism(model('<body><site name="tip" pos="0 0 1"/></body><site name="here"/>'))
    assert mechanism.parts["body_2"].points["tip"].position.tolist() == [0.0, 0.0, 1.0]
    assert "here" in mechanism.ground_points
    assert mechanism.joints["body_2_fixed"].type == "fixed"


def test_long_chains_are_read():
    body = '<body pos="0 0 1"><joint/><geom size="0.1"/>'
    assert len(parse_mechanism(model(body * 120 + "</body>" * 120)).parts) == 121


def test_limits_are_passed_on_in_rad():
    text = model('<body><joint name="k" range="-90 45"/><geom size="1"/></body>')
    (limits,) = parse_mechanism(text).joints["k"].limits
    assert (limits.lower, limits.upper) == pytest.approx((-1.5707963267948966, 0.7853981633974483), rel=1e-15)
    assert parse_mechanism(text.replace("<worldbody>", '<option><flag limit="disable"/></option><worldbody>')).joints[
        "k"
    ].limits in ((), (None,))


def test_what_is_left_out_is_listed_with_its_line():
    notes = notes_of(
        model(
            '<light name="sun"/>\n<body name="c" gravcomp="1"><joint springdamper="1 1"/><geom size="1" condim="3">\n<plugin/></geom></body>',
            '<sensor><jointpos joint="j"/></sensor>\n<keyframe/>\n<actuator><muscle joint="j"/></actuator>',
        )
    )
    for expected in (
        "<light>: light[sun] (line 4)",
        "gravcomp of body: body[c] (line 5)",
        "springdamper of joint: joint (line 5)",
        "condim of geom: geom (line 5)",
        "<plugin> of <geom>: geom (line 6)",
        "<sensor>: sensor (line 8)",
        "<keyframe>: keyframe (line 9)",
        "muscle actuators of a form that is not expressed here: muscle (line 10)",
    ):
        assert expected in notes.splitlines()


def test_every_attribute_is_read_or_listed():
    """An attribute that does not exist is on the list wherever it stands, so that none is skipped."""
    text = re.sub(r"<(\w+)(?=[ />])", r'<\1 unheard_of="1"', FORCES.replace("><", ">\n<"))
    listed = sum(note.count("(line ") for note in parse_mechanism(text).source.notes if "unheard_of" in note)
    assert listed == text.count("unheard_of")


def test_files_are_included(tmp_path):
    (tmp_path / "inner.xml").write_text(f"<mujocoinclude>{BODY}</mujocoinclude>")
    main = tmp_path / "main.xml"
    main.write_text('<mujoco><worldbody><include file="inner.xml"/></worldbody></mujoco>')
    assert [*load_mechanism(main).joints] == ["j"]
    (tmp_path / "inner.xml").write_text('<mujocoinclude>\n<body><joint damping="x"/></body></mujocoinclude>')
    with pytest.raises(MechanismError, match=r"inner\.xml:2: joint\.damping: 'x' is not a finite number"):
        load_mechanism(main)
    (tmp_path / "inner.xml").write_text('<mujocoinclude><include file="inner.xml"/></mujocoinclude>')
    with pytest.raises(MechanismError, match="includes itself"):
        load_mechanism(main)


MISTAKES = {
    model('<geom class="no" size="1"/>'): r":4: geom\.class: there is no default class 'no'",
    model('<body euler="0 0"/>'): r":4: body\.euler: has 2 numbers.* Write 3",
    model('<body quat="0 0 0 0"/>'): r":4: body\.quat: must not be zero",
    model('<body quat="1 0 0 0" euler="0 0 0"/>'): r":4: body\.euler: is given besides quat",
    model('<body name="b"/>'): r":4: body\[b\]: is given twice, first on line 3",
    model('<body><joint type="screw"/></body>'): r":4: joint\.type: unknown word \(got 'screw'\)",
    model('<body><joint range="2 1"/><geom size="1"/></body>'): r":4: joint\.range: has no lower limit below",
    model('<body><joint axis="0 0 0"/></body>'): r":4: joint\.axis: must not be zero",
    model("<body><body><freejoint/></body></body>"): r":4: freejoint: a free joint must be the only one",
    model('<body><joint/><geom type="mesh" mesh="m"/></body>'): r":4: geom: a mesh has a mass that depends on another",
    model('<body><geom type="box" size="1 1"/></body>'): r":4: geom\.size: a box needs 3 sizes",
    model("<body><inertial pos='0 0 0'/></body>"): r":4: body\.inertial: 'mass' is missing",
    model(
        "<replicate count='3'/>"
    ): r":4: worldbody: <replicate> is not read\. Write out what it makes: mujoco\.mj_save",
    model(rest='<equality><connect body1="q" anchor="0 0 0"/></equality>'): r":6: connect\.body1: there is no body 'q'",
    model(rest='<actuator><motor joint="jj"/></actuator>'): r":6: motor\.joint: there is no joint 'jj'.*'j'",
    model(rest='<tendon><fixed><joint joint="q"/></fixed></tendon>'): r":6: fixed\.joint\.joint: there is no joint 'q'",
    model(rest='<compiler coordinate="global"/>'): r"only local coordinates are read",
    "<mujoco/>": r"has no <body>",
    "<mujocoinclude/>": r"this is not an MJCF",
}


@pytest.mark.parametrize("text", MISTAKES, ids=range(len(MISTAKES)))
def test_mistakes_are_reported_with_line_and_remedy(text):
    with pytest.raises(MechanismError, match=MISTAKES[text]):
        parse_mechanism(text)
