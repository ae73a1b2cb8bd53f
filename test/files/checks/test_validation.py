"""Every mistake in a file: its line, key and value, a helpful remedy, and all of them at once."""

import pytest

from mbd_sim.base.errors import MAX_SHOWN, MechanismError, Problem
from mbd_sim.files.load import parse_mechanism
from test.generators.mechanism_texts import PENDULUM, changed, problem_of, problems_of

MASS, SHAPE, POINTS = "    mass: m\n", "{type: rod, to: [0, 0, -l]}", "{tip: [0, 0, -l]}"
AXIS, END = "    axis: [0, -1, 0]\n", "    position: 90 deg\n"
SHAPES = "block, capsule, cone, cylinder, disc, ellipsoid, hull, outline, particle, plate, ring, rod, sphere"

# What is replaced by what, then the line, key, message and remedy of the only problem that this makes.
MISTAKES = {
    "a missing name": (("mechanism: pendulum\n", ""), 1, "", "'mechanism' is missing", "Add it."),
    "a number as a name": (("pendulum", "5"), 1, "mechanism", "must be text", "Put it in quotes."),
    "a name with a blank before it": (("pendulum", "' pendulum'"), 1, "mechanism", "not a valid name", "Use at most 200 char"),
    "a parameter of two words": (("  m: 2 kg\n", "  m: 2 kg\n  m 2: 1\n"), 4, "parameters.'m 2'", "not a valid name", "for example m_2"),
    "an unknown key": ((MASS, f"{MASS}    mas: 2\n"), 8, "parts.rod.mas", "unknown key 'mas'", "Did you mean 'mass'?"),
    "an unknown key of the file": (("joints:", "partz: 1\njoints:"), 10, "partz", "unknown key 'partz'", "'parts'?"),
    "an empty value": ((MASS, "    mass:\n"), 6, "parts.rod", "has shapes without mass", "Give 'mass' on the part"),
    "a word for a number": ((MASS, "    mass: heavy\n"), 7, "parts.rod.mass", "unknown name 'heavy'", "Valid: e, l, m, pi."),
    "a list for a number": ((MASS, "    mass: [1]\n"), 7, "parts.rod.mass", "must be a number", "0.5, 30 deg, or l/2"),
    "a truth for a number": ((MASS, "    mass: true\n"), 7, "parts.rod.mass", "must be a number", "0.5, 30 deg, or l/2"),
    "not a number": ((MASS, "    mass: .nan\n"), 7, "parts.rod.mass", "must be finite", "Write a number"),
    "infinity": ((MASS, "    mass: .inf\n"), 7, "parts.rod.mass", "must be finite", "Write a number"),
    "a negative mass": ((MASS, "    mass: -m\n"), 7, "parts.rod.mass", "must be at least 0, but is -2", "Write 0 or a"),
    "a unit of another kind": ((MASS, "    mass: 3 ft\n"), 7, "parts.rod.mass", "the unit 'ft' does not fit", "0.5 kg"),
    "an unknown unit": ((MASS, "    mass: 3 stone\n"), 7, "parts.rod.mass", "unknown unit 'stone'", "Known: m, mm"),
    "code": ((MASS, "    mass: __import__('os')\n"), 7, "parts.rod.mass", "unknown function '__import__'", "Valid: abs"),
    "no mass": ((MASS + f"    shape: {SHAPE}\n", ""), 6, "parts.rod", "'mass' is missing", "Add 'mass', or a shape"),
    "a word for a list": (("[0, 0, -l]}\n    points", "tip}\n    points"), 8, "parts.rod.shape.to", "must be a list", "[x, y, z]"),
    "a short list": (("[0, 0, -l]}\n    points", "[0, 0]}\n    points"), 8, "parts.rod.shape.to", "has 2 values, not 3", "[x, y, z]"),
    "a long list": ((AXIS, "    axis: [0, 1, 0, 0]\n"), 14, "joints.pin.axis", "has 4 values, not 3", "[x, y, z]"),
    "a long point": ((POINTS, "{tip: [0, 0, 0, -l]}"), 9, "parts.rod.points.tip", "has 4 values, not 3", "[x, y, z]"),
    "a point that is no list": ((POINTS, "{tip: 5}"), 9, "parts.rod.points.tip", "must be a list or a mapping", "[x, y, z]"),
    "a point with an index": ((POINTS, "{'tip{i}': [0, 0, 0]}"), 9, "parts.rod.points.'tip{i}'", "not a valid name", "needs for"),
    "an unknown shape": ((SHAPE, "{type: blob}"), 8, "parts.rod.shape.type", "unknown type 'blob'", SHAPES[:5]),
    "a shape by another name": ((SHAPE, "{type: disk, radius: 1}"), 8, "parts.rod.shape.type", "unknown type 'disk'", "'disc'?"),
    "a mesh for a hull": ((SHAPE, "{type: mesh, file: some.stl}"), 8, "parts.rod.shape.type", "unknown type 'mesh'", "'hull'?"),
    "too many corners": ((SHAPE, f"{{type: hull, points: {[[0, 0, 0]] * 1001}}}"), 8, "parts.rod.shape.points", "has 1001 values, more than 1000", "Leave out some."),
    "a shape without type": ((SHAPE, "{to: [0, 0, 1]}"), 8, "parts.rod.shape", "'type' is missing", f"Valid: {SHAPES}."),
    "a shape that is a word": ((SHAPE, "rod"), 8, "parts.rod.shape", "must be a mapping", "Its keys: mass, hole, color"),
    "a shape without size": ((SHAPE, "{type: rod}"), 8, "parts.rod.shape", "'to' is missing", "Add it."),
    "a rod without length": ((SHAPE, "{type: rod, to: [0, 0, 0]}"), 8, "parts.rod.shape", "a rod needs two different", "'from'"),
    "a radius of zero": ((SHAPE, "{type: disc, radius: 0}"), 8, "parts.rod.shape.radius", "must be greater than 0", "positive"),
    "a color by its name": ((SHAPE, "{type: disc, radius: 1, color: red}"), 8, "parts.rod.shape.color", "not a color", "'#1f77b4'"),
    "no truth": ((SHAPE, "{type: disc, radius: 1, hole: maybe}"), 8, "parts.rod.shape.hole", "must be true or false", "Write true"),
    "mass and density": ((SHAPE, "{type: sphere, radius: 1, mass: 1, density: 1}"), 8, "parts.rod.shape", "has both mass and", "one of them"),
    "shape and shapes": ((MASS, f"{MASS}    shapes: []\n"), 6, "parts.rod", "has both shape and shapes", "Move 'shape'"),
    "mass given twice": ((SHAPE, "{type: sphere, radius: 1, mass: 1}"), 6, "parts.rod", "gives the mass twice", "Remove one"),
    "a computed center": ((MASS, f"{MASS}    center: [0, 0, 0]\n"), 8, "parts.rod.center", "is computed from the shapes", "Remove 'center'"),
    "a short inertia": ((SHAPE, "\n    inertia: [1, 2]"), 9, "parts.rod.inertia", "has 2 values, not 3", "[I_xx, I_yy, I_zz]"),
    "half an inertia": ((SHAPE, "\n    inertia: {xx: 1, yy: 1}"), 9, "parts.rod.inertia", "'zz' is missing", "Add it."),
    "an impossible inertia": ((SHAPE, "\n    inertia: [1, 1, 2.1]"), 9, "parts.rod.inertia", "the inertia violates the triangle inequality", "No rigid body"),
    "a negative inertia": ((SHAPE, "\n    inertia: [-1, 1, 1]"), 9, "parts.rod.inertia", "the inertia has a negative principal moment", "No rigid body"),
    "impossible products": ((SHAPE, "\n    inertia: {xx: 1, yy: 1, zz: 1, xy: 2}"), 9, "parts.rod.inertia", "the inertia has a negative", "No rigid body"),
    "a rotation in two forms": ((POINTS, "{tip: {rotate: {rpy: [0, 0, 1], quaternion: [1, 0, 0, 0]}}}"), 9, "parts.rod.points.tip.rotate", "needs exactly one of axis, rpy, quaternion", "Given: rpy, quaternion."),
    "a rotation without angle": ((POINTS, "{tip: {rotate: {axis: [0, 0, 1]}}}"), 9, "parts.rod.points.tip.rotate", "axis and angle belong together", "Give both."),
    "a rotation about nothing": ((POINTS, "{tip: {rotate: {axis: [0, 0, 0], angle: 1}}}"), 9, "parts.rod.points.tip.rotate.axis", "must not be zero", "[0, 0, 1]"),
    "a quaternion of zeros": ((POINTS, "{tip: {rotate: {quaternion: [0, 0, 0, 0]}}}"), 9, "parts.rod.points.tip.rotate.quaternion", "must not be zero", "[0, 0, 0, 1]"),
    "a joint by another name": (("revolute", "hinge"), 12, "joints.pin.type", "unknown type 'hinge'", "Did you mean 'revolute'?"),
    "a joint without type": (("    type: revolute\n", ""), 11, "joints.pin", "'type' is missing", "revolute"),
    "a joint with an empty type": (("type: revolute", "type:"), 12, "joints.pin.type", "has no value", "revolute"),
    "a joint without axis": ((AXIS, ""), 11, "joints.pin", "'axis' is missing", "Add it."),
    "an axis of zeros": ((AXIS, "    axis: [0, 0, 0]\n"), 14, "joints.pin.axis", "must not be zero", "[0, 0, 1]"),
    "an axis by its letter": ((AXIS, "    axis: y\n"), 14, "joints.pin.axis", "must be a list", "Write [0, 1, 0]."),
    "an axis on a weld": ((f"revolute\n    between: [ground, rod]\n{AXIS}{END}", f"fixed\n    between: [ground, rod]\n{AXIS}"), 14, "joints.pin.axis", "unknown key 'axis'", "Valid: between, compliance, cut, guess, type."),
    "an angle for a length": (("type: revolute", "type: prismatic"), 15, "joints.pin.position", "the unit 'deg' does not fit", "0.5 m"),
    "one end": (("[ground, rod]", "[rod]"), 13, "joints.pin.between", "has 1 value, not 2", "[ground, part]"),
    "three ends": (("[ground, rod]", "[rod, rod, rod]"), 13, "joints.pin.between", "has 3 values, not 2", "[ground, part]"),
    "an end that is a number": (("[ground, rod]", "[1, rod]"), 13, "joints.pin.between[0]", "must be text", "part.point"),
    "an empty end": (("[ground, rod]", "[~, rod]"), 13, "joints.pin.between[0]", "has no value", "part.point"),
    "an unknown part": (("[ground, rod]", "[ground, rood]"), 13, "joints.pin.between[1]", "there is no part 'rood'", "Did you mean 'rod'?"),
    "a point for a part": (("[ground, rod]", "[ground, tip]"), 13, "joints.pin.between[1]", "there is no part 'tip'", "its point 'rod.tip'?"),
    "an unknown point": (("[ground, rod]", "[ground, rod.top]"), 13, "joints.pin.between[1]", "'rod' has no point 'top'", "Did you mean 'tip'?"),
    "a part without points": (("[ground, rod]", "[ground.a, rod]"), 13, "joints.pin.between[0]", "'ground' has no point 'a'", "add one under its 'points'"),
    "a point without name": (("[ground, rod]", "[ground, rod.]"), 13, "joints.pin.between[1]", "no point is named after", "Valid: tip."),
    "a part without name": (("[ground, rod]", "[ground, .tip]"), 13, "joints.pin.between[1]", "no part is named before", "part.point"),
    "a point of a point": (("[ground, rod]", "[ground, rod.tip.x]"), 13, "joints.pin.between[1]", "'rod' has no point 'tip.x'", "'tip'?"),
    "a part joined to itself": (("[ground, rod]", "[rod.tip, rod]"), 13, "joints.pin.between", "connects 'rod' with itself", "two different"),
    "limits in the wrong order": ((END, "    limits: {lower: 2, upper: 1}\n"), 15, "joints.pin.limits", "lower 2 is not below upper 1", "Swap them."),
    "limits as a list": ((END, "    limits: [1, 2]\n"), 15, "joints.pin.limits", "must be a mapping", "Its keys: lower, upper, stiffness, damping, restitution."),
    "one limit": ((END, "    limits: {lower: 2}\n"), 15, "joints.pin.limits", "'upper' is missing", "Add it."),
    "a negative damping": ((END, "    damping: -1\n"), 15, "joints.pin.damping", "must be at least 0", "Write 0 or"),
    "an effort limit of zero": ((END, "    effort_limit: 0\n"), 15, "joints.pin.effort_limit", "must be greater than 0", "positive"),
    "gravity as a number": ((END, f"{END}gravity: 9.81\n"), 16, "gravity", "must be a list", "Write [0, 0, -9.81]."),
    "a step of zero": ((END, f"{END}integrator: {{step: 0}}\n"), 16, "integrator.step", "must be greater than 0", "positive"),
    "an integrator that is a word": ((END, f"{END}integrator: rk4\n"), 16, "integrator", "must be a mapping", "method, step"),
    "a mass of ground": ((END, f"{END}ground: {{mass: 1}}\n"), 16, "ground.mass", "unknown key 'mass'", "Valid: points."),
    "a part named ground": (("joints:", "  ground: {mass: 1}\njoints:"), 10, "parts.ground", "'ground' always exists", "another name"),
    "a part that is a number": (("joints:", "  bob: 5\njoints:"), 10, "parts.bob", "must be a mapping", "Its keys: mass, center"),
    "an empty part": (("joints:", "  bob:\njoints:"), 10, "parts.bob", "has no value", "Its keys: mass, center"),
    "a part that nothing joins": (("joints:", "  bob: {mass: 1}\njoints:"), 10, "parts.bob", "is not connected by any joint", "joint of type free"),
    "a parameter that is a function": (("  m: 2 kg\n", "  m: 2 kg\n  sin: 1\n"), 4, "parameters.sin", "'sin' is reserved", "another name"),
    "a parameter that is a keyword": (("  m: 2 kg\n", "  m: 2 kg\n  lambda: 1\n"), 4, "parameters.lambda", "'lambda' is reserved", "another name"),
    "a parameter without value": (("  m: 2 kg\n", "  m:\n"), 3, "parameters.m", "has no value", "Give it a value."),
    "a parameter of an unknown one": (("  m: 2 kg\n", "  m: 2*ll\n"), 3, "parameters.m", "unknown name 'll'", "Did you mean 'l'?"),
    "a parameter divided by zero": (("  m: 2 kg\n", "  m: l/0\n"), 3, "parameters.m", "division by zero", "Check the divisor."),
    "a parameter of itself": (("  m: 2 kg\n", "  m: m + 1\n"), 3, "parameters.m", "parameters refer to each other in a circle: m", "by a number"),
    "a hole as large as its block": ((SHAPE, "{type: sphere, radius: 1, hole: true}"), 6, "parts.rod", "has holes as large as its material", "smaller"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_with_its_line_key_and_remedy(name):
    replacement, line, key, message, remedy = MISTAKES[name]
    problem = problem_of(changed(replacement))
    assert (problem.line, problem.key) == (line, key)
    assert problem.message.startswith(message) and remedy in problem.remedy


def test_the_value_is_shown_as_it_is_written():
    assert problem_of(changed((MASS, "    mass: '-m*2'\n"))).value == "'-m*2'"
    assert problem_of(changed((MASS, f"    mass: {'x' * 400}\n"))).value == "'" + "x" * 58 + "…"


PART = "  plate: {{{mass} shapes: [{shapes}]}}\njoints:\n  flight: {{type: free, between: [ground, plate]}}\n"


@pytest.mark.parametrize(
    ("mass", "shapes", "key", "message", "remedy"),
    [
        ("", "{type: block, size: [1, 1, 1], density: 1}, {type: block, size: [2, 1, 1], density: 1, hole: true}",
         "parts.plate", "the holes remove all the mass: -1 kg is left", "smaller or lighter"),
        ("", "{type: block, size: [1, 1, 1], mass: 1}, {type: sphere, radius: 1, mass: 0.9, at: [9, 0, 0], hole: true}",
         "parts.plate", "the inertia has a negative principal moment", "Place the holes inside the material."),
        ("mass: 1,", "{type: block, size: [1, 1, 1]}, {type: disc, radius: 1}",
         "parts.plate", "cannot share its mass among points, lines, surfaces and solids", "Give each shape its own."),
        ("mass: 1,", "{type: block, size: [1, 1, 1]}, {type: particle, mass: 2}",
         "parts.plate", "leaves -1 kg for its shapes without mass", "'mass' is the mass of the whole part."),
        ("mass: 1, inertia: [1, 1, 1],", "{type: disc, radius: 1}, {type: particle, mass: 2}",
         "parts.plate.shapes[1]", "gives a mass although the part gives its inertia", "Remove the shape's mass"),
        ("mass: 0, inertia: [1, 1, 1],", "",
         "parts.plate", "has an inertia without mass", "Give the part a mass."),
    ],
)  # fmt: skip
def test_masses_that_do_not_add_up(mass, shapes, key, message, remedy):
    problem = problem_of(changed(("joints:\n", PART.format(mass=mass, shapes=shapes))))
    assert (problem.line, problem.key) == (10, key)
    assert problem.message.startswith(message) and remedy in problem.remedy


def test_parts_that_joints_join_only_to_each_other_are_unconnected():
    text = changed(("joints:\n", "  a: {mass: 1}\n  b: {mass: 1}\njoints:\n  ab: {type: fixed, between: [a, b]}\n"))
    problems = problems_of(text)
    assert [(problem.line, problem.key) for problem in problems] == [(10, "parts.a"), (11, "parts.b")]
    assert problems[0].message == "is connected only by ab, which does not lead to ground"


def test_parameters_in_a_circle_are_named_and_those_that_use_them_are_not():
    text = changed(("  m: 2 kg\n", "  m: a\n  a: b\n  b: c + l\n  c: a\n  d: c\n"))
    problems = problems_of(text)
    assert [(problem.line, problem.key) for problem in problems] == [
        (4, "parameters.a"),
        (5, "parameters.b"),
        (6, "parameters.c"),
    ]
    assert all(problem.message.endswith("in a circle: a, b, c") for problem in problems)


EVERYWHERE = """\
mechanism: "2 rods "
parameters:
  m: -1 kg
  l: 1 parsec
  half: l/2
parts:
  rod:
    mas: m
    shape: {type: rod, to: [0, 0, -half]}
  bob:
    mass: m
  top:
    mass: 1
    inertia: [1, 1, 9]
joints:
  pin:
    type: revolut
    between: [ground, rod]
  hook:
    type: revolute
    between: [rod.tip, bobb]
    axis: [0, 0, 0]
  slide:
    type: prismatic
    between: [bob, top.edge]
    axis: [half, 0, 0]
  end:
    type: fixed
    between: [tp, bob]
gravity: [0, 0]
"""


def test_all_problems_of_a_file_are_reported_at_once_from_top_to_bottom():
    assert [(problem.line, problem.key) for problem in problems_of(EVERYWHERE)] == [
        (1, "mechanism"),
        (4, "parameters.l"),
        (8, "parts.rod.mas"),
        (8, "parts.rod.mas"),
        (11, "parts.bob.mass"),
        (14, "parts.top.inertia"),
        (16, "joints.pin"),
        (17, "joints.pin.type"),
        (21, "joints.hook.between[0]"),
        (21, "joints.hook.between[1]"),
        (22, "joints.hook.axis"),
        (25, "joints.slide.between[1]"),
        (29, "joints.end.between[0]"),
        (30, "gravity"),
    ]


def test_what_uses_a_faulty_parameter_is_not_reported_as_well():
    text = changed(("  l: 1.5 m\n", "  l: 1 parsec\n"), (END, "    limits: {lower: l, upper: 0}\n"))
    text = text.replace("axis: [0, -1, 0]", "axis: [l, l - l, 0]")
    assert [problem.key for problem in problems_of(text)] == ["parameters.l"]


def test_what_uses_a_faulty_joint_is_not_reported_as_well():
    text = """
mechanism: m
parts: {arm: {mass: 1, inertia: [1, 1, 1]}}
joints: {pin: {type: revolute, between: [ground, arm], axis: [0, 1, 0], efort: 3}}
forces: {push: {type: effort, coordinate: pin, effort: "-pin.velocity"}}
actuators: {motor: {type: effort, joint: pin}}
sensors: {tacho: {type: tachometer, joint: pin, rate: 100}}
"""
    with pytest.raises(MechanismError) as found:
        parse_mechanism(text)
    assert [problem.key for problem in found.value.problems] == ["joints.pin.efort"]


def test_an_error_prints_as_file_line_key_message_value_and_remedy():
    problem = problem_of(changed(("shape:", "sape:")))
    valid = "center, collisions, inertia, inertia_check, mass, material, mesh, meshes, points, shapes"
    assert str(problem) == f"file.yaml:8: parts.rod.sape: unknown key 'sape'. Did you mean 'shape'? Others: {valid}."
    problem = problem_of(changed((MASS, "    mass: -3\n")))
    assert str(problem) == ("file.yaml:7: parts.rod.mass: must be at least 0 (got -3). Write 0 or a positive number.")


def test_many_problems_are_all_kept_and_the_first_are_printed():
    text = changed(("joints:\n", "".join(f"  p{i}: {{mass: -1, mas: 1}}\n" for i in range(1000)) + "joints:\n"))
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text)
    lines = str(caught.value).splitlines()
    assert len(caught.value.problems) == 2000 and len(lines) == MAX_SHOWN + 1
    assert lines[-1] == f"… and {2000 - MAX_SHOWN} more problems."


def count_problems(text):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text)
    return len(caught.value.problems)


def test_a_problem_prints_what_it_has():
    assert str(Problem("is wrong")) == "is wrong."
    assert str(Problem("is wrong", "Mend it.", key="a.b", value="3", file="f", line=2)) == (
        "f:2: a.b: is wrong (got 3). Mend it."
    )


@pytest.mark.timeout(120)  # a guard: a quadratic algorithm would take hours
def test_thousands_of_wrong_types_are_answered_in_time():
    wrong_types = "".join(f"  j{i}: {{type: hing, between: [ground, rod]}}\n" for i in range(2000))
    assert count_problems(PENDULUM + wrong_types) == 2000


@pytest.mark.parametrize("inertia", ["[[1, 0, 0], [0, 1, 0], [0, 0, 1]]", "[[1, 0, 0], 1, 1]"])
def test_an_inertia_that_is_written_as_a_matrix_is_told_how_it_is_written_here(inertia):
    """Each row "must be a number", it was said."""
    text = f"mechanism: x\nparts: {{b: {{mass: 1, inertia: {inertia}}}}}\njoints: {{b: {{type: free, between: [ground, b]}}}}\n"
    with pytest.raises(
        MechanismError, match=r"^<text>:2: parts\.b\.inertia: is a matrix\. Write it as \[I_xx, I_yy, I_zz\]"
    ):
        parse_mechanism(text)


YOYO = """
mechanism: yoyo
parameters: {r: 5 mm, m: 0.1}
parts: {yoyo: {shape: {type: disc, radius: 3 cm, axis: [0, 1, 0], mass: m}}}
joints: {yoyo: {type: planar, between: [ground, yoyo], axis: [0, 1, 0], x_axis: [0, 0, 1]}}
constraints: {string: {type: coupling, terms: {yoyo.x: 1, yoyo.angle: r}}}
"""


def test_factors_of_coordinates_may_have_units():
    """The radius on which a string is wound was refused: "a plain number is expected here"."""
    from mbd_sim import Simulation

    sim = Simulation(parse_mechanism(YOYO))
    sim.run(until=0.3)
    assert sim.u[0] == pytest.approx(-9.81 * 0.3 / (1 + 0.03**2 / 2 / 0.005**2), rel=1e-12)
