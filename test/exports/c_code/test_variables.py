"""The numbers of an exported model: each has the unit that C code and FMUs name."""

import pytest

from mbd_sim import parse_mechanism
from mbd_sim.exports.c_code.model import export_model
from mbd_sim.exports.fmu.archive import model_description

FILE = """
mechanism: actuated
integrator: {{step: 1 ms}}
parts: {{cart: {{mass: 20, inertia: [1, 1, 1]}}}}
joints: {{pin: {{type: {joint}, between: [ground, cart], axis: [1, 0, 0]}}}}
actuators: {{one: {{joint: pin, {keys}}}}}
"""
SAMPLED = "servo: {controls: position, kp: 50, ki: 10, kd: 1, sample_rate: 500 Hz, rate_limit: 3}, delay: 2 ms"
SPEED = "servo: {controls: velocity, kp: 5, ki: 10, kd: 1, sample_rate: 500 Hz}, delay: 2 ms"
VOLTAGE = "type: dc_motor, torque_constant: 0.5, resistance: 2, inductance: 0.01, voltage_limit: 24, damping: 0.1"
CURRENT = "type: dc_motor, torque_constant: 0.5, resistance: 2, control: current, current_limit: 5, damping: 0.1"
ACCOUNT = dict.fromkeys(("electrical_work", "mechanical_work", "copper_loss", "friction_loss"), "J")
CYLINDER = (
    "type: hydraulic_cylinder, areas: [4 cm^2, 3 cm^2], stroke: 1, retracted: -0.5, dead_volumes: [1e-5, 1e-5], "
    "rated_flow: 20 L/min, supply: 150 bar"
)
CASES = {
    "a sampled and delayed position servo of a voltage": (
        "revolute",
        f"{VOLTAGE}, {SAMPLED}",
        ACCOUNT
        | {"current": "A", "position": "rad", "velocity": "rad/s", "reference": "rad", "integral": "V", "output": "V"}
        | {
            f"{name}.waiting{place}": unit
            for name, unit in (("position", "rad"), ("velocity", "rad/s"))
            for place in (0, 1)
        },
    ),
    "a sampled speed servo of a current": (
        "revolute",
        f"{CURRENT}, {SPEED}",
        ACCOUNT
        | {"velocity": "rad/s", "integral": "A", "error": "rad/s", "output": "A"}
        | {"velocity.waiting0": "rad/s", "velocity.waiting1": "rad/s"},
    ),
    "a delayed voltage": (
        "revolute",
        f"{VOLTAGE}, delay: 1 ms",
        ACCOUNT | {"current": "A", "voltage": "V", "voltage.waiting0": "V"},
    ),
    "a continuous servo of a force": (
        "prismatic",
        "type: effort, effort_limit: 50, servo: {controls: position, kp: 50, ki: 10}",
        {"integral": "N", "mechanical_work": "J"},
    ),
    "a delayed valve": (
        "prismatic",
        f"{CYLINDER}, delay: 1 ms",
        {"pressure_a": "Pa", "pressure_b": "Pa", "opening": "1", "opening.waiting0": "1"}
        | dict.fromkeys(("fluid_work", "mechanical_work", "compression_work", "stored_at_start"), "J"),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_each_state_of_an_actuator_has_its_unit(case):
    """A state without a unit would be one of an unknown quantity in another tool."""
    joint, keys, units = CASES[case]
    model = export_model(parse_mechanism(FILE.format(joint=joint, keys=keys)))
    found = {state.name.removeprefix("one.").removesuffix(".state"): state.unit for state in model.states}
    names = [name for name in found if f"one.{name}.state" in {state.name for state in model.states}]
    assert {name: found[name] for name in names} == units
    description = model_description(model, "token")
    for unit in set(units.values()) - {"1"}:
        assert f'<Unit name="{unit}">' in description
