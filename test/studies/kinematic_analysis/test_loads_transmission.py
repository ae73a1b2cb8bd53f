"""Transmission angles against the law of cosines."""

import numpy as np
import pytest

from mbd_sim import InputError, load_mechanism, parse_mechanism
from mbd_sim.studies.kinematic_analysis import (
    CouplerAndFollower,
    couplers_and_followers,
    driven_motion,
    transmission_extremes,
)
from mbd_sim.studies.kinematic_analysis.loads import TransmissionAngle, coupler_and_follower
from test.studies.kinematic_analysis.linkages import FOUR_BAR, four_bar

TURN = 2.0 * np.pi
JOINTS = CouplerAndFollower("pin", "rocker_pin", "pivot")


def test_of_a_four_bar_it_is_the_angle_between_coupler_and_rocker():
    motion = driven_motion(four_bar(), {"motor": (0.1, 0.1 + TURN)}, 32)
    assert couplers_and_followers(motion.mechanism, ["motor"]) == (JOINTS,)
    reach = np.abs(1.5 - 0.5 * np.exp(1j * motion.drive))
    between = np.arccos((1.4**2 + 1.2**2 - reach**2) / (2 * 1.4 * 1.2))
    angle = TransmissionAngle(motion.system, JOINTS)
    assert [angle(q) for q in motion.q] == pytest.approx(np.minimum(between, np.pi - between), abs=1e-13)
    least, most = transmission_extremes(motion, JOINTS)  # least where the crank is in line with the pivots
    assert least.value == pytest.approx(np.arccos((1.4**2 + 1.2**2 - 1.0**2) / (2 * 1.4 * 1.2)), abs=1e-13)
    assert np.sin(least.drive) == pytest.approx(0.0, abs=1e-7)
    assert most.value == pytest.approx(np.pi / 2, abs=1e-10)


def test_of_a_slider_crank_it_is_the_angle_between_coupler_and_normal():
    motion = driven_motion(load_mechanism("slider_crank"), {"pivot": (0.0, TURN)}, 25)
    (joints,) = couplers_and_followers(motion.mechanism, ["pivot"])
    assert joints == CouplerAndFollower("crank_pin", "slider_pin", "guide")
    angle = TransmissionAngle(motion.system, joints)
    expected = np.pi / 2 - np.abs(np.arcsin(0.2 / 0.6 * np.sin(motion.drive)))
    assert [angle(q) for q in motion.q] == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pinn", "there is no joint 'pinn'"),
        ("pin", "are not evident. Write COUPLER,pin,FOLLOWER .* evident are those of rocker_pin"),
        ("pin,rocker_pin", "names 2 joints"),
    ],
)
def test_pins_that_do_not_define_an_angle(text, message):
    with pytest.raises(InputError, match=message):
        coupler_and_follower(four_bar(), ["motor"], text)


def test_joints_named_by_the_user():
    assert coupler_and_follower(four_bar(), ["motor"], "pin, rocker_pin, pivot") == JOINTS
    assert couplers_and_followers(four_bar(), ["pivot"]) == (CouplerAndFollower("rocker_pin", "pin", "motor"),)


def test_at_the_dead_points_of_a_rocker_it_vanishes():
    """Of two linkages: between the row of a dead point and the next one, the search came too near to it in some."""
    for coupler in (1.3, 1.6):
        motion = driven_motion(four_bar(b=coupler), {"pivot": (0.0, TURN)}, 25, dead_points="follow")
        least, most = transmission_extremes(motion, CouplerAndFollower("rocker_pin", "pin", "motor"))
        assert [one.kind for one in motion.singular] == ["dead point"] * 2
        assert least.value < 1e-10 and most.value == pytest.approx(np.pi / 2, abs=1e-10)


QUICK_RETURN = """
mechanism: quick_return
ground: {{points: {{below: [0, -2, -0.1]}}}}
parts:
  crank: {{mass: 1, inertia: [1, 1, 1], points: {{tip: [0.5, 0, 0]}}}}
  block: {{mass: 0.2, inertia: [1, 1, 1], points: {{center: [0.01, 0.02, 0.1]}}}}
  lever: {{mass: 1, inertia: [1, 1, 1]}}
joints:
  motor: {{type: revolute, between: [ground, crank], axis: [0, 0, 1], position: 30 deg}}
  pin: {{type: revolute, between: [crank.tip, block.center], axis: [0, 0, 1], cut: true}}
  slide: {{type: prismatic, between: {order}, axis: [0, 1, 0], position: {start}, guess: true}}
  pivot: {{type: revolute, between: [ground.below, lever], axis: [0, 0, 1]}}
"""


@pytest.mark.parametrize(("order", "start"), [("[lever, block]", 2.0), ("[block, lever]", -2.0)])
def test_a_block_moves_a_slotted_lever_normal_to_its_slot(order, start):
    """A slot through the pivot: the force of the block is always normal to the lever's radius, so the angle is 90°.

    The line from the block's pin to the slide has no length: the angle was 0.
    """
    text = QUICK_RETURN.format(order=order, start=start)
    text = text.replace("[0.01, 0.02, 0.1]", "[0, 0, 0.1]")
    motion = driven_motion(parse_mechanism(text), {"motor": (0.5, 0.5 + TURN)}, 9)
    (joints,) = couplers_and_followers(motion.mechanism, ["motor"])
    assert joints == CouplerAndFollower("pin", "slide", "pivot")
    angle = TransmissionAngle(motion.system, joints)
    assert [angle(q) for q in motion.q] == pytest.approx(np.full(9, np.pi / 2), abs=1e-12)


def test_a_slot_beside_the_pivot_has_the_angle_whose_sine_is_lever_arm_over_distance():
    """The slot passes the pivot at a distance e: sin of the pressure angle is e over the distance of pin and pivot."""
    text = QUICK_RETURN.format(order="[lever, block]", start=2.0)
    motion = driven_motion(parse_mechanism(text.replace("0.01, 0.02", "0.3, 0.02")), {"motor": (0.5, 3.0)}, 9)
    (joints,) = couplers_and_followers(motion.mechanism, ["motor"])
    angle = TransmissionAngle(motion.system, joints)
    distance = np.abs(0.5 * np.exp(1j * motion.drive) + 2j)
    assert [angle(q) for q in motion.q] == pytest.approx(np.pi / 2 - np.arcsin(0.3 / distance), abs=1e-12)


def scotch_yoke(tilt):
    """A yoke with a slot inclined by `tilt` against the normal of its guide."""
    return parse_mechanism(f"""
mechanism: scotch_yoke
parts:
  crank: {{mass: 1, inertia: [1, 1, 1], points: {{tip: [0.5, 0, 0]}}}}
  block: {{mass: 0.2, inertia: [1, 1, 1]}}
  yoke: {{mass: 1, inertia: [1, 1, 1]}}
joints:
  motor: {{type: revolute, between: [ground, crank], axis: [0, 0, 1], position: 30 deg}}
  pin: {{type: revolute, between: [crank.tip, block], axis: [0, 0, 1], cut: true}}
  slot: {{type: prismatic, between: [yoke, block], axis: [{np.sin(tilt)}, {np.cos(tilt)}, 0]}}
  guide: {{type: prismatic, between: [ground, yoke], axis: [1, 0, 0]}}
""")


@pytest.mark.parametrize("tilt", [0.0, 0.4, -1.1])
def test_the_slot_of_a_yoke_and_its_guide_enclose_the_angle(tilt):
    motion = driven_motion(scotch_yoke(tilt), {"motor": (0.0, TURN)}, 9)
    (joints,) = couplers_and_followers(motion.mechanism, ["motor"])
    assert joints == CouplerAndFollower("pin", "slot", "guide")
    assert TransmissionAngle(motion.system, joints)(motion.q[3]) == pytest.approx(np.pi / 2 - abs(tilt), abs=1e-12)


def test_it_is_the_power_that_a_unit_force_of_the_coupler_gives_the_follower():
    """By virtual power, independently of the direction of the slide: the block's reaction over its force at the pin."""
    motion = driven_motion(scotch_yoke(0.4), {"motor": (0.3, 1.3)}, 5)
    yoke, pin = motion.ratio("guide"), 0.5 * np.array([-np.sin(motion.drive), np.cos(motion.drive)])
    normal = np.array([np.cos(0.4), -np.sin(0.4)])  # of the slot: the direction of the force
    assert normal @ pin == pytest.approx(normal[0] * yoke, abs=1e-12)
    angle = TransmissionAngle(motion.system, CouplerAndFollower("pin", "slot", "guide"))
    assert np.sin(angle(motion.q[2])) == pytest.approx(abs(normal @ pin)[2] / abs(yoke[2]), abs=1e-12)


def test_pins_in_planes_one_behind_the_other():
    """Layers of a linkage along the axes of its pins do not change the angle."""
    text = FOUR_BAR.format(a=0.5, b=1.4, c=1.2, d=1.5, start=60, guess=-20)
    layered = text.replace("tip: [b, 0, 0]", "tip: [b, 0, 0.8]").replace("tip: [c, 0, 0]}}", "tip: [c, 0, 0.8]}}")
    layered = layered.replace("tip: [c, 0, 0]", "tip: [c, 0, 0.8]")
    ends = [driven_motion(parse_mechanism(one), {"motor": (0.1, 2.0)}, 5) for one in (text, layered)]
    plane, other = ([TransmissionAngle(one.system, JOINTS)(q) for q in one.q] for one in ends)
    assert other == pytest.approx(plane, abs=1e-12)


def test_couplers_that_transmit_moments_have_no_transmission_angle():
    """Those of spatial linkages with revolute joints, and between universal joints: the angle was 0 there."""
    assert couplers_and_followers(load_mechanism("driveline"), ["input_bearing"]) == ()
    assert couplers_and_followers(load_mechanism("bennett"), ["t1"]) == ()
    with pytest.raises(InputError, match="between two universal joints, a coupler transmits a moment"):
        coupler_and_follower(load_mechanism("driveline"), ["input_bearing"], "first_cross,second_cross,output_bearing")
