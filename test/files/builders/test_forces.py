"""Force elements and the laws of joints as a file writes them: what is read, and what each mistake is answered."""

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.values.laws import Expressed, GreenStrain, Linear
from mbd_sim.mechanism.values.tables import Piecewise

TEXT = """
mechanism: two
parameters: {k: 3}
ground: {points: {turned: {rotate: {axis: [0, 0, 1], angle: 90 deg}}}}
parts:
  ball: {mass: 2, inertia: [0.2, 0.3, 0.4], points: {rim: {at: [0.1, 0, 0], rotate: {axis: [0, 0, 1], angle: 1}}}}
  other: {mass: 1}
joints:
  flight: {type: free, between: [ground, ball], position: [3, 0, 0]}
  slide: {type: prismatic, between: [ball, other], axis: [1, 0, 0], JOINT}
  FORCE
"""


def parse(force="", joint=""):
    return parse_mechanism(TEXT.replace("JOINT", joint).replace("  FORCE", f"forces:\n  {force}" if force else ""))


def tie(keys, kind="spring"):
    return f"s: {{type: {kind}, between: [ground, ball], {keys}}}"


def test_a_spring_has_the_law_that_it_is_given():
    laws = {
        keys: parse(tie(keys)).springs[0].law for keys in ("stiffness: k", "force: k*x**3", "table: [[0, 0], [1, k]]")
    }
    assert laws["stiffness: k"] == Linear(3.0)
    assert isinstance(laws["force: k*x**3"], Expressed) and isinstance(laws["table: [[0, 0], [1, k]]"], Piecewise)
    (table,) = parse(tie("table: [[0 cm, 0], [5 cm, 3 lbf]]")).springs
    assert table.law.knots.tolist() == [0.0, 0.05]
    assert table.law.coefficients[-1][0] == pytest.approx(13.3446648, rel=1e-8)


def test_an_elastic_bar_has_greens_strain_unless_it_is_small():
    bar = "stiffness: 9, length: 2"
    assert parse(tie(bar, "elastic_bar")).springs[0].law == GreenStrain(9.0, 2.0)
    small = parse(tie(bar + ", strain: small", "elastic_bar")).springs[0]
    assert (small.law, small.length) == (Linear(9.0), 2.0)


@pytest.mark.parametrize(("exponent", "slow"), [(0.5, 1e-2), (1, 1e-30), (2, 1e-30)])
def test_a_damper_is_made_smooth_where_its_law_is_steep(exponent, slow):
    (damper,) = parse(tie(f"coefficient: 4, exponent: {exponent}", "damper")).dampers
    assert (damper.law.coefficient, damper.law.exponent, damper.law.regularization) == (4.0, exponent, slow)
    assert damper.needs_line
    (given,) = parse(tie("coefficient: 4, exponent: 0.5, regularization: 2 mm/s, along: velocity", "damper")).dampers
    assert given.law.regularization == 2e-3 and not given.needs_line


def test_a_joint_has_the_laws_that_it_is_given():
    keys = (
        "rest: 0.2, spring: {force: k*x}, damper: {coefficient: 2, exponent: 3}, "
        "friction: {coulomb: 2, static: 3, stribeck_velocity: 0.1}, limits: {lower: 0, upper: 1, stiffness: 5, damping: 2}"
    )
    slide = parse(joint=keys).joints["slide"]
    assert isinstance(slide.spring, Expressed) and slide.damper.exponent == 3.0 and slide.limits[0].damping == 2.0
    assert (slide.friction.static, slide.friction.stribeck_velocity, slide.friction.regularization) == (3.0, 0.1, 1e-2)
    plain = parse(joint="friction: {coulomb: 2}").joints["slide"].friction
    assert plain.static == plain.coulomb == 2.0 and plain.stribeck_velocity == np.inf


@pytest.mark.parametrize(
    ("axes", "part", "x"),
    [
        ("ground", "ground", [1, 0, 0]),
        ("part", "ball", [1, 0, 0]),
        ("other", "other", [1, 0, 0]),
        ("ground.turned", "ground", [0, 1, 0]),
        ("ball.rim", "ball", [np.cos(1), np.sin(1), 0]),
    ],
)
def test_axes_are_those_of_ground_the_part_another_part_or_a_point(axes, part, x):
    for element in ("f: {type: force, at: ball.rim", "c: {type: couple, on: ball.rim"):
        (applied,) = parse(f"{element}, vector: [1, 0, 0], axes: {axes}}}").applied
        assert applied.axes_of == part and applied.following == (part != "ground")
        assert applied.axes[:, 0] == pytest.approx(x, abs=1e-15)


FORCES = {
    tie("stiffness: 1, force: 3*x"): "has stiffness and force. Give one of them.",
    tie("force: 3*x, table: [[0, 1], [1, 2]]"): "has force and table. Give one of them.",
    tie("length: 1"): "has neither stiffness nor damping. Add 'stiffness', 'force', 'table' or 'damping'.",
    tie("force: 1/x"): "force: has no finite value at x = 0",
    tie("force: 3*s"): "unknown name 's' (got '3*s'). Valid: flight.rx.velocity, ",
    tie("force: [1]"): "must be an expression of x",
    tie("force: 3 m"): "the unit 'm' does not fit: a value in N is expected here",
    tie("force: sqrt(x), length: 4"): "has no finite value at the start, where x = -1",
    tie("table: [[0, 1]]"): "needs at least two rows. Add one, as [elongation, force].",
    tie("table: [[0, 1], [0, 2]]"): "0 comes after 0. Sort the rows by increasing elongation.",
    tie("table: [[0, 1], [1]]"): "has 1 value, not 2 (got [1]). Write it as [elongation, force].",
    tie("table: 3"): "Write it as [[elongation, force], [elongation, force]].",
    tie("stiffness: 1, mass: -1"): "mass: must be at least 0",
    "s: {type: spring, between: [other, ball.rim], stiffness: 1, mass: 2}": "must have one end on ground. Remove its mass",
    tie("stiffness: 1", "elastic_bar"): "'length' is missing",
    tie("stiffness: 0, length: 1", "elastic_bar"): "stiffness: must be greater than 0",
    tie("stiffness: 1, length: 1, strain: large", "elastic_bar"): "unknown word (got 'large'). Write green or small.",
    tie("exponent: 2", "damper"): "'coefficient' is missing",
    tie("coefficient: 1, exponent: -1", "damper"): "exponent: must be at least 0",
    tie("coefficient: 1 N*s/m", "damper"): "a plain number is expected here",
    tie("coefficient: 1, along: x", "damper"): "unknown word (got 'x'). Write line or velocity.",
    "s: {type: damper, between: [ball, ball.rim], coefficient: 1}": "connects 'ball' with itself",
    "f: {type: force, at: ball, vector: [1, 0, 0], axes: grund}": "axes: there is no part 'grund'. Did you mean 'ground'?",
    "f: {type: force, at: ball, vector: [1, 0, 0], axes: ball.rin}": "axes: 'ball' has no point 'rin'. Did you mean 'rim'?",
}
JOINTS = {
    "spring: {force: 3*x}, stiffness: 1": "has stiffness and spring. Give one of them.",
    "spring: {}": "gives none of force, table. Give one of force, table.",
    "spring: {force: x, table: [[0, 1], [1, 1]]}": "gives force and table. Give only one of force, table.",
    "spring: {force: log(1 + x)}, position: -2": "has no finite value at the start, where x = -2",
    "friction: {coulomb: 2, static: 1, stribeck_velocity: 1}": "static 1 is less than coulomb 2",
    "friction: {coulomb: 2, static: 3}": "belong together. Add 'stribeck_velocity'.",
    "friction: {coulomb: 2, stribeck_velocity: 3}": "belong together. Add 'static'.",
    "friction: {static: 2, stribeck_velocity: 3}": "gives none of coulomb, coefficient",
    "friction: {coulomb: 1, regularization: 0}": "regularization: must be greater than 0",
    "limits: {lower: 0, upper: 1, damping: 2}": "damping of stops has no effect without stiffness. Add 'stiffness'.",
    "limits: {lower: 0, upper: 1, stiffness: 3, damping: 2 N*s/m}": "a value in s/m is expected here",
    "drive: 3*t, friction: {coulomb: 1}, spring: {force: x}": "has a drive and friction, spring.",
}


def told(force="", joint=""):
    with pytest.raises(MechanismError) as caught:
        derive(parse(force, joint))
    (problem,) = caught.value.problems
    assert problem.line == (12 if force else 10)
    return str(problem)


@pytest.mark.parametrize("force", FORCES)
def test_a_wrong_force_element_is_answered_with_its_line_and_a_remedy(force):
    assert FORCES[force] in told(force=force)


@pytest.mark.parametrize("joint", JOINTS)
def test_a_wrong_law_of_a_joint_is_answered_with_its_line_and_a_remedy(joint):
    assert JOINTS[joint] in told(joint=joint)


@pytest.mark.parametrize("keys", ["coefficient: 1", "coefficient: 1, exponent: 3"])
def test_a_damper_without_a_line_at_the_start_is_refused(keys):
    text = TEXT.replace("position: [3, 0, 0]", "position: [0, 0, 0]")
    text = text.replace("JOINT", "").replace("  FORCE", f"forces:\n  {tie(keys, 'damper')}")
    with pytest.raises(MechanismError, match=r"the damper has no direction.*'along: velocity' needs no direction"):
        derive(parse_mechanism(text))
    derive(parse_mechanism(text.replace(keys, f"{keys}, along: velocity")))


def test_the_ends_of_a_refused_element_are_checked_all_the_same():
    with pytest.raises(MechanismError) as caught:
        parse("s: {type: damper, between: [ground, bal], exponent: 1}")
    assert "'coefficient' is missing" in str(caught.value) and "Did you mean 'ball'?" in str(caught.value)
