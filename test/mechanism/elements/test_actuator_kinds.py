"""Every kind of actuator has all that the package needs to know of it: a new one fails here until it is complete."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.analysis.linear.outputs import ACTUATOR_UNITS
from mbd_sim.cli.mechanisms.convert import WRITERS
from mbd_sim.dynamics.actuators.functions import reading_names
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.kinematics.parameters import add_leaves
from mbd_sim.exports.c_code.model import export_model
from mbd_sim.files.schema.actuators import ActuatorSpec, AnyActuatorSpec
from mbd_sim.mechanism.elements.actuators import Machine
from mbd_sim.mechanism.elements.joint_types import Channel
from mbd_sim.studies.report.elements import actuator_report
from test.oracles import kane

ROOT = Path(__file__).parents[3]
CYLINDER = "areas: [4 cm^2, 3 cm^2], stroke: 1, retracted: -0.5, dead_volumes: [1e-5, 1e-5]"
KEYS = {
    "effort": "joint: rail, effort_limit: 50",
    "dc_motor": "joint: rail, lead: 20 mm, torque_constant: 0.5, resistance: 2, inductance: 0.01, voltage_limit: 24",
    "hydraulic_cylinder": f"joint: rail, {CYLINDER}, rated_flow: 20 L/min, supply: 150 bar",
    "pneumatic_cylinder": f"joint: rail, {CYLINDER}, conductance: 2e-8, supply: 7 bar",
}
FILE = """
mechanism: actuated
parts: {{cart: {{mass: 20, inertia: [1, 1, 1]}}}}
joints: {{rail: {{type: prismatic, between: [ground, cart], axis: [1, 0, 0], damping: 200}}}}
actuators: {{one: {{type: {type}, {keys}}}}}
"""
FREE = FILE.format(type="effort", keys=KEYS["effort"]).rpartition("actuators:")[0]


def actuated(kind):
    return parse_mechanism(FILE.format(type=kind, keys=KEYS[kind]))


def test_the_schema_the_records_and_these_tests_have_the_same_kinds():
    in_files = [get_args(spec.model_fields["type"].annotation)[0] for spec in get_args(get_args(AnyActuatorSpec)[0])]
    assert sorted(in_files) == sorted(KEYS)
    assert {type(actuated(kind).actuators[0].motor) for kind in KEYS} == set(get_args(Machine))


@pytest.mark.parametrize("kind", KEYS)
def test_its_account_of_energies_closes_while_it_is_commanded(kind):
    """A power that is left out of its account or of the mechanism's would be missing in one of the two."""
    simulation = Simulation(actuated(kind), step=1e-4)
    (actuator,) = simulation.mechanism.actuators
    for share in (0.5, -0.3):
        simulation.set_commands({"one": {actuator.control: share * min(actuator.output_limit, 20.0)}})
        simulation.run(until=simulation.time + 0.05)
    (state,) = simulation.actuators().values()
    accounts = [*vars_of(state.energies), *simulation.energies]
    assert np.all(np.isfinite(accounts)) and max(map(abs, accounts)) > 1e-3
    assert abs(state.energies.residual) < 1e-8 * max(map(abs, accounts))
    assert abs(simulation.energies.residual) < 1e-8 * max(map(abs, accounts))


@pytest.mark.parametrize("kind", KEYS)
def test_it_acts_as_in_kanes_equations(kind):
    """Its account would close with a wrong effort as well."""
    mechanism = actuated(kind)
    derived, rng = derive(mechanism), np.random.default_rng(3)
    ((actuator,), (slots,)) = mechanism.actuators, derived.actuator_layout.slots
    q, u, none = np.array([0.1]), np.array([0.7]), np.zeros(1)
    y, inputs = derived.start_state.copy(), derived.inputs_without_commands
    y[:2] = 0.1, 0.7
    states = {name: index for name, index in slots.states.items() if index in derived.actuator_layout.core}
    for index in states.values():
        y[index] += derived.scales[index] * rng.uniform(0.1, 1.0)
    inputs[slots.commands[actuator.control]] = 0.4 * min(actuator.output_limit, 20.0)
    commands = {channel: inputs[index] for channel, index in slots.commands.items()}
    driving = {"one": (commands, {name: y[index] for name, index in states.items()})}
    exact = kane.equations(mechanism, q, u, none, 0.0, driving).accelerations
    found = np.array(derived.rates.call([0.0, y, inputs])[0]).ravel()[1:2]
    read = dict(
        zip(reading_names(actuator.motor), np.array(derived.actuators.readings(0.0, y, inputs))[:, 0], strict=True)
    )
    assert (read.get("voltage", 0.0) != 0.0) == actuator.motor.electric
    free = kane.equations(parse_mechanism(FREE), q, u, none).accelerations
    assert abs(exact[0] - free[0]) > 1e-3
    np.testing.assert_allclose(found, exact, rtol=1e-12)


@pytest.mark.parametrize("kind", KEYS)
def test_only_commands_up_to_its_limit_have_an_effect(kind):
    derived = derive(actuated(kind))
    ((actuator,), (slots,)) = derived.mechanism.actuators, derived.actuator_layout.slots
    found = []
    for share in (0.9, 1.0, 1.5):
        inputs = derived.inputs_without_commands
        inputs[slots.commands[actuator.control]] = share * actuator.output_limit
        found.append(np.array(derived.rates.call([0.0, derived.start_state, inputs])[0]).ravel())
    np.testing.assert_array_equal(found[1], found[2])
    assert np.max(np.abs(found[1] - found[0])) > 1e-3


@pytest.mark.parametrize("kind", KEYS)
def test_its_numbers_can_be_live_values(kind):
    """All but the shape of its curve and what limits nothing."""
    (actuator,) = actuated(kind).actuators
    leaves: list = []
    add_leaves(actuator.motor, (), True, leaves)
    numbers = {path[0] for path, value, _ in leaves if isinstance(value, float)}
    fixed = {path[0] for path, value, live in leaves if not live and isinstance(value, float)}
    assert numbers and fixed <= {"regularization", "effort_range", "gain", "bias"}


def test_the_command_before_the_first_one_can_be_of_any_channel():
    (channels, _) = get_args(ActuatorSpec.model_fields["command"].annotation)
    assert set(get_args(channels)) == set(get_args(Channel))


def vars_of(record):
    return [getattr(record, name) for name in record.__dataclass_fields__]


@pytest.mark.parametrize("kind", KEYS)
def test_its_readings_have_units_and_it_is_reported_exported_and_described(kind):
    mechanism = actuated(kind)
    (actuator,) = mechanism.actuators
    assert set(reading_names(actuator.motor)) <= set(ACTUATOR_UNITS)
    assert all(state.unit for state in export_model(mechanism).states)
    report = actuator_report(actuator)
    assert (report["name"], report["type"]) == ("one", kind) and report["commands"] == list(actuator.channels)
    assert report["limits"]
    for write in WRITERS.values():
        found = write(mechanism)
        assert 'name="one"' in found.text or any("one" in sentence for sentence in found.left_out)
    assert f"`{kind}`" in (ROOT / "docs" / "mechanism_file.md").read_text(encoding="utf-8")
