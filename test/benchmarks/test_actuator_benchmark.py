"""The benchmark of actuators: what it compares is the same mechanism, and its actuators work."""

import pytest

from benchmarks.actuators import ACTUATORS, CYLINDERS, with_actuators, with_cylinder
from mbd_sim import Simulation


@pytest.mark.parametrize("kind", ACTUATORS)
def test_its_actuators_exert_efforts(kind):
    simulation = Simulation.from_text(with_actuators("double_rod", ACTUATORS[kind]), method="rk4")
    simulation.set_commands({"m0": 1.0, "m1": 1.0})
    simulation.run(0.05)
    assert all(state.effort != 0.0 for state in simulation.actuators().values())
    assert simulation.coordinate_names == Simulation.from_text(with_actuators("double_rod", "")).coordinate_names


@pytest.mark.parametrize("kind", CYLINDERS)
def test_its_cylinders_carry_the_lift(kind):
    simulation = Simulation.from_text(with_cylinder(CYLINDERS[kind]), method="rk4")
    simulation.set_commands({"cylinder": 7500.0 if kind == "effort" else 0.0})
    simulation.run(until=0.05)
    assert simulation.actuators()["cylinder"].effort > 5000.0
    assert simulation.coordinate_names == Simulation.from_text(with_cylinder("")).coordinate_names
