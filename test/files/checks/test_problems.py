"""Mistakes that new users make, and the remedies that name what to write instead."""

import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.checks.json_schema import known_types
from mbd_sim.files.checks.problems import _TYPES
from mbd_sim.files.load import parse_mechanism

FILE = """mechanism: first
parts: {rod: {shape: {type: rod, to: [0, 0, 1], mass: 1}, points: {tip: [0, 0, 1]}}}
joints: {hip: {type: revolute, between: [ground, rod], axis: [0, 1, 0]IN_JOINT}}
SECTION
"""
IN_JOINT = {
    "effort: 5": "joints.hip.effort: unknown key 'effort'. An effort that acts is an entry of forces, '{type: effort,",
    "servo: {kp: 3}": "A motor is an entry of actuators: '{type: effort, joint: …}' or '{type: dc_motor, …}'.",
    "limits: {lower: 0, upper: 1, velocity: 3}": "Write 'velocity_limit' in the joint itself.",
    "angle: 30 deg": "unknown key 'angle'. Write 'position'.",
    "speed: 3": "unknown key 'speed'. Write 'velocity'.",
    "k: 3": "unknown key 'k'. Write 'stiffness'.",
    "c: 3": "unknown key 'c'. Write 'damping'.",
    "parent: ground": "unknown key 'parent'. Write 'between: [parent, child]'",
    "range: [0, 1]": "unknown key 'range'. Write 'limits'.",
    "max_effort: 3": "Did you mean 'effort_limit'?",
    "max_effort: null": "joints.hip.max_effort: unknown key 'max_effort'. Did you mean 'effort_limit'?",
    "position: 0,5": "joints.hip.5: unknown key '5'. A comma separates entries: write decimals with a point, as in 0.5.",
    "at: [1, 0, 0]": "unknown key 'at'. Where a joint is, points say: 'between: [ground.point, part.point]'",
    "limits: [-30 deg, 1]": "(got ['-30 deg', 1]). Write {lower: -30 deg, upper: 1}.",
    "drive: {velocity: 2}": "A given motion is an expression of the time, in m or rad, such as 'drive: 2*t'.",
    "q9: 3": "unknown key 'q9'. Valid: axis, between",
    "position 3 deg": "unknown key 'position 3 deg'. A colon is missing: write 'position: 3 deg'.",
}
SECTIONS = {
    "sensors: {a: {type: imu, joint: hip}}": "unknown key 'joint'. Name where it is: 'at: part' or 'at: part.point'.",
    "sensors: {a: {type: encoder, at: rod, counts: 9}}": "unknown key 'at'. It measures a joint: write 'joint: …'.",
    "sensors: {a: {type: current, joint: hip}}": "Name a DC motor: 'actuator: …'.",
    "sensors: {a: {type: imu, at: rod, noise: 1}}": "Give it for a quantity: 'angular_velocity: {noise_density: …}'.",
    "sensors: {a: {type: tachometer, joint: hip, noise: 1}}": "Write 'noise_density': the standard deviation",
    "sensors: {a: {type: accelerometer, at: rod, gyro: 1}}": "unknown key 'gyro'. Valid: at, bias",
    "sensors: {a: {type: gyro, at: rod}}": "unknown type 'gyro'. Did you mean 'imu'?",
    "sensors: {a: {type: point, at: rod}}": "unknown type 'point'. Valid: accelerometer",
    "actuators: {a: {type: effort, joint: hip, kp: 3}}": "A servo is a key of an actuator: '{type: effort, joint: …, servo",
    "actuators: {a: {type: position, joint: hip}}": "A servo is a key of an actuator",
    "actuators: {a: {type: effort, joint: hip, command: 3}}": "mapping of channels to values (got 3). Write for example",
    "actuators: {a: {type: effort, joint: hip, servo: {mode: position, kp: 1}}}": "Write 'controls: position'",
    "forces: {a: {type: force, at: rod, force: 3}}": "unknown key 'force'. Write 'vector: [x, y, z]'; along a line",
    "forces: {a: {type: force, at: rod, vector: [where(hip > 1, 5, 0), 0, 0]}}": "has 5 values, not 3 (got ['where(hip > 1', 5, "
    "'0)', 0, 0]). Between brackets or braces, put an expression with commas in quotes: \"where(x > 0, a, b)\".",
    "forces: {a: {type: effort, coordinate: hip, effort: where(hip > 1, 5, 0)}}": "(got 'where(hip > 1'). A parenthesis is "
    "not closed. Between brackets or braces, put an expression with commas in quotes",
    'forces: {a: {type: effort, coordinate: hip, effort: "where(hip > 30 deg, 5 N*m, 0)"}}': "have no units: in place of "
    "'30 deg', write the number in SI units, or the name of a parameter that has the unit.",
    "forces: {a: {type: spring, between: [rod, world], stiffness: 3}}": "there is no part 'world'. Did you mean 'ground'?",
    "forces: {a: {type: spring, between: [rod, ground], stiffness: 3, l0: 1}}": "unknown key 'l0'. Write 'length'.",
    "contacts: {a: {parts: [rod.tip], plane: ground, mu: 1}}": "unknown key 'mu'. Write 'friction'.",
    "integrator: {dt: 0.01}": "unknown key 'dt'. Write 'step'.",
    "constraints: {a: {type: gear, between: [hip, hip], radii: [1, 1]}}": "unknown key 'between'. Write 'joints'.",
    "contacts: {a: {a: rod, b: rod}}": "contacts.a.b: unknown key 'b'. Write 'between: [a, b]', with the names of two parts.",
    "contacts: {a: {at: rod.tip, on: ground}}": "unknown key 'on'. Write 'plane: ground', or the point of a plane",
    "contacts: {a: {type: plane, parts: [rod]}}": "A contact has no type: give 'between' two parts, or 'parts' on a 'plane'.",
    "contacts: {a: {parts: [rod], plane: {normal: [0, 0, 1]}}}": "must be text (got {'normal': [0, 0, 1]}). Write the name of a "
    "part, or part.point.",
    "contacts: {a: {parts: [rod.tip], plane: ground, normal: -z}}": "must be a list (got '-z'). Write [0, 0, -1].",
    "contacts: {a: {type: point, point: rod.tip}}": "contacts.a.point: unknown key 'point'. Write 'parts: [part.point]'",
    "floor: true": "A floor is an entry of contacts: 'floor: {parts: all, plane: ground}'.",
    "gravity: 9.81": "must be a list (got 9.81). Write [0, 0, -9.81].",
    "ground: {shapes: []}": "unknown key 'shapes'. Ground has only points: give the shapes to a part",
    "bodies: {}": "unknown key 'bodies'. Write 'parts'.",
    "solver: rk4": "unknown key 'solver'. Write 'integrator'.",
    "name: first": "name: unknown key 'name'. Write 'mechanism: …', the name of the mechanism.",
    "motor: {}": "motor: unknown key 'motor'. Motors and servos are entries of 'actuators'.",
}


@pytest.mark.parametrize(
    ("line", "text", "remedy"),
    [(3, FILE.replace("IN_JOINT", f", {key}").replace("SECTION", ""), remedy) for key, remedy in IN_JOINT.items()]
    + [(4, FILE.replace("IN_JOINT", "").replace("SECTION", key), remedy) for key, remedy in SECTIONS.items()],
    ids=[*IN_JOINT, *SECTIONS],
)
def test_a_likely_mistake_has_a_remedy_that_names_the_right_place(line, text, remedy):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text, "file.yaml")
    assert remedy in str(caught.value)
    assert {problem.line for problem in caught.value.problems} == {line}


@pytest.mark.parametrize("section", _TYPES)
def test_a_type_that_has_a_remedy_is_unknown(section):
    known = known_types((section, "name"))
    assert known and not {word for words in _TYPES[section] for word in words} & set(known)


OTHER_FILES = {
    "sim_node:\n  ros__parameters: {step: 0.001}": "it has none of 'mechanism', 'parts', 'joints', 'urdf'. Its keys are "
    "sim_node. These are parameters of ROS nodes: start a node with --params-file and this file.",
    "version: 3\nservices: {}": "Its keys are version, services. Begin with a line such as 'mechanism: pendulum'.",
    "": "the file is empty, but a mechanism file is a mapping",
}


@pytest.mark.parametrize("text", OTHER_FILES)
def test_a_file_of_something_else_is_told_as_one_problem(text):
    """It was three missing sections and an unknown key each."""
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text, "file.yaml")
    assert len(caught.value.problems) == 1 and OTHER_FILES[text] in str(caught.value)


def test_a_section_with_another_name_is_one_problem():
    text = "mechanism: a\nlinks: {a: {mass: 1}}\njoints: {j: {type: free, between: [ground, a]}}\n"
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text, "file.yaml")
    assert [(problem.message, problem.remedy) for problem in caught.value.problems] == [
        ("unknown key 'links'", "Write 'parts'."),
    ]


def test_the_entries_of_a_section_have_names():
    with pytest.raises(MechanismError, match=r"Write each entry with its name: 'rod: {mass: 1}'"):
        parse_mechanism("mechanism: a\nparts: [{name: a}]\njoints: {}\n", "file.yaml")


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        (
            "{type: disc, radius: 1, thickness: 1}",
            "It has none: what is thick is a 'cylinder', with 'radius' and 'length'.",
        ),
        ("{type: cylinder, radius: 1, thickness: 1}", "unknown key 'thickness'. Write 'length'."),
        ("{type: gearwheel, teeth: 20}", "unknown key 'teeth'. What to write depends on the type."),
    ],
)
def test_a_word_in_a_shape_is_explained_by_what_this_shape_has(shape, told):
    """Of an unknown type it was explained as a key of one that fits as badly as others: 'teeth' as 'radii'."""
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(
            FILE.replace("{type: rod, to: [0, 0, 1], mass: 1}", shape).replace("IN_JOINT", "").replace("SECTION", "")
        )
    assert told in str(caught.value)


@pytest.mark.parametrize("change", ["at: ['2*r', 0]", "frame: {normal: z}", "point: [tip]"])
def test_what_is_no_reference_is_not_reported_as_a_wrong_one(change):
    """Entries that the schema refuses are searched for references too: 'there is no part 2*r' beside the problem."""
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(FILE.replace("IN_JOINT", f", {change}").replace("SECTION", ""), "file.yaml")
    assert "there is no part" not in str(caught.value)
