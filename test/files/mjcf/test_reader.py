"""How an MJCF is read: names, points, classes, files, problems with their lines, and the list of what was left out."""

import sys

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.base.packages import MissingPackageError
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.mjcf.reader import mjcf_source
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.text.yaml_text import mechanism_text
from test.files.mjcf.models import EQUALITIES, FORCES, LINKS

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
            '<light name="sun"/>\n<body name="c" mocap="true"><geom size="1" name="h"/></body>',
            '<sensor><jointpos name="s" joint="j"/></sensor>\n<keyframe><key name="k"/></keyframe>\n'
            '<actuator><muscle name="m" joint="j" lengthrange="0 1"/></actuator>\n<option timestep="0.01" wind="1 0 0"/>',
        )
    )
    for expected in (
        "lights: light[sun] (line 4)",
        "mocap bodies, which stay where they are: body[c] (line 5)",
        "contacts of bodies with each other, 1 pair of geoms, which act where a mechanism file names them: b – c",
        "positions of joints as sensors, which are not read: joint states have them: sensor[s] (line 7)",
        "keyframes: the start is the pose of the file, or the keyframe 'start': key[k]",
        "actuators with an activation (muscle), which exert no force: actuator[m] (line 9)",
        "time step, in place of which integrator.step has its default: 0.01 s",
        "forces of the medium: wind [1. 0. 0.]",
    ):
        assert expected in notes


def test_files_are_included(tmp_path):
    (tmp_path / "inner.xml").write_text(f"<mujocoinclude>{BODY}</mujocoinclude>")
    main = tmp_path / "main.xml"
    main.write_text('<mujoco>\n<worldbody>\n<include file="inner.xml"/></worldbody></mujoco>')
    mechanism = load_mechanism(main)
    assert [*mechanism.joints] == ["j"]
    assert [*mechanism.source.other_files] == [str(tmp_path / "inner.xml")]
    (tmp_path / "inner.xml").write_text('<mujocoinclude>\n<body><joint damping="x"/></body></mujocoinclude>')
    with pytest.raises(MechanismError, match=r"bad format in attribute 'damping'"):
        load_mechanism(main)
    (tmp_path / "inner.xml").unlink()
    with pytest.raises(MechanismError, match=r"main\.xml:3: include: .*Error opening file 'inner\.xml'"):
        load_mechanism(main)


def test_a_mesh_has_its_mass_and_is_drawn_as_in_its_file(tmp_path):
    """MuJoCo moves a mesh to its center and principal axes; the file is drawn where it was."""
    (tmp_path / "wedge.obj").write_text(
        "v 0 0 0\nv 0.2 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    asset = '<asset><mesh name="wedge" file="wedge.obj" scale="2 2 2"/></asset>'
    body = '<body name="b"><joint/><geom type="mesh" mesh="wedge" pos="0 0 1"/></body>'
    main = tmp_path / "main.xml"
    main.write_text(f"<mujoco>{asset}<worldbody>{body}</worldbody></mujoco>")
    part = load_mechanism(main).parts["b"]
    assert part.mass == pytest.approx(
        1000.0 * 0.4 * 0.2 * 0.2 / 6.0, rel=1e-6
    )  # MuJoCo stores vertices in single precision
    assert part.center == pytest.approx([0.1, 0.05, 1.05], rel=1e-6)
    (mesh,) = part.meshes
    assert mesh.pose.position == pytest.approx([0.0, 0.0, 1.0], abs=1e-7)
    assert mesh.pose.rotation == pytest.approx(np.eye(3), abs=1e-6)


def test_without_mujoco_the_line_that_installs_it_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.setattr("mbd_sim.base.packages._is_installed", lambda module: module != "mujoco")
    with pytest.raises(MissingPackageError, match=r"pip install mujoco-core; .*mbd_sim convert"):
        mjcf_source(model(), "<text>")


def test_ranges_that_do_not_go_up_are_none():
    joint = parse_mechanism(model('<body><joint name="k" range="0 0"/><geom size="1"/></body>')).joints["k"]
    assert not any(joint.limits)


MISTAKES = {
    model('<geom class="no" size="1"/>'): r":4: geom: .*unknown default class",
    model('<body euler="0 0"/>'): r":4: body: .*'euler'.* does not have enough data",
    model('<body name="b"/>'): r":4: body: .*repeated name 'b'",
    model('<body><joint type="screw"/></body>'): r":4: joint: .*invalid keyword: 'screw'",
    model('<body><joint axis="0 0 0"/><geom size="1"/></body>'): r":4: MuJoCo refuses it: axis too small in joint",
    model('<body><joint unheard_of="1"/></body>'): r":4: joint: .*unrecognized attribute: 'unheard_of'",
    model('<body name="c"><joint/></body>'): r":4: c: .*mass and inertia of moving bodies",
    model(rest='<equality><connect body1="q" anchor="0 0 0"/></equality>'): r":6: .*unknown body1 'q'|:6: .*'q'",
    model(rest='<actuator><motor joint="jj"/></actuator>'): r":6: .*'jj'",
    model("<body>"): r":\d+: .*not valid XML",
    "<mujoco/>": r"has no <body>",
    "<mujocoinclude/>": r"mujocoinclude",
}


@pytest.mark.parametrize("text", MISTAKES, ids=range(len(MISTAKES)))
def test_mistakes_are_reported_with_line_and_remedy(text):
    with pytest.raises(MechanismError, match=MISTAKES[text]):
        parse_mechanism(text)


MOVING = """
mechanism: moving
parts:
  a: {shape: {type: block, mass: 1, size: [0.1, 0.2, 0.3]}}
  b: {shape: {type: block, mass: 1, size: [0.1, 0.2, 0.3]}}
  c: {shape: {type: block, mass: 1, size: [0.1, 0.2, 0.3], at: [0.2, 0, 0]}}
joints:
  fly: {type: free, between: [ground, a], position: [1, 2, 3], orientation: {axis: [1, 2, 3], angle: 0.5},
    velocity: [0.1, 0.2, 0.3], angular_velocity: [0.4, 0.5, 0.6]}
  ball: {type: spherical, between: [a, b], orientation: {axis: [0, 1, 1], angle: 0.7}, angular_velocity: [1, 2, 3]}
  hinge: {type: revolute, between: [b, c], axis: [0, 1, 0], position: 0.3, velocity: -0.4}
"""


def test_starts_of_an_exported_mechanism_return():
    mechanism = parse_mechanism(MOVING)
    again = parse_mechanism(to_mjcf(mechanism).text)
    one, other = Simulation(mechanism), Simulation(again)
    np.testing.assert_allclose(other.q, one.q, atol=1e-14)
    np.testing.assert_allclose(other.u, one.u, atol=1e-14)


def test_other_keyframes_are_noted():
    notes = parse_mechanism(to_mjcf(parse_mechanism(MOVING)).text.replace('name="start"', 'name="home"')).source.notes
    assert any("keyframes" in note and "key[home]" in note for note in notes)
