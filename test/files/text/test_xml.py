"""XML that TinyXML-2 accepts though it is not well-formed: read as it is meant, with a remark that has the line."""

import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.text.xml import mended, root_tag, slips_of

LINK = '<link name="l"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
JOINT = '<joint name="j" type="continuous"><parent link="base"/><child link="l"/><axis xyz="0 1 0"/></joint>'
URDF = f'<robot name="x">\n<link name="base"/>\n{LINK}\n{JOINT}\n</robot>'
SDF = (
    '<sdf version="1.6"><model name="m">\n<link name="l"><inertial><mass>1</mass></inertial></link>\n'
    '<joint name="j" type="revolute"><parent>world</parent><child>l</child><axis><xyz>0 1 0</xyz></axis></joint>\n</model></sdf>'
)
MJCF = '<mujoco model="x">\n<worldbody>\n<body><joint name="j"/><geom type="sphere" size="1"/></body>\n</worldbody></mujoco>'
RULER = "<!---------- legs:\n run with --all ---------->"


@pytest.mark.parametrize("text", [URDF, SDF, MJCF], ids=["urdf", "sdf", "mjcf"])
def test_slips_are_read_with_a_remark(text):
    """In all three formats, at any place, one or all together."""
    first, rest = text.split("\n", 1)
    for slipped, slip in (
        (f"{first}\n{RULER}\n{rest}", "'--' in a comment (line 2)"),
        (f'\n <?xml version="1.0"?>\n{text}', "a blank before <?xml (line 2)"),
        (f"{text}\n\0", f"a NUL character at the end (line {text.count(chr(10)) + 2})"),
        (
            text.replace('name="j" type', 'name="j"type').replace('type="sphere" size', 'type="sphere"size'),
            "attributes",
        ),
    ):
        mechanism = parse_mechanism(slipped)
        assert "j" in mechanism.joints
        assert any("not well-formed" in note and slip in note for note in mechanism.source.notes)
    assert not any("not well-formed" in note for note in parse_mechanism(text).source.notes)


def test_a_bare_ampersand_is_itself():
    text = URDF.replace('<robot name="x">', '<robot name="x" note="a & b &amp; c">')
    assert any("a bare '&' (line 1)" in note for note in parse_mechanism(text).source.notes)
    assert mended("<a>R&D &lt; &#65; &c;</a>")[0] == "<a>R&amp;D &lt; &#65; &amp;c;</a>"


def test_lines_and_well_formed_text_stay():
    assert mended(URDF) == (URDF, ())
    text = f"<a b='1'>\n<![CDATA[ & -- <x y='1'z='2'> ]]>{RULER}\n<c d=\"x'y=\" e='--'/></a>"
    assert mended(text)[0].count("\n") == text.count("\n")
    assert "<![CDATA[ & -- <x y='1'z='2'> ]]>" in mended(text)[0]
    assert slips_of(text) == ("'--' in a comment (line 2)",)


def test_what_else_is_wrong_is_refused_at_its_line():
    for wrong in (f"{RULER}{URDF.replace('</robot>', '</robo>')}", URDF.replace('xyz="0 1 0"', 'xyz="0 1 0')):
        with pytest.raises(MechanismError, match=r"<text>:\d+: not valid XML"):
            parse_mechanism(wrong)


def test_a_color_of_five_numbers_is_not_drawn_and_noted():
    visual = '<visual><geometry><sphere radius="1"/></geometry><material name="m"><color rgba="0 0 0 0 1"/></material></visual>'
    mechanism = parse_mechanism(URDF.replace('<link name="l">', f'<link name="l">{visual}'))
    assert mechanism.parts["l"].shapes[0].color is None
    assert any(note.startswith("colors without four numbers") and "line 3" in note for note in mechanism.source.notes)


@pytest.mark.parametrize(
    ("text", "tag"),
    [
        ('<robot name="a"/>', "robot"),
        ('\ufeff<?xml version="1.0"?>\n<!-- <sdf> -->\n<mujoco><worldbody/></mujoco>', "mujoco"),
        ("<sdf><not closed", "sdf"),
        ("<!-- never closed", ""),
        ("<", ""),
        ("<robot>\ud800</robot>", ""),
    ],
)
def test_only_the_root_element_is_read(text, tag):
    assert root_tag(text) == tag
