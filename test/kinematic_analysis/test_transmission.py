"""Transmission angles against the law of cosines."""

import numpy as np
import pytest

from mbd_sim import InputError, load_mechanism
from mbd_sim.kinematic_analysis import CouplerAndFollower, couplers_and_followers, driven_motion, transmission_extremes
from mbd_sim.kinematic_analysis.transmission import TransmissionAngle, coupler_and_follower
from test.kinematic_analysis.linkages import four_bar

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
