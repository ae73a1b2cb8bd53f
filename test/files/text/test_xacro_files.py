"""Xacro files: what they expand to against the program xacro, their arguments and packages, and where errors stand."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from mbd_sim import Kinematics
from mbd_sim.base.errors import InputError, MechanismError
from mbd_sim.base.packages import MissingPackageError
from mbd_sim.cli.main import main
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.text.library import argument_texts, split_arguments
from mbd_sim.files.text.xacro_files import expanded
from mbd_sim.files.text.xml import parse_xml
from mbd_sim.files.text.yaml_text import mechanism_text

pytest.importorskip("xacro")

LINK = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="segment" params="name parent length mass:=2">
    <link name="${name}">
      <inertial><origin xyz="0 0 ${length / 2}"/><mass value="${mass}"/>
        <inertia ixx="${mass * length**2 / 12}" iyy="${mass * length**2 / 12}" izz="0.001"/></inertial>
    </link>
    <joint name="${name}_joint" type="revolute">
      <parent link="${parent}"/><child link="${name}"/><axis xyz="0 1 0"/>
      <limit lower="-2" upper="2" effort="10" velocity="3"/>
    </joint>
  </xacro:macro>
</robot>
"""
ARM = """<?xml version="1.0"?>
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="prefix" default=""/>
  <xacro:arg name="length" default="0.5"/>
  <xacro:arg name="count" default="2"/>
  <xacro:include filename="$(find parts_description)/urdf/link.xacro"/>
  <xacro:property name="sizes" value="${xacro.load_yaml('sizes.yaml')}"/>
  <link name="world"/>
  <xacro:macro name="chain" params="number parent">
    <xacro:if value="${number &lt; int(xacro.arg('count'))}">
      <xacro:segment name="$(arg prefix)link${number}" parent="${parent}" length="$(arg length)" mass="${sizes['mass']}"/>
      <xacro:chain number="${number + 1}" parent="$(arg prefix)link${number}"/>
    </xacro:if>
  </xacro:macro>
  <xacro:chain number="0" parent="world"/>
</robot>
"""


@pytest.fixture
def robot(tmp_path, monkeypatch):
    """A xacro file and the package that it needs, whose folder has another name, beside its own package."""
    for variable in ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"):
        monkeypatch.delenv(variable, raising=False)
    (tmp_path / "own" / "urdf").mkdir(parents=True)
    (tmp_path / "Parts_ROS2" / "urdf").mkdir(parents=True)
    (tmp_path / "Parts_ROS2" / "package.xml").write_text("<package><name>parts_description</name></package>")
    (tmp_path / "Parts_ROS2" / "urdf" / "link.xacro").write_text(LINK)
    (tmp_path / "own" / "urdf" / "sizes.yaml").write_text("mass: 1.5\n")
    path = tmp_path / "own" / "urdf" / "arm.urdf.xacro"
    path.write_text(ARM)
    return path


def test_arguments_follow_the_file_as_the_program_takes_them():
    assert split_arguments("a b.urdf.xacro name:=left  gripper:= size:=1 2 3") == (
        "a b.urdf.xacro", {"name": "left", "gripper": "", "size": "1 2 3"},
    )  # fmt: skip
    assert split_arguments("double_rod") == ("double_rod", {})


@pytest.mark.parametrize("arguments", [{}, {"prefix": "left_", "length": "0.8", "count": "5"}])
def test_the_expansion_is_that_of_the_program(robot, arguments, monkeypatch):
    import xacro
    from xacro import substitution_args

    from mbd_sim.files.text.xacro_files import expanded

    before = xacro.parse, substitution_args._eval_find
    own = parse_xml(expanded(ARM, str(robot), arguments), str(robot))
    assert (xacro.parse, substitution_args._eval_find) == before  # nothing of xacro stays changed
    monkeypatch.setattr(substitution_args, "_eval_find", lambda package: str(robot.parents[2] / "Parts_ROS2"))
    theirs = parse_xml(xacro.process_file(str(robot), mappings=dict(arguments)).toxml(), "")
    assert [(e.tag, e.attributes) for e in own.walk()] == [(e.tag, e.attributes) for e in theirs.walk()]
    places = {(Path(e.file).name, e.line) for e in own.walk() if e.tag == "mass"}
    assert places == {("link.xacro", 4)}  # in the file with the macro


def test_loaded_by_python_the_command_line_and_a_mechanism_file(robot, capsys, tmp_path):
    one = load_mechanism(f"{robot} length:=0.8 count:=3")
    assert (one.name, list(one.parts)) == ("arm", ["link0", "link1", "link2"])
    assert one.parts["link1"].center[2] == 0.4 and one.parts["link0"].mass == 1.5
    assert one.source.xacro == {"length": "0.8", "count": "3"}
    other = load_mechanism(robot, xacro={"length": "0.8", "count": "3"})
    assert np.array_equal(Kinematics(one).poses()["link2"].position, Kinematics(other).poses()["link2"].position)
    assert main(["convert", str(robot), "prefix:=left_", "count:=1"]) == 0
    text = capsys.readouterr().out
    assert "left_link0" in text and "link1" not in text
    file = tmp_path / "setup.yaml"
    file.write_text("urdf: package://own/urdf/arm.urdf.xacro\nxacro: {count: 1, length: 0.25}\nbase: fixed\n")
    (tmp_path / "own" / "package.xml").write_text("<package><name>own</name></package>")
    assert load_mechanism(file).parts["link0"].center[2] == 0.125


def test_remarks_name_an_included_file_without_its_folder(robot):
    """The path of a package in each of some thirty remarks hid what they say."""
    included = robot.parents[2] / "Parts_ROS2" / "urdf" / "link.xacro"
    included.write_text(LINK.replace("<limit lower", '<limit soft="1" lower'))
    places = ", ".join(f"joint[link{number}_joint].limit (link.xacro, line 9)" for number in range(2))
    assert f"soft of <limit>: {places}" in load_mechanism(str(robot)).source.notes


def test_the_text_of_a_recording_needs_no_package(robot):
    text = mechanism_text(load_mechanism(f"{robot} count:=3").source)
    (robot.parents[2] / "Parts_ROS2" / "urdf" / "link.xacro").unlink()
    assert list(parse_mechanism(text).parts) == ["link0", "link1", "link2"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "parts_description",
            "no_description",
            "arm.urdf.xacro:6: xacro:include: there is no package 'no_description'",
        ),
        ("$(arg length)", "$(arg size)", "arm.urdf.xacro:11: xacro:segment: the argument 'size' has no value"),
        ("sizes['mass']", "sizes['weight']", "arm.urdf.xacro:11: xacro:segment: "),
        ("load_yaml('sizes", "load_yaml('size", "arm.urdf.xacro:11: xacro:segment: cannot read "),
        ("/link.xacro", "/lin.xacro", "arm.urdf.xacro:6: xacro:include: cannot read "),
        ('"$(arg length)"', '"${lenght}"', "arm.urdf.xacro:11: xacro:segment: name 'lenght' is not defined"),
        ('"$(arg length)"', '"a"', "link.xacro:4: origin: "),
        (' length="$(arg length)"', "", "arm.urdf.xacro:11: xacro:segment: the macro needs these parameters: length"),
        ("xacro:segment name", "xacro:segmen name", "arm.urdf.xacro:11: xacro:segmen: there is no macro xacro:segmen"),
        ("${number + 1}", "${number +}", "arm.urdf.xacro:12: xacro:chain: is not a valid expression: "),
        ("number &lt; int", "0 &lt; int", "a macro or a file contains itself without end"),
        ("</xacro:if>", "", "arm.urdf.xacro:14: not valid XML: mismatched tag"),
        ('type="revolute"', 'type="turning"', "link.xacro:7: joint[link0_joint].type: unknown type 'turning'"),
    ],
)
def test_errors_name_the_file_the_line_and_a_remedy(robot, old, new, expected):
    for path in (robot, robot.parents[2] / "Parts_ROS2" / "urdf" / "link.xacro"):
        path.write_text(path.read_text().replace(old, new))
    with pytest.raises(MechanismError) as caught:
        load_mechanism(robot)
    problem = caught.value.problems[0]
    assert expected in str(problem) and problem.remedy and problem.line


def test_arguments_that_no_file_has_are_refused(robot, tmp_path):
    with pytest.raises(MechanismError, match=re.escape("xacro: there is no <xacro:arg> of this name (got 'lenght')")):
        load_mechanism(f"{robot} lenght:=2")
    plain = tmp_path / "plain.urdf"
    plain.write_text('<robot name="r"><link name="a"/></robot>')
    with pytest.raises(MechanismError, match="not a xacro file, and takes no arguments"):
        load_mechanism(f"{plain} length:=2")


def test_without_xacro_the_error_says_how_to_install_it(robot, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(MissingPackageError, match="needs xacro, which is not installed"):
        load_mechanism(robot)


def test_what_xacro_has_written_needs_no_xacro(monkeypatch):
    """It declares the namespace, and has expressions of the original in its comments; it was expanded at each start."""
    monkeypatch.setitem(sys.modules, "xacro", None)
    written = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
      <!-- from <xacro:include filename="$(find nothing)/a.xacro"/>
           ${limit} --><link name="a"/></robot>"""
    assert parse_mechanism(written).name == "r"
    with pytest.raises(MissingPackageError):
        parse_mechanism(written.replace("-->", '--><xacro:property name="a" value="1"/>'))


def test_a_hostile_instruction_in_a_plain_file_does_no_harm():
    text = (
        '<?mbd_sim-files {"files": 3}?><?mbd_sim-place x?><robot name="r"><?mbd_sim-place 9 9?><link name="a"/></robot>'
    )
    assert [(one.file, one.line) for one in parse_xml(text, "r.urdf").walk()] == [("r.urdf", 1), ("r.urdf", 1)]


ARGUMENT = (
    '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="a" default="0"/>'
    '<xacro:if value="${float($(arg a)) > 0}"><link name="heavy"/></xacro:if><link name="base"/></robot>'
)
FLAG = ARGUMENT.replace("${float($(arg a)) > 0}", "$(arg a)")


@pytest.mark.parametrize(("text", "value", "heavy"), [
    (ARGUMENT, 0.5, True), (ARGUMENT, 0, False), (ARGUMENT, "0.5", True), (ARGUMENT, np.float64(0.5), True),
    (FLAG, True, True), (FLAG, False, False), (FLAG, "true", True),
])  # fmt: skip
def test_arguments_in_python_are_words_numbers_and_truth_values(text, value, heavy):
    written = expanded(text, "r.urdf.xacro", argument_texts({"a": value}))
    assert ("heavy" in written) is heavy
    with pytest.raises(InputError, match="the argument a cannot be"):
        parse_mechanism(text, "r.urdf.xacro", xacro={"a": [value]})
