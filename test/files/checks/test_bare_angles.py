"""Angles without a unit that were probably meant in degrees are noted, wherever they are given."""

import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.files.checks.bare_angles import bare_angle_remarks
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import parse_mechanism

TEXT = """
mechanism: bare
parameters: {start: PARAMETER, n: 90}
parts:
  rod: {shape: {type: rod, to: [1, 0, 0], mass: 1}, points: {tip: [1, 0, 0]}}
  arm: {shape: {type: rod, to: [1, 0, 0], mass: 1}}
  cart: {mass: 1}
joints:
  hip: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: start}
  knee: {type: revolute, between: [rod.tip, arm], axis: [0, 1, 0], KNEE}
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], position: 90}
"""


def remarks(parameter="30 deg", knee="position: 1", **changes):
    mechanism = parse_mechanism(TEXT.replace("PARAMETER", parameter).replace("KNEE", knee))
    changes = {key.replace("__", "."): value for key, value in changes.items()}
    return bare_angle_remarks((with_values(mechanism, changes) if changes else mechanism).source)


@pytest.mark.parametrize(
    "knee",
    [
        "drive: 90",
        'drive: "90*sin(2*t)"',
        'drive: "45 + 30*cos(t)"',
        "drive: {command: position, bandwidth: 10, upper: 90}",
        "position: n",
        "position: -n",
        "rest: 45",
        "limits: {lower: -90, upper: 1, stiffness: 1}",
    ],
)
def test_an_angle_of_a_joint_or_its_drive_is_noted(knee):
    (found,) = remarks(knee=knee)
    assert found.startswith("joints.knee.") and "has no unit. Write" in found


@pytest.mark.parametrize(
    "knee", ["drive: 90 deg", 'drive: "90*t"', 'drive: "2*sin(90*t)"', 'drive: "${90*sin(2*t)} deg"', "velocity: 90"]
)
def test_what_can_be_meant_in_rad_is_not_noted(knee):
    assert remarks(knee=knee) == []


def test_changed_values_are_noted_also_where_the_file_has_none():
    assert remarks(joints__knee__rest=90.0) == [
        "joints.knee.rest is 90 rad (5157°), because it has no unit. Write 90 deg or 90 rad."
    ]
    assert remarks(joints__knee__rest="90 deg") == []
    of_the_parameter, of_its_use = remarks(start=45.0)
    assert of_the_parameter.startswith("parameters.start is 45 rad")
    assert of_its_use.startswith("joints.hip.position is 45 rad (2578°), because the parameter 'start' has no unit")


OPTIONS = {
    ("run", "--time", "1ms", "--quiet", "--start", "pin=90"): "joints.pin.position is 90 rad",
    ("run", "--time", "1ms", "--quiet", "--set", "joints.pin.rest=90"): "joints.pin.rest is 90 rad",
    ("sweep", "--time", "1ms", "--quiet", "--vary", "joints.pin.position=0:90:2"): "=0:90:2: 90 is in rad",
    ("modes", "--at", "start", "--quiet", "--vary", "joints.pin.position=0,90"): "=0,90: 90 is in rad",
    ("kinematics", "--drive", "pin=0:90"): "pin=0:90: 90 is in rad",
}


@pytest.mark.parametrize("options", OPTIONS, ids=[f"{options[0]} {options[-2]}" for options in OPTIONS])
def test_options_note_them(capsys, options):
    command, *rest = options
    assert main([command, "rod_pendulum", *rest]) == 0
    assert OPTIONS[options] in capsys.readouterr().out
    rest[-1] = rest[-1].replace("90", "90deg")
    assert main([command, "rod_pendulum", *rest]) == 0
    assert "is in rad" not in (printed := capsys.readouterr().out) and "has no unit" not in printed


def test_a_simulation_remarks_on_them():
    mechanism = parse_mechanism(TEXT.replace("PARAMETER", "1").replace("KNEE", "rest: 45"))
    assert any("joints.knee.rest is 45 rad" in remark for remark in Simulation(mechanism).remarks)
