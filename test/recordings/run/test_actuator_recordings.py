"""Recordings of mechanisms with actuators: commands are recorded, and runs are recomputed bit for bit."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recomputation import Recomputation, RecomputeError
from mbd_sim.recordings.run.verification import verify

ARM = """
mechanism: arm
parts:
  upper: {mass: 1, center: [0, 0, -0.3], inertia: [0.02, 0.03, 0.01], points: {end: [0, 0, -0.6]}}
  lower: {mass: 0.7, center: [0, 0, -0.2], inertia: [0.01, 0.02, 0.01]}
joints:
  hip: {type: revolute, between: [ground, upper], axis: [0, -1, 0], position: 0.4}
  knee: {type: revolute, between: [upper.end, lower], axis: [0, -1, 0], position: 0.7}
integrator: {method: rk4, step: 1 ms}
actuators:
  hip_drive:
    type: dc_motor
    joint: hip
    torque_constant: 0.1
    resistance: 1
    inductance: 2 mH
    gear_ratio: 30
    voltage_limit: 48
    delay: 4 ms
    servo: {controls: position, kp: 100, ki: 50, kd: 3, sample_rate: 200 Hz, rate_limit: 3}
  knee_motor: {type: effort, joint: knee, effort_limit: 20}
"""


def commanded(simulation):
    simulation.set_commands({"hip_drive": 1.0, "knee_motor": -1.0})
    simulation.run(until=simulation.time + 0.1)
    simulation.set_commands({"hip_drive": {"position": 0.5, "velocity": 0.1}})
    simulation.set_commands({"hip_drive": {"position": 0.5, "velocity": 0.1}})  # repeated: no message
    simulation.run(until=simulation.time + 0.1)


def test_commands_are_recorded_with_their_names_and_the_run_verifies(tmp_path):
    simulation, path = Simulation.from_text(ARM), tmp_path / "run.mcap"
    with simulation.recording(path, rate=100.0):
        commanded(simulation)
        simulation.reset()
        commanded(simulation)
    messages = [m for m in open_recording(path).messages() if m.topic.endswith("applied_commands")]
    labels, values = cdr.multi_array(messages[1].payload)
    assert labels == ("hip_drive.position", "hip_drive.velocity", "knee_motor.effort")
    assert len(messages) == 4 and np.array_equal(values, [0.5, 0.1, -1.0])
    (verification,) = verify(path)
    assert verification.is_intact and verification.agrees and verification.commands["applied_commands"] == 4


def test_a_recording_that_begins_between_samples_and_delayed_commands_verifies(tmp_path):
    simulation, path = Simulation.from_text(ARM), tmp_path / "run.mcap"
    commanded(simulation)
    simulation.set_commands({"hip_drive": -0.3})
    simulation.step(3)
    with simulation.recording(path, rate=100.0):
        commanded(simulation)
    (verification,) = verify(path)
    assert verification.is_intact and verification.agrees and verification.commands["applied_commands"] == 2
    with pytest.raises(RecomputeError, match=r"delayed commands of actuators.*Keep the step"):
        Recomputation(open_recording(path).files[0], step=5e-4)
    changed = Recomputation(open_recording(path).files[0], changes={"actuators.hip_drive.servo.kp": 80})
    assert changed.simulation.steps == 203
    continued = Simulation.from_text(ARM)
    continued.restore(simulation.snapshot())
    assert np.array_equal(continued.state, simulation.state)
