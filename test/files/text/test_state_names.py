"""Joint coordinates and speeds by name in the expressions of forces: what they mean, and what is refused."""

from __future__ import annotations

import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import DivergedError, MechanismError
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.values.laws import Expressed, Varying

TEXT = """
mechanism: names
parameters: {k: 3, arm: 7}
functions: {twice(a): 2*a}
TABLES
parts: {block: {mass: 1}, rod: {mass: 1, inertia: [1, 1, 1]}, ball: {mass: 1, inertia: [1, 1, 1]}}
joints:
  slide: {type: prismatic, between: [ground, block], axis: [1, 0, 0], position: 2, velocity: 0.5, JOINT}
  arm: {type: revolute, between: [ground, rod], axis: [0, 0, 1], position: 0.25}
  drum: {type: spherical, between: [rod, ball]}
forces:
  FORCE
"""
LINE = 12


def filled(force, joint="damping: 0", tables=""):
    return TEXT.replace("JOINT", joint).replace("FORCE", force).replace("TABLES", tables)


def parse(force, joint="damping: 0", tables=""):
    return parse_mechanism(filled(force, joint, tables))


def effort(expression):
    return f'f: {{type: effort, coordinate: slide, effort: "{expression}"}}'


def acceleration(expression):
    """The acceleration of the slider, which has a mass of 1 kg, at the start."""
    simulation = Simulation(parse(effort(expression)), method="euler", step=1e-3)
    before = simulation.u[0]
    simulation.step(1)
    return (simulation.u[0] - before) / 1e-3


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("slide", 2.0),
        ("slide.position", 2.0),
        ("slide.velocity", 0.5),
        ("arm", 7.0),
        ("arm.position", 0.25),
        ("arm.velocity", 0.0),
        ("k*twice(slide.velocity)", 3.0),
        ("drum.rx.velocity + 1", 1.0),
        ("${1 + t} kN", 1000.0),
        ("pi*slide", 6.283185307179586),
    ],
)
def test_a_name_means_its_coordinate_or_speed(expression, value):
    assert acceleration(expression) == pytest.approx(value, rel=1e-9, abs=1e-9)


MISTAKES = {
    effort("slid"): "forces.f.effort: unknown name 'slid' (got 'slid'). Did you mean 'slide'?",
    effort("slide.velocty"): "unknown name 'slide.velocty' (got 'slide.velocty'). Did you mean 'slide.velocity'?",
    effort("drum"): "unknown name 'drum'",
    effort("drum.rx"): "'drum.rx' is a component of an angular velocity: it has no position (got 'drum.rx'). "
    "For the speed write drum.rx.velocity.",
    effort("slide > 0"): "a comparison stands where a number is expected",
    effort("where(slide > 9, foo(1), 1)"): "unknown function 'foo'",
    effort("table(gas, slide)"): "there is no table 'gas'",
    effort("block.x"): "unknown name 'block.x'",
    effort("${slide} N*m"): "the unit 'N*m' does not fit: a value in N is expected here",
    "f: {type: effort, coordinate: drum.rx, effort: 5 N}": "the unit 'N' does not fit: a value in N*m is expected here",
    "f: {type: effort, coordinate: slid, effort: 1}": "forces.f.coordinate: there is no joint coordinate 'slid'. Did you mean",
    "f: {type: effort, coordinate: 5, effort: 1}": "forces.f.coordinate: must be text (got 5)",
    "f: {type: effort, coordinate: slide, effort: 1, cordinate: 2}": "forces.f.cordinate: unknown key 'cordinate'",
    "f: {type: effort, coordinate: slide}": "forces.f: 'effort' is missing",
    "f: {type: force, at: block, vector: [1/(slide - 2), 0, 0]}": "forces.f.vector[0]: has no finite value at the "
    "start, where slide = 2",
    "f: {type: force, at: block, vector: [log(slide.velocity - 1), 0, 0]}": "where slide.velocity = 0.5",
    effort(
        "sqrt(arm.position - slide)"
    ): "forces.f.effort: has no finite value at the start, where arm.position = 0.25, slide = 2",
}


@pytest.mark.parametrize("force", MISTAKES)
def test_a_mistake_is_answered_with_its_line_and_a_remedy(force):
    with pytest.raises(MechanismError) as caught:
        Simulation(parse(force))
    (problem,) = caught.value.problems
    assert problem.line == LINE
    assert MISTAKES[force] in str(problem)


@pytest.mark.parametrize(
    ("joint", "words"),
    [
        (
            "drive: 2 + arm.position",
            "joints.slide.drive: 'arm.position' is a joint coordinate, on which this expression cannot depend",
        ),
        (
            "spring: {force: k*x + log(x - 4)*slide.velocity}",
            "joints.slide.spring.force: has no finite value at the start",
        ),
    ],
)
def test_a_mistake_in_a_joint_is_answered_too(joint, words):
    with pytest.raises(MechanismError) as caught:
        Simulation(parse(effort("1") if "spring" in joint else "f: {type: couple, on: rod, vector: [0, 0, 1]}", joint))
    assert words in str(caught.value)


def test_a_spring_of_its_elongation_alone_keeps_its_potential():
    laws = [
        parse(effort("1"), f"spring: {{force: {force}}}").joints["slide"].spring
        for force in ("k*x", "k*x*t", "k*x + slide")
    ]
    assert [type(law) for law in laws] == [Expressed, Varying, Varying]


def test_what_files_called_by_the_names_of_new_functions_keeps_its_meaning():
    text = filled(effort("sign*table + clip(k, 2, slide)")).replace("k: 3,", "k: 3, sign: 2, table: 4,")
    mechanism = parse_mechanism(text.replace("twice(a): 2*a", '"clip(a, b, c)": a*b*c'))
    assert mechanism.efforts[0].effort.value({"slide": 2.0}) == 20.0


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("points: [[0, 1]]", "tables.gas: points has 1 entries. Give between 2 and 1000."),
        ("points: [[0, 1], [0, 2]]", "in points, 0 comes after 0. Sort them by increasing x."),
        ("points: [[0, 1], [2, 2]], period: 1", "the points extend over 2, more than the period 1"),
        ("points: [[0, 1], [2, 2]], period: 2", "begins with 1 and ends with 2, a period later"),
        ("x: [0, 1], y: [0, 1], values: [[0, 1]]", "values is not 2 rows of 2 numbers"),
        ("x: [0, 1], y: [0, 1]", "gives neither a curve nor a surface"),
        (
            "x: [0, 1], y: [0, 1], values: [[0, 1], [2, 3]]",
            "'gas' is a table of 2 variables, not of 1 (got 'table(gas, slide)'). Write table(gas, x, y).",
        ),
        ("points: [[0, 1], [2, 2 furlongs]]", "unknown unit 'furlongs'"),
    ],
)
def test_a_wrong_table_is_named(table, words):
    with pytest.raises(MechanismError) as caught:
        Simulation(parse(effort("table(gas, slide)"), tables=f"tables: {{gas: {{{table}}}}}"))
    assert words in str(caught.value) and len(caught.value.problems) == 1


def test_an_unknown_table_is_named():
    with pytest.raises(MechanismError, match=r"there is no table 'gaz' .*Did you mean 'gas'"):
        parse(effort("table(gaz, slide)"), tables="tables: {gas: {points: [[0, 1], [1, 2]]}}")


def test_a_joint_that_a_force_names_has_a_coordinate():
    text = """
mechanism: loop
parts: {a: {mass: 1, inertia: [1, 1, 1]}, b: {mass: 1, inertia: [1, 1, 1]}}
joints:
  p: {type: revolute, between: [ground, a], axis: [0, 0, 1]}
  q: {type: revolute, between: [a, b], axis: [0, 0, 1]}
  r: {type: revolute, between: [ground, b], axis: [0, 0, 1]CUT}
forces: {f: {type: effort, coordinate: p, effort: r.velocity}}
"""
    assert not parse_mechanism(text.replace("CUT", "")).joints["r"].splits
    assert parse_mechanism(text.replace("CUT", ", cut: true")).joints["r"].splits


def test_an_expression_that_ends_during_the_motion_is_named():
    simulation = Simulation(parse(effort("1 + 1e-9*log(2.5 - slide)")))
    with pytest.raises(
        DivergedError, match=r":12: forces.f.effort: the expression has no finite value near slide = 2.5"
    ):
        simulation.step(3000)
    simulation = Simulation(
        parse("f: {type: couple, on: rod, vector: [0, 0, 1]}", "spring: {force: sqrt(0.7 - x.velocity) - 1.5}")
    )
    with pytest.raises(DivergedError, match=r":8: joints.slide.spring.force: .* near x.velocity = 0.7"):
        simulation.step(3000)


def test_live_parameters_act_within_these_expressions():
    law = effort("-k*slide - k*slide.velocity")
    simulation = Simulation(parse(law), live=["parameters.k"])
    other = Simulation(parse_mechanism(filled(law).replace("k: 3", "k: 5")))
    simulation.set_live({"parameters.k": 5.0})
    simulation.step(500)
    other.step(500)
    assert simulation.state[:2] == pytest.approx(other.state[:2], rel=1e-13)


RENAMED = """
mechanism: names
parameters: {PARAMETER}
parts: {rod: {mass: 1, inertia: [1, 1, 1]}, disc: {mass: 1, inertia: [1, 1, 1]}}
joints:
  JOINT: {type: revolute, between: [ground, rod], axis: [0, 0, 1], position: 0.25}
  other: {type: revolute, between: [ground, disc], axis: [0, 0, 1], DRIVE}
forces: {f: {type: effort, coordinate: JOINT, effort: "EFFORT"}}
"""


def renamed(joint, effort, parameter="k: 2", drive="position: 0"):
    texts = {"JOINT": joint, "EFFORT": effort, "PARAMETER": parameter, "DRIVE": drive}
    text = RENAMED
    for word, value in texts.items():
        text = text.replace(word, value)
    return parse_mechanism(text)


@pytest.mark.parametrize("name", ["e", "pi"])
def test_a_joint_is_never_a_constant_without_a_word(name):
    """A force -2*e on a joint named e was -2*2.718."""
    for wrong in (
        {"effort": f"-2*{name}"},
        {"effort": "0", "parameter": f"k: 2*{name}"},
        {"effort": "0", "drive": f'drive: "0.1*{name}"'},
        {"effort": "0", "drive": f"position: 2*{name}"},
    ):
        with pytest.raises(MechanismError, match=f"'{name}' is a constant in expressions, and the name of a joint"):
            renamed(name, **wrong)
    assert first_speed(renamed(name, f"-2*{name}.position")) == pytest.approx(-0.5e-3)


def test_a_joint_is_never_the_time_where_an_expression_can_depend_on_joints():
    with pytest.raises(MechanismError, match="'t' is the time in expressions, and the name of a joint"):
        renamed("t", "-2*t")
    assert renamed("t", "0", drive='drive: "0.1*t"')  # a drive cannot depend on a joint
    assert first_speed(renamed("t", "-2*t.position")) == pytest.approx(-0.5e-3)


def first_speed(mechanism):
    simulation = Simulation(mechanism, method="euler", step=1e-3)
    simulation.step(1)
    return simulation.u[0]


@pytest.mark.parametrize("name", ["sin", "tanh", "where", "table", "min"])
def test_a_joint_named_like_a_function_is_that_joint(name):
    assert first_speed(renamed(name, f"-2*{name}")) == pytest.approx(-0.5e-3)


def test_a_parameter_with_the_name_of_a_constant_is_the_parameter_or_refused():
    assert first_speed(renamed("hinge", "-e", parameter="e: 3")) == pytest.approx(-3e-3)
    for name in ("pi", "sin"):
        with pytest.raises(MechanismError, match=f"'{name}' is reserved in expressions"):
            renamed("hinge", "0", parameter=f"{name}: 3")
    with pytest.raises(MechanismError, match="the parameter 't' hides the time"):
        renamed("hinge", "t", parameter="t: 3")
