"""Joints and constraints that change nothing: their rows are round-off, which must not count as a constraint."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.math.rank import RANK, least_solution
from mbd_sim.files.load import parse_mechanism
from mbd_sim.simulation.contact.stepper import EventError
from mbd_sim.simulation.run.simulation import BaseSimulation
from test.generators.mechanisms import derived
from test.generators.redundant import KINDS, redundant_pair

# The values of the reference cases are those of the same mechanisms without the redundant element.
RAILS = """
mechanism: rails
ground: {points: {q: [0, 0.5, 0.1]}}
parts: {a: {mass: 3, inertia: [1, 1, 1], points: {q: [0, 0.5, 0.1]}}}
joints:
  x: {type: prismatic, between: [ground, a], axis: [1, 0.3, 0.7], velocity: 1}
  z: {type: prismatic, between: [ground.q, a.q], axis: [1, 0.3, 0.7]}
"""

STRUT = """
mechanism: strut
parts:
  a:
    mass: 1
    center: [0.1, 0, 0.2]
    inertia: [0.02, 0.03, 0.04]
    points: {w: {at: [0.3, 0.1, 0.2], rotate: {rpy: [0.5, 0.3, 0.7]}}, p: [-0.3, 0.2, 0.1]}
  b: {mass: 2, center: [0, 0.1, 0.05], inertia: [0.03, 0.03, 0.04], points: {q: [0.2, -0.1, 0.4]}}
joints:
  j: {type: universal, between: [ground, a], axes: [[1, 0, 0], [0, 1, 0.2]], velocity: [1, 2]}
  weld: {type: fixed, between: [a.w, b]}
constraints: {c: {type: distance, between: [a.p, b.q], length: 1.0565768360853087}}
"""

FOUR_BAR = """
mechanism: four_bar
ground: {points: {g: [0.9, 0, 0]}}
parts:
  p1: {mass: 1, shape: {type: rod, to: [0.2, 0, 0]}, points: {t: [0.2, 0, 0]}}
  p2: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {t: [0.4, 0, 0]}}
  p3: {mass: 1, shape: {type: rod, to: [0.3, 0, 0]}, points: {t: [0.3, 0, 0]}}
joints:
  a: {type: revolute, between: [ground, p1], axis: [0, 0, 1], position: 0, guess: true}
  b: {type: revolute, between: [p1.t, p2], axis: [0, 0, 1], position: 0, guess: true}
  c: {type: revolute, between: [p2.t, p3], axis: [0, 0, 1]}
  d: {type: revolute, between: [p3.t, ground.g], axis: [0, 0, 1], cut: true}
"""


def door(axis, second="spherical", tilt=0.0):
    """A door on a hinge and a second joint on its axis."""
    place = [float(x) for x in axis]
    record = {"type": second, "between": ["ground.p", "b.p"]}
    if second != "spherical":
        record["axis"] = (np.array(place) + np.array([tilt, 0.0, 0.0])).tolist()
    return json.dumps(
        {
            "mechanism": "door",
            "ground": {"points": {"p": place}},
            "parts": {"b": {"mass": 20, "center": [0.4, 0.1, -0.1], "inertia": [3, 4, 5], "points": {"p": place}}},
            "joints": {
                "a": {"type": "revolute", "between": ["ground", "b"], "axis": place, "velocity": 2},
                "b": record,
            },
        }
    )


def directions():
    """Directions along axes and planes of ground, rational and random."""
    rng = np.random.default_rng(19)
    return [np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8]), rng.normal(size=3)]


def test_a_door_on_a_hinge_and_a_ball_joint_turns_about_any_axis():
    for number, axis in enumerate(directions()):
        for second in ("spherical", "revolute")[number % 2 :][:1]:
            text = door(axis, second)
            simulations = [BaseSimulation(parse_mechanism(each)) for each in (text, _without_second(text))]
            for simulation in simulations:
                simulation.run(until=0.1)
            one, other = (np.concatenate([simulation.q, simulation.u]) for simulation in simulations)
            assert one == pytest.approx(other, rel=1e-13, abs=1e-13)
            assert simulations[0].model.degrees_of_freedom == 1
            assert abs(simulations[0].energies.residual) < 1e-12


def _without_second(text):
    data = json.loads(text)
    del data["joints"]["b"]
    return json.dumps(data)


def test_reference_values():
    door_simulation = BaseSimulation(parse_mechanism(door([0, 0.6, 0.8])))
    door_simulation.run(until=1.0)
    assert [*door_simulation.q, *door_simulation.u] == pytest.approx([2.7145670970803204, 1.043812286832665], rel=1e-11)
    rails = BaseSimulation(parse_mechanism(RAILS))
    rails.run(until=1.0)
    assert rails.u == pytest.approx([-4.463091870434738], rel=1e-13)
    strut = BaseSimulation(parse_mechanism(STRUT))
    strut.run(until=0.5)
    expected = [-0.3530869495028562, 2.9360132572415556, -8.668652628433184, 6.621133500079806]
    assert [*strut.q, *strut.u] == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("kind", ["telescope", "welds", "coupling", "four_bar"])
def test_redundant_elements_change_nothing(kind):
    """Nor do the orders of the lists, which differ, or the units: each third kind has small ones, and each third large ones."""
    length, mass = ((1e-6, 1e-9), (1e6, 1e3), (1.0, 1.0))[KINDS.index(kind) % 3]
    pair = redundant_pair(np.random.default_rng([7, KINDS.index(kind)]), kind, length, mass)
    simulations = [BaseSimulation(parse_mechanism(text)) for text in (pair.with_extra, pair.without)]
    for simulation in simulations:
        simulation.run(until=0.2)
        assert simulation.model.degrees_of_freedom == pair.freedoms
        assert abs(simulation.energies.residual) < 1e-11 * mass * length**2
    found, expected = (simulation.poses() for simulation in simulations)
    for name, pose in expected.items():
        assert found[name].position / length == pytest.approx(pose.position / length, abs=1e-12)
        assert found[name].rotation == pytest.approx(pose.rotation, abs=1e-12)
    for reaction in simulations[0].reactions().values():
        assert np.all(np.isfinite([*reaction.force, *reaction.moment]))


def test_two_bearings_share_the_load_as_equal_elastic_bearings():
    """On an axis through the center of mass, halfway between two bearings that bear as one does alone."""
    text = json.loads(door([0.0, 0.6, 0.8], "revolute"))
    text["parts"]["b"]["center"], text["joints"]["a"]["velocity"] = [0.0, 0.3, 0.4], 0.0
    reactions = BaseSimulation(parse_mechanism(json.dumps(text))).reactions()
    weight = np.array([0.0, 0.0, 20 * 9.80665])
    forces = [np.array(reaction.force) for reaction in reactions.values()]
    assert np.linalg.norm(forces[0]) == pytest.approx(np.linalg.norm(weight) / 2, rel=1e-2)
    assert forces[0] == pytest.approx(forces[1], rel=1e-10, abs=1e-9)


@pytest.mark.parametrize("tilt", [1e-8, 1e-6, 1e-4])
def test_axes_that_are_nearly_parallel_are_refused_with_the_reason(tilt):
    with pytest.raises(MechanismError) as caught:
        derived(json.dumps({**json.loads(door([0.0, 0.6, 0.8], "revolute", tilt)), "tolerance": 0}))
    (problem,) = caught.value.problems
    assert f"only just: deviations of {tilt:.1g} rad" in problem.message
    assert "tilt of the axis" in problem.remedy
    assert problem.key == "joints.b"


@pytest.mark.parametrize("position", [0.0, 0.3])
def test_a_stretched_four_bar_is_refused(position):
    """It closes in one position alone; from a guess the loop is closed there up to the root of round-off."""
    with pytest.raises(MechanismError, match="in this position alone"):
        derived(FOUR_BAR.replace("position: 0,", f"position: {position},", 1))


def test_a_four_bar_that_is_nearly_stretched_moves():
    simulation = BaseSimulation(
        parse_mechanism(FOUR_BAR.replace("0.9,", "0.8999,").replace("position: 0,", "position: 0.01,"))
    )
    simulation.run(until=0.2)
    assert np.ptp([0.0, *simulation.q]) > 1e-3
    assert abs(simulation.energies.residual) < 1e-10


@pytest.mark.parametrize("longer", [1e-2, 1e-6])
def test_a_platform_on_three_rods_of_which_one_is_longer_is_locked(longer):
    """Its rods are parallel at the start, where it could move to first order; circles of two radii touch there."""
    with pytest.raises(MechanismError, match="in this position alone"):
        derived(platform(longer))


def test_a_platform_on_three_equal_rods_moves():
    equations = derived(platform(0.0))
    assert equations.start.rank == 2 < equations.layout.nv


def platform(longer):
    """Three parallel rods, of which the last hangs higher by as much as it is `longer`."""
    return f"""
mechanism: platform
ground: {{points: {{g1: [0, 0, 0], g2: [1, 0, 0], g3: [0.4, {longer}, 0]}}}}
parts:
  p: {{mass: 2, center: [0.5, 0, 0], inertia: [0.1, 0.2, 0.2], points: {{a: [0, 0, 0], b: [1, 0, 0], c: [0.4, 0, 0]}}}}
joints: {{j: {{type: planar, between: [ground, p], axis: [0, 0, 1], position: [0, -0.5, 0], guess: true}}}}
constraints:
  r1: {{type: distance, between: [ground.g1, p.a], length: 0.5}}
  r2: {{type: distance, between: [ground.g2, p.b], length: 0.5}}
  r3: {{type: distance, between: [ground.g3, p.c], length: {0.5 + longer}}}
"""


def test_steps_do_not_divide_round_off_by_round_off():
    noise, gap = np.full((2, 3), 1e-17), np.full(2, 1e-17)
    assert not least_solution(noise, gap).any()
    matrix = np.diag([1.0, 0.1 * RANK])
    assert least_solution(matrix, np.ones(2)) == pytest.approx(np.array([1.0, 0.0]))


OTHER_PART = """  d: {mass: 1, center: [0.1, 0, 0], inertia: [0.02, 0.03, 0.04]}
joints:
  other: {type: revolute, between: [ground, d], axis: [0, 0, 1], drive: sin(t)}
"""


@pytest.mark.parametrize(
    ("kind", "bound"), [("a drive elsewhere", "at_most"), ("a live value", "at_least"), ("a length of time", "at_most")]
)
def test_a_gap_that_no_coordinate_changes_never_acts(kind, bound):
    """Between welded parts: it divided by the round-off in its row, and the state became infinite in the first step."""
    change = {"at_most": "+ 0.1*sin(3*t)", "at_least": "- 0.1*sin(3*t)"}[bound] if kind == "a length of time" else ""
    text = STRUT.replace("1.0565768360853087}", f"1.0565768360853087 {change}, bound: {bound}, restitution: 0.5}}")
    text = text.replace("joints:\n", OTHER_PART) if kind == "a drive elsewhere" else text
    simulation = BaseSimulation(parse_mechanism(text), live=["parts.b.mass"] if kind == "a live value" else [])
    simulation.run(until=0.5)
    expected = [-0.3530869495028562, 2.9360132572415556, -8.668652628433184, 6.621133500079806]
    assert [*simulation.q[:2], *simulation.u[:2]] == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize(("bound", "change"), [("at_most", "- 0.1*(t - 0.2)"), ("at_least", "+ 0.1*(t - 0.2)")])
def test_a_gap_that_time_closes_and_no_force_opens_is_refused(bound, change):
    text = STRUT.replace("1.0565768360853087}", f"1.0565768360853087 {change}, bound: {bound}}}")
    with pytest.raises(EventError, match=r"at 0\.2 s the gap of c is closed by the time alone"):
        BaseSimulation(parse_mechanism(text)).run(until=0.5)


def test_a_gap_that_only_a_drive_closes_names_the_drive_and_what_helps():
    """It said to reduce the friction, of which there is none."""
    text = """
mechanism: press
parts: {ram: {mass: 1}, idle: {mass: 1}, free: {mass: 1}}
joints:
  slide: {type: prismatic, between: [ground, ram], axis: [0, 0, 1], drive: 0.3 - t}
  rest: {type: prismatic, between: [ground, idle], axis: [1, 0, 0], drive: 1}
  other: {type: prismatic, between: [ground, free], axis: [0, 1, 0]}
constraints:
  table: {type: on_plane, point: ram, bound: at_least}
"""
    expected = (
        r"at 0\.3 s the gap of table is closed by the drive of slide alone.* with a spring in place of a driven joint"
    )
    with pytest.raises(EventError, match=expected):
        BaseSimulation(parse_mechanism(text)).run(until=0.5)


def test_a_driven_shaft_may_have_two_bearings():
    """The drift of its rows is round-off as well, and contradicts no drive."""
    text = json.loads(door([0.0, 0.6, 0.8]))
    del text["joints"]["a"]["velocity"]
    text["joints"]["a"]["drive"] = "sin(2*t)"
    text["parts"]["c"] = {"mass": 1, "center": [0.4, 0.1, -0.1], "inertia": [0.3, 0.4, 0.5]}
    text["joints"]["c"] = {"type": "revolute", "between": ["b", "c"], "axis": [1, 0, 0.3]}
    one, other = (
        BaseSimulation(parse_mechanism(each)) for each in (json.dumps(text), _without_second(json.dumps(text)))
    )
    for simulation in (one, other):
        simulation.run(until=0.2)
    assert np.concatenate([one.q, one.u]) == pytest.approx(np.concatenate([other.q, other.u]), rel=1e-13, abs=1e-13)
