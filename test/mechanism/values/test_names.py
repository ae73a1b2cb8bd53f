"""Any name of a file stays as it is: in the mechanism, expressions, keys, recordings, tables, C code and other formats."""

import random
import re
import shutil
import subprocess

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import InputError, MechanismError
from mbd_sim.exports.c_code.model import export_model
from mbd_sim.exports.c_code.module import c_module
from mbd_sim.files.checks.override import matching, with_values
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.sdf.writer import to_sdf
from mbd_sim.files.text.yaml_text import yaml_text
from mbd_sim.files.urdf.writer import to_urdf
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.mechanism.values.names import in_expression, is_name, reference, split_assignment, split_key, split_names
from mbd_sim.mechanism.values.source import dotted
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.views.table import columns, read_table
from mbd_sim.studies.symbolic.equations import symbolic_equations
from mbd_sim.studies.symbolic.latex import to_latex
from test.generators.names import COUNT, named_mechanism, plain_names, random_name, random_names


def mechanism_of(names):
    return parse_mechanism(yaml_text(named_mechanism(names)))


@pytest.mark.parametrize("seed", range(10))
def test_names_are_those_of_the_file(seed):
    names = random_names(random.Random(seed), COUNT)
    mechanism = mechanism_of(names)
    assert [mechanism.name, *mechanism.parts, *mechanism.joints] == names[:7]
    assert [sensor.name for sensor in mechanism.sensors] == [names[9], names[10], names[14]]
    for key in matching(mechanism, ["*"]):  # each can be given again
        assert dotted(tuple(split_key(key))) == key
    key = dotted(("joints", names[4], "damping"))
    assert with_values(mechanism, {key: 0.7}).joints[names[4]].damping.tolist() == [0.7]


@pytest.mark.parametrize("seed", range(1))
def test_a_run_and_its_table_have_the_names_and_the_numbers_of_plain_ones(seed, tmp_path):
    names = random_names(random.Random(100 + seed), COUNT)
    tables = []
    for number, some in enumerate((names, plain_names(COUNT))):
        simulation = Simulation(mechanism_of(some))
        simulation.reset(np.linspace(0.1, 0.5, 5), np.linspace(-0.3, 0.4, 5))
        with simulation.recording(tmp_path / f"{number}.mcap", rate=100, reactions=True, poses=["*"]):
            simulation.run(0.05)
        tables.append(read_table(open_recording(tmp_path / f"{number}.mcap")))
    own = tables[0]
    hinge, slide, table = names[4:7]
    assert own.names == (hinge, slide, *(f"{table}.{label}" for label in ("x", "y", "angle")))
    assert set(own.sensors) == {names[9], names[10], names[14]}
    for part in names[1:4]:
        assert f"pose.{part}.x_m" in columns(own)
    assert f"reaction.{hinge}.force_x_N" in columns(own)
    found, expected = (sorted(columns(table).values(), key=repr) for table in tables)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("seed", range(4))
def test_urdf_and_sdf_keep_the_names(seed):
    names = random_names(random.Random(200 + seed), COUNT)
    mechanism = mechanism_of(names)
    robot = parse_mechanism(to_urdf(mechanism))
    assert robot.name == mechanism.name and set(mechanism.parts) < set(robot.parts)
    assert set(robot.coordinate_names) == set(mechanism.coordinate_names)
    world = parse_mechanism(to_sdf(mechanism).text)
    reserved = re.compile("::|^__.*__$")
    assert {name for name in mechanism.parts if not reserved.search(name)} < set(world.parts)
    kept = {name for name in mechanism.coordinate_names if not reserved.search(name)}
    assert kept - set(mechanism.parts) <= set(world.coordinate_names)


@pytest.mark.parametrize("seed", range(4))
def test_mjcf_keeps_the_names(seed):
    pytest.importorskip("mujoco")
    from mbd_sim.files.mjcf.writer import to_mjcf

    names = random_names(random.Random(300 + seed), COUNT)
    mechanism = mechanism_of(names)
    again = parse_mechanism(to_mjcf(mechanism).text)
    assert again.name == mechanism.name and set(mechanism.parts) <= set(again.parts)
    assert set(again.coordinate_names) == set(mechanism.coordinate_names)
    assert [one.name for one in again.actuators][:1] == [names[11]]


@pytest.mark.parametrize("seed", range(1))
def test_c_code_has_an_identifier_for_each_name(seed, tmp_path):
    mechanism = mechanism_of(random_names(random.Random(400 + seed), COUNT))
    model = export_model(mechanism)
    for variables in (model.states, model.inputs, model.output_variables):
        fields = [one.field for one in variables]
        assert len(set(fields)) == len(fields)
        assert all(re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", field) for field in fields)
        assert len({one.name for one in variables}) == len(fields)
    compiler = shutil.which("gcc") or pytest.skip("needs a C compiler")
    for name, text in c_module(model).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    command = [compiler, "-std=c99", "-Wall", "-Werror=comment", "-c", f"{model.name}.c"]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False).stderr == ""


@pytest.mark.parametrize("seed", range(1))
def test_equations_are_written(seed):
    names = random_names(random.Random(500 + seed), COUNT)
    latex = to_latex(symbolic_equations(mechanism_of(names)))
    plain = to_latex(symbolic_equations(mechanism_of(plain_names(COUNT))))
    assert latex.count("{") == latex.count("}")
    assert latex.count(r"\\") == plain.count(r"\\")


def test_names_in_lists_and_assignments_may_stand_in_quotes():
    assert split_names("a b, 'c,d' ,Bob's arm, \"e'f\"") == ["a b", "c,d", "Bob's arm", "e'f"]
    assert split_assignment("shoulder-pitch = 0.3") == ("shoulder-pitch", "0.3")
    assert split_assignment("'a=b'=x=y") == ("a=b", "x=y")
    assert split_assignment("joints.'a=b'.damping=2") == ("joints.'a=b'.damping", "2")
    assert split_assignment("a") == ("a", "")


def test_a_reference_that_can_mean_two_things_is_refused():
    parts = {"a": {"b.c": 0}, "a.b": {"c": 0, "d": 0}}
    assert split_reference("a.b.d", parts) == ("a.b", "d")
    assert split_reference("'a'.b.c", parts) == ("a", "b.c")
    assert split_reference(reference("a.b", "c"), parts) == ("a.b", "c")
    with pytest.raises(InputError, match="can mean two things") as found:
        split_reference("a.b.c", parts)
    assert "'a.b'.c" in found.value.remedy


def test_joints_whose_coordinates_have_one_name_are_refused():
    data = named_mechanism([*plain_names(5), "name6.x", *plain_names(COUNT)[6:]])
    with pytest.raises(MechanismError, match=r"joints\.name6: a coordinate has the same name as one of 'name6\.x'"):
        parse_mechanism(yaml_text(data))


def test_an_expression_without_quotes_says_how_to_write_the_name():
    data = named_mechanism([*plain_names(4), "shoulder-pitch", *plain_names(COUNT)[5:]])
    data["forces"]["name12"]["effort"] = "-2*shoulder-pitch.velocity"
    with pytest.raises(
        MechanismError, match=r"unknown name 'pitch\.velocity'.*Put the name in quotes: 'shoulder-pitch'"
    ):
        parse_mechanism(yaml_text(data))


def test_words_that_expressions_reserve_are_quoted():
    assert in_expression("lambda") == "'lambda'"
    assert in_expression("base.rx") == "base.rx"
    assert in_expression("Bob's \\ arm") == r"'Bob\'s \\ arm'"
    rng, used = random.Random(3), set()
    assert all(is_name(random_name(rng, used)) for _ in range(200))
    assert not any(map(is_name, ["", " a", "a ", "a\nb", "a{i}", "a" * 201]))


def linked(first, second="b", joint="j"):
    """A double pendulum as the data of a file."""
    part = {"mass": 1, "inertia": [1, 1, 1], "center": [0, 0, -1]}
    hinge = {"type": "revolute", "axis": [0, 1, 0], "position": 0.3}
    joints = {"pin": {**hinge, "between": ["ground", first]}, joint: {**hinge, "between": [first, second]}}
    return {"mechanism": "m", "parts": {first: part, second: part}, "joints": joints}


def test_names_of_frames_do_not_begin_with_a_slash():
    """TF refuses such frames: a listener would find no transform of the part."""
    with pytest.raises(MechanismError, match=r"parts\.'/a': begins with '/'. Remove it"):
        parse_mechanism(yaml_text(linked("/a")))
    sensor = {"sensors": {"/imu": {"type": "imu", "at": "a"}}}
    with pytest.raises(MechanismError, match=r"sensors\.'/imu': begins with '/'"):
        parse_mechanism(yaml_text(linked("a") | sensor))
    assert "/pin" in parse_mechanism(yaml_text(linked("a", joint="/pin"))).joints


def test_links_whose_names_begin_with_a_slash_get_others():
    text = to_urdf(parse_mechanism(yaml_text(linked("base", "arm"))))
    read = parse_mechanism(text.replace('"base"', '"/arm"'))
    assert list(read.parts) == ["arm_2", "arm"] and any("/arm → arm_2" in note for note in read.source.notes)
    read = parse_mechanism(
        to_sdf(parse_mechanism(yaml_text(linked("base", "arm"))))
        .text.replace(">base<", ">/base<")
        .replace('"base"', '"/base"')
    )
    assert list(read.parts) == ["base", "arm"]


@pytest.mark.parametrize("write", [to_sdf, to_mjcf, to_urdf])
def test_a_part_named_like_the_world_of_another_format_is_not_ground(write):
    for names in (("world", "b"), ("a", "world")):
        written = write(parse_mechanism(yaml_text(linked(*names))))
        read = parse_mechanism(getattr(written, "text", written))
        first, second = read.parts
        ends = [(joint.parent, joint.child) for joint in read.joints.values()]
        assert ends == [("ground", first), (first, second)]
        assert read.mass == 2


def test_a_piece_of_a_part_has_a_name_of_its_own():
    """The piece of 'b' that the cut joint carries would be called like the part 'b/shut'."""
    states = []
    for last in ("b/shut", "c"):
        data = linked("a")
        hinge = {"type": "revolute", "axis": [0, 1, 0], "damping": 1}
        data["parts"][last] = data["parts"]["b"]
        data["joints"]["end"] = {**hinge, "between": ["b", last]}
        data["joints"]["shut"] = {**hinge, "between": ["ground", "b"], "cut": True}
        mechanism = parse_mechanism(yaml_text(data))
        assert mechanism.joints["shut"].splits and len(mechanism.bodies) == 4
        simulation = Simulation(mechanism)
        simulation.run(0.1)
        states.append(simulation.state)
    np.testing.assert_array_equal(*states)
