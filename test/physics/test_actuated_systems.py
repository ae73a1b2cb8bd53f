"""The energy balance of every shipped mechanism with actuators or sensors, and of each actuator."""

import math

import pytest

from mbd_sim import Simulation
from mbd_sim.files.text.library import shipped

ACTUATED = [
    name
    for name, path in shipped().items()
    if any(f"\n{section}:" in path.read_text(encoding="utf-8") for section in ("actuators", "sensors"))
]
SIZES = {"velocity": 2.0, "effort": 0.5, "voltage": 6.0, "current": 1.0, "opening": 0.3}  # of commands, in SI units


def test_the_examples_are_among_them():
    examples = {"motor_drive", "six_axis_servo_arm", "balancing_pendulum", "hydraulic_scissor_lift", "engine", "rover"}
    assert examples <= set(ACTUATED)


@pytest.mark.parametrize("name", ACTUATED)
def test_the_residual_is_below_a_billionth_of_the_energy_exchanged(name):
    sim, exchanged, before = Simulation.from_file(name), 0.0, None
    start = {actuator: state.position for actuator, state in sim.actuators().items()}
    for count in range(10):
        commands = {}
        for number, actuator in enumerate(sim.mechanism.actuators):
            wave = math.sin(1.0 + count + number)
            commands[actuator.name] = {
                channel: start[actuator.name] + 0.1 * wave if channel == "position" else SIZES[channel] * wave
                for channel in actuator.channels
                if channel != "velocity" or actuator.servo.controls == "velocity"
            }
        sim.set_commands(commands)
        for _ in range(5):
            sim.run(until=sim.time + 0.02)
            now = sim.energies
            if before is not None:
                exchanged += sum(
                    abs(getattr(now, kind) - getattr(before, kind))
                    for kind in ("kinetic", "potential", "dissipated", "work_applied", "work_drives")
                )
            before = now
    assert exchanged > 0.01
    assert abs(sim.energies.residual) <= 1e-9 * exchanged
    for state in sim.actuators().values():
        account = state.energies
        supplied = account.fluid_work if hasattr(account, "fluid_work") else account.electrical_work
        assert abs(account.residual) <= 1e-9 * max(abs(supplied), exchanged)
