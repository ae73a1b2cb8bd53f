"""What sliders change, in the units of the file."""

import numpy as np
import pytest
import yaml

from mbd_sim import parse_mechanism
from mbd_sim.files.checks.override import with_values
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.lab.session.sliders import as_yaml, settings_of

TEXT = """
mechanism: arm
parameters: {l: 800 mm, tilt: 30 deg, slack: 30 deg, twice: 2*l, e: 0.5}
ranges: {slack: [-0.25 rev, 60 deg]}
parts:
  arm: {shape: {type: rod, to: [l, 0, 0], mass: 2 kg}}
  tip: {shape: {type: rod, to: [twice, 0, 0], mass: 1 kg}}
joints:
  pin: {type: revolute, between: [ground, arm], axis: [0, -1, 0], position: tilt, damping: 20 mN*m*s/rad}
  elbow: {type: revolute, between: [arm, tip], axis: [0, -1, 0], stiffness: 3 N*m/rad, rest: slack, effort_limit: 7 N*m}
"""


@pytest.fixture(scope="module")
def bench():
    return Bench.of(parse_mechanism(TEXT))


@pytest.fixture(scope="module")
def settings(bench):
    return {one.key: one for one in settings_of(bench, 1.6)}


def test_values_have_the_units_of_the_file(settings):
    length, damping = settings["parameters.l"], settings["joints.pin.damping"]
    assert (length.value, length.unit, length.factor) == (800.0, "mm", 1e-3)
    assert (damping.value, damping.unit) == (20.0, "mN*m*s/rad")
    assert damping.factor == pytest.approx(1e-3)


def test_ranges_of_the_file_are_the_ends(bench, settings):
    slack, length = settings["parameters.slack"], settings["parameters.l"]
    assert (slack.low, slack.high, slack.unit) == (-90.0, 60.0, "deg")
    assert (length.low, length.high) == (200.0, 1600.0)
    changed = Bench.of(with_values(bench.simulation.mechanism, {"slack": "70 deg"}))
    slack = next(one for one in settings_of(changed, 1.6) if one.key == "parameters.slack")
    assert (slack.low, slack.value, slack.high) == (-90.0, 70.0, 70.0)


def test_values_that_follow_others_have_no_slider(settings):
    assert "parameters.twice" not in settings


def test_efforts_end_at_their_limits(settings):
    assert (settings["elbow"].low, settings["elbow"].high, settings["elbow"].unit) == (-7.0, 7.0, "N*m")


def test_every_value_lies_within_its_slider(settings):
    for one in settings.values():
        assert one.low <= one.value <= one.high, one
        assert one.low < one.high
        assert one.step > 0.0


def test_a_slider_changes_the_value_and_what_follows_it(bench, settings):
    session = OwnSession(bench, running=False)
    settings["parameters.l"].apply(session, 900.0)
    assert bench.values()["parameters.l"] == pytest.approx(0.9)
    assert bench.values()["parameters.twice"] == pytest.approx(1.8)
    settings["elbow"].apply(session, 5.0)
    assert bench.values()["elbow"] == 5.0


def test_the_yaml_is_what_the_file_needs(bench, settings):
    text = as_yaml(list(settings.values()), {"parameters.l": 900.0, "joints.pin.damping": 25.0, "gravity[2]": -1.62})
    changed = yaml.safe_load(text)
    assert changed["parameters"] == {"l": "900 mm"}
    assert changed["joints"] == {"pin": {"damping": "25 mN*m*s/rad"}}
    assert changed["gravity"][2] == -1.62
    assert len(changed["gravity"]) == 3
    again = with_values(bench.simulation.mechanism, {"gravity": changed["gravity"], "l": changed["parameters"]["l"]})
    assert again.gravity[2] == -1.62


def test_without_changes_the_yaml_says_so(settings):
    assert as_yaml(list(settings.values()), {}) == "# as in the file\n"


def test_a_formula_of_constants_has_a_slider_and_one_of_other_values_has_not():
    """As `w: 2*pi`, the speed of a prescribed drive; `e` is a parameter here, and `twice` a function of the file."""
    bench = Bench.of(
        parse_mechanism(
            """
mechanism: crank
parameters: {e: 3, w: 2*pi, a: "${3*pi} deg", follows: 2*w, named: 2*e, called: twice(2)}
functions: {twice(x): w*x}
parts:
  crank: {mass: 1 kg, center: [1, 0, 0]}
  rod: {mass: 1 kg, center: [1, 0, 0], inertia: [1, 1, 1]}
joints:
  drive: {type: revolute, between: [ground, crank], axis: [0, -1, 0], drive: a + w*t + follows + named + called + e}
  pin: {type: revolute, between: [crank, rod], axis: [0, -1, 0]}
"""
        )
    )
    settings = {one.label: one for one in settings_of(bench, 1.0) if one.group == "Parameters"}
    assert set(settings) == {"e", "w", "a"}
    assert settings["w"].value == pytest.approx(2.0 * np.pi, rel=1e-11)
    assert (settings["a"].unit, settings["a"].value) == ("deg", pytest.approx(3.0 * np.pi, rel=1e-11))
    shown = {one.key: bench.values()[one.key] / one.factor for one in settings.values()}
    assert as_yaml(list(settings.values()), shown) == "# as in the file\n"
    bench.simulation.set_live({"parameters.w": 7.0})
    shown["parameters.w"] = bench.values()["parameters.w"]
    assert as_yaml(list(settings.values()), shown) == "parameters:\n  w: 7.0\n"


SERVOS = """
mechanism: servos
parts:
  cart: {shape: {type: block, size: [0.3, 0.2, 0.1], mass: 1 kg}}
  arm: {shape: {type: rod, to: [0, 0, -0.8], mass: 0.2 kg}}
  wheel: {shape: {type: rod, to: [0.2, 0, 0], mass: 0.2 kg}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], damping: 0.1, limits: {lower: -2 m, upper: 1 m}}
  pin: {type: revolute, between: [cart, arm], axis: [0, -1, 0], limits: {lower: -90 deg, upper: 2}, velocity_limit: 90 deg/s}
  axle: {type: revolute, between: [cart, wheel], axis: [0, -1, 0], effort_limit: 3}
actuators:
  cart: {type: effort, joint: rail, effort_limit: 20 N, servo: {controls: position, kp: 20, kd: 2}}
  arm: {type: effort, joint: pin, servo: {controls: position, kp: 20}}
  wheel: {type: effort, joint: axle}
  volts: {type: dc_motor, joint: axle, torque_constant: 0.1, resistance: 1, voltage_limit: 12}
"""


def test_commands_have_the_units_and_the_limits_of_what_they_move():
    """A position on a rail once went from -pi to pi, without a unit."""
    bench = Bench.of(parse_mechanism(SERVOS))
    found = {one.key: one for one in settings_of(bench, 1.0) if one.kind == "command"}
    assert list(found) == list(bench.simulation.command_map.names)
    ends = {key: (one.unit, one.low, one.high) for key, one in found.items()}
    full = 14.0  # the weight in N
    assert ends == {
        "cart.position": ("m", -2.0, 1.0),
        "cart.velocity": ("m/s", -5.0, 5.0),
        "cart.effort": ("N", -20.0, 20.0),
        "arm.position": ("deg", -90.0, pytest.approx(np.degrees(2.0))),
        "arm.velocity": ("deg/s", -90.0, 90.0),
        "arm.effort": ("N*m", -0.5 * full + 0.1, 0.5 * full - 0.1),
        "wheel.effort": ("N*m", -3.0, 3.0),
        "volts.voltage": ("V", -12.0, 12.0),
    }
    session = OwnSession(bench, running=False)
    found["arm.position"].apply(session, 45.0)
    assert bench.values()["arm.position"] == pytest.approx(np.pi / 4, rel=1e-15)
    for speed in (8.0, -8.0):  # what others have commanded lies within its slider
        bench.simulation.set_commands({"cart": {"velocity": speed}})
        found = {one.key: one for one in settings_of(bench, 1.0)}["cart.velocity"]
        assert (found.low, found.high) == (min(-5.0, speed), max(5.0, speed))


def test_numbers_without_units_in_the_file_show_theirs_and_are_written_without():
    settings = settings_of(Bench.of(parse_mechanism(SERVOS)), 1.0)
    units = {one.key: one.unit for one in settings}
    assert (units["gravity[2]"], units["joints.rail.damping"]) == ("m/s^2", "N*s/m")
    assert (units["joints.pin.damping"], units["joints.pin.stiffness"]) == ("N*m*s/rad", "N*m/rad")
    assert as_yaml(settings, {"joints.rail.damping": 5.0}) == "joints:\n  rail:\n    damping: 5.0\n"


@pytest.mark.parametrize(("damping", "least"), [("0", 4.0), ("0.1", 4.0), ("30", 120.0)])
def test_the_damping_of_a_rail_reaches_that_of_a_well_damped_motion(damping, least):
    text = SERVOS.replace("damping: 0.1", f"damping: {damping}")
    (rail,) = (one for one in settings_of(Bench.of(parse_mechanism(text)), 1.0) if one.key == "joints.rail.damping")
    assert least <= rail.high <= 10.0 * least
