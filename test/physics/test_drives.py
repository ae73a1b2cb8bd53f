"""Prescribed motion: the forces of the drives and their work."""

import numpy as np
import pytest

from mbd_sim import MechanismError, Simulation

LIFT = """
mechanism: lift
parts:
  cabin: {mass: 3}
joints:
  shaft: {type: prismatic, between: [ground, cabin], axis: [0, 0, 1], drive: 0.2*t^2 + 0.1*sin(3*t)}
"""

ARM = """
mechanism: arm
gravity: [0, 0, 0]
parameters: {w: 2}
parts:
  hub: {mass: 1, inertia: [0.2, 0.2, 0.3]}
  bead: {mass: 0.5}
joints:
  turn: {type: revolute, between: [ground, hub], axis: [0, 0, 1], drive: w*t}
  rail: {type: prismatic, between: [hub, bead], axis: [1, 0, 0], position: 0.4}
"""


@pytest.mark.parametrize("time", [0.0, 0.7, 2.3])
def test_the_drive_of_a_lift_carries_its_weight_and_inertia(time):
    simulation = Simulation.from_text(LIFT)
    simulation.run(until=time)
    (position,), (speed,), (force,) = simulation.model.drives(simulation.time, simulation.state, simulation.efforts)
    assert position == pytest.approx(0.2 * time**2 + 0.1 * np.sin(3 * time), rel=1e-14)
    assert speed == pytest.approx(0.4 * time + 0.3 * np.cos(3 * time), rel=1e-14)
    assert force == pytest.approx(3 * (9.81 + 0.4 - 0.9 * np.sin(3 * time)), rel=1e-14)


def test_the_work_of_a_drive_is_the_energy_gained():
    simulation = Simulation.from_text(LIFT)
    simulation.run(until=2.0)
    height, speed = 0.8 + 0.1 * np.sin(6), 0.8 + 0.3 * np.cos(6)
    gained = 0.5 * 3 * (speed**2 - 0.3**2) + 3 * 9.81 * height
    assert simulation.energies.work_drives == pytest.approx(gained, rel=1e-12)
    assert abs(simulation.energies.residual) < 1e-12


def test_a_bead_in_a_rotating_frame_departs_exponentially_and_loads_the_drive_by_its_coriolis_force():
    simulation = Simulation.from_text(ARM)
    simulation.run(until=1.0)
    x, rate = 0.4 * np.cosh(2.0), 0.8 * np.sinh(2.0)
    assert simulation.q == pytest.approx([x], rel=1e-12)
    _, _, (torque,) = simulation.model.drives(simulation.time, simulation.state, simulation.efforts)
    assert torque == pytest.approx(2 * 0.5 * 2.0 * x * rate, rel=1e-12)
    assert abs(simulation.energies.residual) < 1e-12


@pytest.mark.parametrize("drive", ["sqrt(t)", "t^1.5", "abs(t)^0.5"])
def test_a_drive_that_starts_with_an_infinite_velocity_or_acceleration_is_refused(drive):
    with pytest.raises(MechanismError, match=r"shaft.drive: the drive has no finite velocity or acceleration at t = 0"):
        Simulation.from_text(LIFT.replace("0.2*t^2 + 0.1*sin(3*t)", drive))
