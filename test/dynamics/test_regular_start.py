"""The mass matrix at the start, of which it is checked that it is regular."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Ensemble, Simulation, load_mechanism, parse_mechanism
from mbd_sim.dynamics.constraints.start import given_start
from mbd_sim.dynamics.kinematics.tracing import trace
from mbd_sim.dynamics.regular_start import start_mass_matrix
from mbd_sim.dynamics.terms import mass_matrix
from test.generators.two_linkages import two_linkages


@pytest.mark.parametrize("name", ["double_rod", "spherical_top", "rotating_frame_mass", "cart_massive_spring"])
def test_the_columns_of_the_mass_matrix_are_those_of_composite_bodies(name):
    """Of derivatives of the kinetic energy, against the composite-rigid-body algorithm, also with drives."""
    traced = trace(load_mechanism(name))
    q = given_start(traced.numeric, traced.layout)[0]
    symbols = [traced.state.t, traced.state.q]
    expected = np.array(ca.Function("M", symbols, [mass_matrix(traced)])(0.0, q))
    found = start_mass_matrix(traced, q)
    assert found == pytest.approx(expected, rel=1e-14, abs=1e-14 * np.max(np.abs(expected)))


FLAT = """
mechanism: flat
gravity: [0, 0, 0]
ground: {points: {d: [1, 0, 0]}}
parts:
  crank: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
  bar: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  rocker: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
joints:
  main: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 0, velocity: 3}
  pin: {type: revolute, between: [crank.tip, bar], axis: [0, -1, 0]}
  other: {type: revolute, between: [ground.d, rocker], axis: [0, -1, 0]MORE}
  eye: {type: revolute, between: [bar.tip, rocker.tip], axis: [0, -1, 0]}
"""


@pytest.mark.parametrize(("speed", "given", "rate"), [(3.0, ", velocity: -7", -7.0), (13 / 7, "", 13 / 7)])
def test_a_flat_parallelogram_starts_along_one_of_its_branches(speed, given, rate):
    """(θ' - ψ') (d (θ' + ψ') + r (θ' - ψ')) = 0, of which ψ' = θ' has less energy than ψ' = -θ' (d + r)/(d - r).

    Where ψ' = θ', all of γ is round-off, which is not zero for 13/7.
    """
    simulation = Simulation.from_text(FLAT.replace("MORE", given).replace("velocity: 3", f"velocity: {speed!r}"))
    speeds = dict(zip(simulation.coordinate_names, simulation.u.tolist(), strict=True))
    assert [speeds["main"], speeds["other"]] == pytest.approx([speed, rate], rel=1e-13)
    simulation.run(until=0.1)
    assert abs(simulation.energies.residual) < 1e-12 * simulation.energies.kinetic


def test_members_of_an_ensemble_start_as_they_would_alone():
    mechanism = parse_mechanism(FLAT.replace("MORE", ""))
    angles = 0.05 * np.array([-7, 2])
    ensemble = Ensemble(mechanism, [{"joints.main.position": angle} for angle in angles.tolist()])
    for index, angle in enumerate(angles):
        alone = Simulation(mechanism, set={"joints.main.position": float(angle)})
        assert np.array_equal(ensemble.q[index], alone.q)
        assert np.array_equal(ensemble.u[index], alone.u)


def with_a_second(**values):
    return Simulation.from_text(two_linkages(**values))


@pytest.mark.parametrize("second", [2])
def test_a_row_that_is_zero_up_to_round_off_does_not_hide_the_branches_of_another_loop(second):
    """At 180°, a row of the second linkage is of the size of sin(π) in floating-point numbers."""
    simulation = with_a_second(END=-1, LENGTH=0.4, ANGLE="180 deg", LEAN=0, SPEED=3, SECOND=second)
    assert simulation.u == pytest.approx([3.0, -3.0, 3.0, second, second, second], rel=1e-13, abs=1e-11)
    simulation.run(until=0.05)
    assert abs(simulation.energies.residual) < 1e-13 * simulation.energies.kinetic


@pytest.mark.parametrize(("speed", "second"), [(0.1, 2000)])
def test_a_fast_loop_does_not_hide_that_another_one_is_off_its_branches(speed, second):
    """The second linkage is a four-bar in a regular configuration."""
    simulation = with_a_second(END=1, LENGTH=0.2, ANGLE=1, LEAN=-0.7, SPEED=speed, SECOND=second)
    assert simulation.u[:3] == pytest.approx([speed, -speed, speed], rel=1e-12)
    alone = with_a_second(END=1, LENGTH=0.2, ANGLE=1, LEAN=-0.7, SPEED=0, SECOND=second)
    assert simulation.u[3:] == pytest.approx(alone.u[3:], rel=1e-12)


DOOR = """
mechanism: door
gravity: [0, 0, 0]
ground: {points: {top: [0.3, 0.5, 0.7], d: [1, 0, 0]}}
parts:
  door: {mass: 1, inertia: [1, 1, 1], center: [0.1, 0.4, 0.3], points: {top: [0.3, 0.5, 0.7]}}
  crank: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
  bar: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  rocker: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
joints:
  low: {type: revolute, between: [ground, door], axis: [0.3, 0.5, 0.7], position: 0.3, velocity: 3}
  high: {type: revolute, between: [ground.top, door.top], axis: [0.3, 0.5, 0.7], cut: true}
  main: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: ANGLE}
  pin: {type: revolute, between: [crank.tip, bar], axis: [0, -1, 0]}
  other: {type: revolute, between: [ground.d, rocker], axis: [0, -1, 0]}
  eye: {type: revolute, between: [bar.tip, rocker.tip], axis: [0, -1, 0]}
"""


@pytest.mark.parametrize("angle", ["0"])
def test_rows_whose_drift_is_round_off_leave_other_speeds_alone(angle):
    """The hinges of a door lie on its axis. The linkage beside it rests, also if it lies flat, alone and as a member."""
    mechanism = parse_mechanism(DOOR.replace("ANGLE", angle))
    rest = [0.0, 0.0, 0.0]
    assert Simulation(mechanism).u.tolist() == [3.0, *rest]
    ensemble = Ensemble(mechanism, [{"joints.low.velocity": speed} for speed in (3.0, 2.0)])
    assert ensemble.u.tolist() == [[3.0, *rest], [2.0, *rest]]
