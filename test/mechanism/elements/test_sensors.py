"""Every kind of sensor has all that the package needs to know of it: a new one fails here until it is complete."""

from pathlib import Path
from typing import get_args
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.measurements import measured_values
from mbd_sim.files.checks import problems
from mbd_sim.files.schema.sensors import AnySensorSpec
from mbd_sim.mechanism.elements.sensors import ORIENTATION, AnySensor
from mbd_sim.recordings.messages.cdr import RecordedTopic, decode
from mbd_sim.recordings.messages.topics import SensorSerializer
from mbd_sim.recordings.views import sensor_columns
from mbd_sim.studies.report.elements import sensor_report
from mbd_sim.studies.symbolic import latex_elements

ROOT = Path(__file__).parents[3]
KEYS = {
    "imu": "at: rod, orientation: {bias: 0.1}",
    "accelerometer": "at: rod",
    "force_torque": "joint: hinge",
    "encoder": "joint: hinge, counts: 64",
    "tachometer": "joint: hinge",
    "current": "actuator: motor",
    "range": "at: rod, most: 20, plane: ground.floor",
    "pose": "at: rod",
    "twist": "at: rod",
    "odometry": "at: rod",
}
FILE = """
mechanism: sensed
ground: {{points: {{floor: [0, 0, -4]}}}}
parts: {{rod: {{mass: 2, inertia: [0.1, 0.2, 0.3]}}}}
joints: {{hinge: {{type: revolute, between: [ground, rod], axis: [0, 1, 0]}}}}
actuators: {{motor: {{type: dc_motor, joint: hinge, torque_constant: 1, resistance: 2}}}}
sensors: {{one: {{type: {type}, {keys}}}}}
"""


def sensed(kind):
    return parse_mechanism(FILE.format(type=kind, keys=KEYS[kind]))


def test_the_schema_the_records_and_these_tests_have_the_same_kinds():
    in_files = [get_args(spec.model_fields["type"].annotation)[0] for spec in get_args(get_args(AnySensorSpec)[0])]
    assert sorted(in_files) == sorted(KEYS) == sorted(kind.kind for kind in get_args(AnySensor))


@pytest.mark.parametrize("kind", KEYS)
def test_its_values_are_those_of_its_quantities(kind):
    """A sensor whose expression has other numbers than its quantities would shift all that follow."""
    mechanism = sensed(kind)
    (sensor,), derived = mechanism.sensors, derive(mechanism)
    exact = derived.measurements.sensors(derived.actuators)["one"].sx_out()[0]
    sizes = [9 if quantity is ORIENTATION else len(quantity.components) for quantity in sensor.quantities]
    assert measured_values(sensor, exact).numel() == sum(sizes)
    assert len(sensor.errors) == len(sensor.quantities)


ANGLE, SPEED, VOLTAGE = 0.3, -1.2, 3.0
AXES = rot.about([0.0, 1.0, 0.0], ANGLE)
UPWARD = AXES.T @ [0.0, 0.0, 9.81]  # the specific force at rest, in the axes of the rod
CURRENT = (VOLTAGE - SPEED) / 2.0
OMEGA = [0.0, SPEED, 0.0]
EXACT = {  # with the turning rod's origin in that of ground; its own torque of inertia is what the motor exerts
    "imu": [*OMEGA, *UPWARD, *AXES.ravel(order="F")],
    "accelerometer": UPWARD,
    "force_torque": [*(2.0 * UPWARD), 0.0, CURRENT, 0.0],
    "encoder": [ANGLE],
    "tachometer": [SPEED],
    "current": [CURRENT],
    "range": [4.0 / np.sin(ANGLE)],
    "pose": [0.0, 0.0, 0.0, *AXES.ravel(order="F")],
    "twist": [0.0, 0.0, 0.0, *OMEGA],
    "odometry": [0.0, 0.0, 0.0, *AXES.ravel(order="F"), 0.0, 0.0, 0.0, *OMEGA],
}


@pytest.mark.parametrize("kind", KEYS)
def test_its_exact_values_have_their_closed_form(kind):
    mechanism = sensed(kind)
    (sensor,), derived = mechanism.sensors, derive(mechanism)
    function = derived.measurements.sensors(derived.actuators)["one"]
    arguments = function.sx_in()
    found = ca.Function("measured", arguments, [measured_values(sensor, function.call(arguments)[0])])
    y, inputs = derived.start_state.copy(), derived.inputs_without_commands
    y[:2] = ANGLE, SPEED
    inputs[derived.inputs.commands] = VOLTAGE
    np.testing.assert_allclose(np.array(found(0.0, y, inputs)).ravel(), EXACT[kind], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kind", KEYS)
def test_its_messages_can_be_read_from_recordings(kind):
    (sensor,) = sensed(kind).sensors
    assert sensor.message_type in sensor_columns._READERS
    assert {quantity.name for quantity in sensor.quantities} <= set(sensor_columns._UNITS)
    assert {len(quantity.components) for quantity in sensor.quantities} <= {1, 3}  # plots and tables know these


@pytest.mark.parametrize("kind", KEYS)
def test_its_message_contains_what_it_measures(kind):
    """Fields in another order or number than those of the type would be read as other quantities."""
    simulation = Simulation(sensed(kind))
    simulation.step(5)
    (measured,) = SensorSerializer(simulation.model, simulation.step_size).measured(simulation.arrivals, 10**9)
    message_type = simulation.mechanism.sensors[0].message_type
    message = decode(RecordedTopic(measured.topic, message_type, "", "", "cdr", 1), measured.payload)
    found, values = sensor_columns._READERS[message_type](message), measured.reading.values
    for name, value in values.items():
        value = value[[1, 2, 3, 0]] if len(value) == 4 else value  # of quaternions, w is the last in ROS
        np.testing.assert_allclose(found[name], value, rtol=1e-7, err_msg=name)  # a distance has single precision


@pytest.mark.parametrize("kind", KEYS)
def test_its_quantities_have_letters_in_formulas(kind):
    (sensor,) = sensed(kind).sensors
    assert {quantity.name for quantity in sensor.quantities} <= set(latex_elements.LETTERS)


@pytest.mark.parametrize("kind", KEYS)
def test_the_package_depends_on_its_messages(kind):
    (sensor,) = sensed(kind).sensors
    packages = {element.text for element in ElementTree.parse(ROOT / "package.xml").iter("exec_depend")}
    assert sensor.message_type.partition("/")[0] in packages


@pytest.mark.parametrize("kind", KEYS)
def test_the_report_names_it(kind):
    (sensor,) = sensed(kind).sensors
    assert sensor_report(sensor, 0.001)["type"] == kind


@pytest.mark.parametrize("kind", KEYS)
def test_the_advice_about_at_and_joint_names_it(kind):
    (spec,) = (
        one for one in get_args(get_args(AnySensorSpec)[0]) if get_args(one.model_fields["type"].annotation)[0] == kind
    )
    advice = {"at": problems._OF_A_JOINT, "joint": problems._AT_A_POINT}
    assert all(kind in text for key, text in advice.items() if key in spec.model_fields)


def test_the_advice_about_errors_knows_each_quantity_with_errors_of_its_own():
    specs = get_args(get_args(AnySensorSpec)[0])
    errors = {
        name for one in specs for name, field in one.model_fields.items() if "ErrorsSpec" in str(field.annotation)
    }
    assert errors and errors <= set(problems._QUANTITIES)


@pytest.mark.parametrize("kind", KEYS)
def test_the_page_of_the_node_describes_its_message(kind):
    page = (ROOT / "docs" / "node.md").read_text(encoding="utf-8")
    rows = [line for line in page.partition("### Sensors")[2].partition("\n#")[0].splitlines() if line.startswith("|")]
    ((_, _, message, *_),) = ([*row.split("|")] for row in rows if f"`{kind}`" in row.split("|")[1])
    assert message.strip() == sensed(kind).sensors[0].message_type.replace("/msg/", "/")


@pytest.mark.parametrize("kind", KEYS)
def test_the_reference_page_describes_it(kind):
    assert f"`{kind}`" in (ROOT / "docs" / "mechanism_file.md").read_text(encoding="utf-8")
