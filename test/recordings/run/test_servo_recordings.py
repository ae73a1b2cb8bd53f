"""Recordings with gains that can change verify: the tracking time of a servo without an integral is infinite."""

import math

import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.analysis.equilibria.equilibrium import equilibria
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.recordings.run.verification import verify
from test.recordings.runs import stepped_node

CART = """
mechanism: cart
parameters: {kp: 20, kd: 2}
parts:
  cart: {mass: 1, inertia: [1, 1, 1]}
  pendulum: {shape: {type: rod, to: [0, 0, -0.8]}, mass: 0.2}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], damping: 0.1}
  pin: {type: revolute, between: [cart, pendulum], axis: [0, -1, 0], position: 0.1}
integrator: {step: 2 ms}
actuators:
"""
EFFORT = "type: effort, joint: rail, effort_limit: 20"
DC = "type: dc_motor, joint: pin, torque_constant: 0.1, resistance: 1, gear_ratio: 5"
DAMPING = "joints.rail.damping"
SERVOS = {
    "position": f"{{{EFFORT}, servo: {{controls: position, kp: kp, kd: kd}}}}",
    "position, sampled": f"{{{EFFORT}, delay: 4 ms, servo: {{controls: position, kp: kp, kd: kd, sample_rate: 50}}}}",
    "velocity, integral": f"{{{EFFORT}, servo: {{controls: velocity, kp: kp, ki: 3}}}}",
    "velocity, feedforward, rate limit": f"{{{EFFORT}, servo: {{controls: velocity, kp: kp, velocity_feedforward: 0.5, rate_limit: 2}}}}",
    "voltage": f"{{{DC}, voltage_limit: 12, inductance: 2 mH, servo: {{controls: position, kp: kp, kd: kd}}}}",
    "current": f"{{{DC}, control: current, current_limit: 5, servo: {{controls: position, kp: kp}}}}",
    "no servo": f"{{{EFFORT}}}",
}


def text_of(name):
    return f"{CART}  motor: {SERVOS[name]}\n"


def live_of(name):
    return ["parameters.*", DAMPING, *(["actuators.*.servo.k*"] if "servo:" in SERVOS[name] else [])]


def changed(simulation):
    """Other gains, where there are any, and another damping."""
    return {key: 1.1 * simulation.live[key] for key in (DAMPING, "parameters.kp") if key in simulation.live}


def require_verified(path, commands):
    (verification,) = verify(path)
    assert verification.is_intact
    assert verification.agrees
    assert verification.commands.get("applied_commands", 0) == commands


# the first, whose tracking time is infinite, in a script, in the lab and in a node
@pytest.mark.parametrize("name", ["position", "velocity, integral", "voltage", "no servo"])
def test_a_script_with_live_gains(name, tmp_path):
    simulation = Simulation.from_text(text_of(name), live=live_of(name))
    for path in (tmp_path / "fresh.mcap", tmp_path / "middle.mcap"):
        with simulation.recording(path, rate=100.0):
            simulation.step(10)
            simulation.set_commands({"motor": 0.2 + simulation.time})
            simulation.set_live(changed(simulation))
            simulation.step(20)
        require_verified(path, 1)


@pytest.mark.parametrize("name", ["position", "position, sampled", "velocity, feedforward, rate limit", "current"])
def test_a_lab(name, tmp_path):
    """It lets all gains change, and restores states within a recording when it is wound back."""
    session = OwnSession(Bench.of(parse_mechanism(text_of(name))), running=False)
    channel = session.bench.simulation.command_map.names[0]
    for path in (tmp_path / "fresh.mcap", tmp_path / "middle.mcap"):
        session.record(path)
        session.step(20)
        session.set_command(channel, 0.2 + session.bench.simulation.time)
        for key, value in changed(session.bench.simulation).items():
            session.change(key, value)
        session.step(20)
        session.step_back()
        session.step(5)
        session.end_recording()
        (verification,) = verify(path)
        assert verification.is_intact
        assert verification.agrees


def test_a_node_with_live_gains(tmp_path):
    file = tmp_path / "cart.yaml"
    file.write_text(text_of("position"))
    with stepped_node(tmp_path, str(file), live=f"'{', '.join(live_of('position'))}'") as node:
        node.stepping_thread.step(30)
        path = node.publishing_thread.recorder.path
    require_verified(path, 0)


def test_other_inputs_that_are_infinite_are_refused():
    simulation = Simulation.from_text(text_of("position"), live=live_of("position"))
    layout = simulation.model.input_layout
    assert math.isinf(max(simulation.inputs[layout.values]))
    for place, wrong in ((layout.efforts.start, math.inf), (layout.values.start, math.nan)):
        inputs = simulation.inputs.copy()
        inputs[place] = wrong
        with pytest.raises(ValueError, match="inputs contains a value that is not finite"):
            simulation.restore(simulation.state, 0, inputs)


def test_equilibria_are_found_while_gains_can_change():
    simulation = Simulation.from_text(text_of("position"), live=live_of("position"))
    found = equilibria(simulation.model.equations, simulation.inputs)
    assert sorted(abs(rest.q[1]) for rest in found) == pytest.approx([0.0, math.pi], abs=1e-9)
