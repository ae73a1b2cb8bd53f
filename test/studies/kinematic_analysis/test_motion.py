"""Positions, velocities and accelerations against closed forms, and what ends a range."""

import numpy as np
import pytest

from mbd_sim import InputError, MechanismError, load_mechanism, parse_mechanism
from mbd_sim.studies.kinematic_analysis import UnreachableError, driven_motion, limit_positions, reachable_range
from test.studies.kinematic_analysis.linkages import few_starts, four_bar, rocker_angles, tracer

TURN = 2.0 * np.pi
SPEED = 3.0


@pytest.fixture(scope="module")
def motion():
    return driven_motion(four_bar(), {"motor": (0.0, TURN)}, 73, speed=SPEED)


def test_the_rocker_of_a_four_bar_moves_as_freudenstein_says(motion):
    phi, velocity, acceleration = rocker_angles(motion.drive)
    found = motion.coordinate("pivot")
    assert np.max(np.abs(found[0] - phi)) < 1e-13
    assert np.max(np.abs(found[1] - SPEED * velocity)) < 1e-12
    assert np.max(np.abs(found[2] - SPEED**2 * acceleration)) < 1e-11
    assert motion.time[-1] == pytest.approx(TURN / SPEED, rel=1e-14)


def test_a_point_of_the_coupler_follows_its_curve(motion):
    point = motion.point("coupler.tracer")
    path = point.position[:, 0] + 1j * point.position[:, 1]
    assert np.max(np.abs(path - tracer(motion.drive))) < 1e-13
    h = 1e-4
    shifted = [tracer(motion.drive + k * h) for k in (-2, -1, 1, 2)]
    velocity = (shifted[0] - 8 * shifted[1] + 8 * shifted[2] - shifted[3]) / (12 * h)
    assert np.max(np.abs(point.velocity @ [1, 1j, 0] - SPEED * velocity)) < 1e-10
    bend = (-shifted[0] + 16 * shifted[1] - 30 * tracer(motion.drive) + 16 * shifted[2] - shifted[3]) / (12 * h**2)
    assert np.max(np.abs(point.acceleration @ [1, 1j, 0] - SPEED**2 * bend)) < 1e-5  # by differences


def test_limit_positions_are_where_crank_and_coupler_are_in_line(motion):
    least, greatest = sorted(limit_positions(motion, "pivot"), key=lambda one: one.value)
    assert (least.greatest, greatest.greatest) == (False, True)
    for limit, reach in ((least, 1.4 + 0.5), (greatest, 1.4 - 0.5)):
        angle = np.pi - np.arccos((1.2**2 + 1.5**2 - reach**2) / (2 * 1.2 * 1.5))
        assert limit.value == pytest.approx(angle, abs=1e-10)
        at = np.arccos((reach**2 + 1.5**2 - 1.2**2) / (2 * reach * 1.5))
        assert limit.drive == pytest.approx(at if reach > 1.4 else np.pi + at, abs=1e-10)


def test_the_mechanical_advantage_is_the_ratio_of_speeds(motion):
    assert np.max(np.abs(1.0 / motion.advantage("pivot") - rocker_angles(motion.drive)[1])) < 1e-12
    backward = driven_motion(four_bar(), {"motor": (TURN, 0.0)}, 73)
    assert np.max(np.abs(1.0 / backward.advantage("pivot")[::-1] - rocker_angles(motion.drive)[1])) < 1e-12


def test_a_slider_crank_moves_as_its_closed_form():
    """The guide closes the loop; r = 0.2 m, l = 0.6 m."""
    motion = driven_motion(load_mechanism("slider_crank"), {"pivot": (0.0, TURN)}, 37, speed=10.0)
    slider = motion.point("slider")
    angle, r, rod = motion.drive, 0.2, 0.6
    root = np.sqrt(rod**2 - (r * np.sin(angle)) ** 2)
    slope = -r * np.sin(angle) - r**2 * np.sin(2 * angle) / (2 * root)
    bend = -r * np.cos(angle) - r**2 * np.cos(2 * angle) / root - r**4 * np.sin(2 * angle) ** 2 / (4 * root**3)
    assert np.max(np.abs(slider.position[:, 0] - (r * np.cos(angle) + root))) < 1e-14
    assert np.max(np.abs(slider.velocity[:, 0] - 10.0 * slope)) < 1e-12
    assert np.max(np.abs(slider.acceleration[:, 0] - 100.0 * bend)) < 1e-11
    guide = motion.coordinate("guide")
    assert (
        np.max(
            np.abs(
                np.array(guide)
                - [slider.position[:, 0], *(motion_of[:, 0] for motion_of in (slider.velocity, slider.acceleration))]
            )
        )
        < 1e-12
    )
    limits = [(one.value, one.drive, one.greatest) for one in limit_positions(motion, "guide")]
    assert limits == [
        (pytest.approx(0.8, abs=1e-14), 0.0, True),
        (pytest.approx(0.4, abs=1e-14), pytest.approx(np.pi, abs=1e-12), False),
        (pytest.approx(0.8, abs=1e-14), pytest.approx(TURN, abs=1e-12), True),
    ]
    with np.errstate(divide="ignore"):
        assert motion.advantage("guide")[1:18] == pytest.approx(1.0 / slope[1:18], rel=1e-11)


def test_the_angle_of_a_joint_that_closes_a_loop_is_the_difference_of_the_others(motion):
    coordinates = {name: np.array(motion.coordinate(name)) for name in ("motor", "pin", "pivot", "rocker_pin")}
    expected = coordinates["pivot"] - coordinates["motor"] - coordinates["pin"]
    difference = coordinates["rocker_pin"] - expected
    assert np.max(np.abs(difference[1:])) < 1e-12
    assert np.ptp(difference[0]) < 1e-12 and np.sin(difference[0][0] / 2) == pytest.approx(0.0, abs=1e-13)
    assert motion.outputs == ("pin", "pivot", "rocker_pin")


def test_the_angle_of_a_joint_that_closes_a_loop_has_the_sense_of_its_axis():
    """About -y; the linkage above turns about z."""
    motion = driven_motion(load_mechanism("four_bar"), {"crank_pivot": (1.0, 1.2)}, 3)
    crank, pin, rocker, closing = (
        motion.coordinate(name)[0] for name in ("crank_pivot", "crank_pin", "rocker_pivot", "rocker_pin")
    )
    assert np.ptp(rocker) > 0.01
    assert np.sin((closing - (rocker - crank - pin)) / 2) == pytest.approx(0.0, abs=1e-12)


DOUBLE_ROCKER = {"a": 1.0, "b": 1.0, "c": 1.1, "d": 2.2, "start": 40}
DEAD = np.arccos((2.2**2 + 1.0**2 - (1.0 + 1.1) ** 2) / (2 * 2.2 * 1.0))  # coupler and rocker in line


def test_a_range_beyond_a_dead_point_is_refused_with_the_reachable_interval():
    mechanism = four_bar(**DOUBLE_ROCKER)
    with pytest.raises(UnreachableError, match=r"dead point at motor = 71\.0344 deg.*from -71\.0344 deg to 71\.0344"):
        driven_motion(mechanism, {"motor": (0.0, 2.0)})
    reach = reachable_range(mechanism, "motor")
    assert (reach.lower, reach.upper) == pytest.approx((-DEAD, DEAD), abs=1e-12)
    assert reach.lower_bound == reach.upper_bound == "dead point"
    assert reachable_range(four_bar(), "motor").upper == np.inf


def test_the_motion_goes_on_through_dead_points_until_it_repeats():
    motion = driven_motion(four_bar(**DOUBLE_ROCKER), {"motor": (-2.0, 2.0)}, 201, dead_points="follow")
    assert [one.kind for one in motion.singular] == ["dead point"] * 2
    upper, lower = (one.drives["motor"] for one in motion.singular)
    assert (upper, lower) == pytest.approx((DEAD, -DEAD), abs=1e-12)
    assert np.max(np.abs(motion.drive)) == pytest.approx(DEAD, abs=1e-12)
    assert np.isnan(motion.u[motion.singular[0].row]).all() and set(motion.direction) == {1.0, -1.0}
    ends = motion.q[[0, -1]] - motion.q[0]
    assert np.max(np.abs(np.sin(ends / 2))) < 0.04  # within a row of where it began
    gaps = [motion.system.constraints.position(0.0, q) for q in motion.q]
    assert np.max(np.abs(gaps)) < 1e-13
    tips = [motion.point(name).position for name in ("coupler.tip", "rocker.tip")]
    assert np.max(np.abs(tips[0] - tips[1])) < 1e-13


def test_a_parallelogram_stops_at_its_change_points_or_stays_a_parallelogram():
    mechanism = four_bar(0.5, 1.5, 0.5, 1.5, 60, -60)
    with pytest.raises(UnreachableError, match="change point at motor = 180 deg"):
        driven_motion(mechanism, {"motor": (1.0, TURN)})
    assert reachable_range(mechanism, "motor").upper == pytest.approx(np.pi, abs=1e-11)
    motion = driven_motion(mechanism, {"motor": (1.0, 1.0 + TURN)}, 50, dead_points="follow")
    places = [one.drives["motor"] for one in motion.singular]
    assert places == pytest.approx([np.pi, TURN], abs=1e-11)
    assert np.max(np.abs(motion.coordinate("pivot")[0] - motion.drive)) < 1e-9


def test_a_motion_cannot_begin_where_its_direction_is_not_determined():
    with pytest.raises(
        UnreachableError, match=r"begins at a change point, at motor = 0 deg.*Begin the range beside it"
    ):
        driven_motion(four_bar(0.5, 1.5, 0.5, 1.5, 0, 0), {"motor": (0.0, 1.0)}, dead_points="follow")
    with pytest.raises(UnreachableError, match=r"begins at a dead point, at motor = 71\.0344 deg"):
        driven_motion(four_bar(**{**DOUBLE_ROCKER, "start": np.degrees(DEAD)}), {"motor": (DEAD, 0.5)})


def test_a_mode_is_chosen_by_its_number(monkeypatch):
    few_starts(monkeypatch)
    modes = [driven_motion(four_bar(), {"motor": (1.0, 1.1)}, 2, mode=number) for number in (1, 2)]
    angles = sorted(np.mod(one.coordinate("pivot")[0][0], TURN) for one in modes)
    assert angles[0] == pytest.approx(rocker_angles(np.ones(1))[0][0], abs=1e-13)
    with pytest.raises(InputError, match=r"no assembly mode 3\. There are modes 1 to 2"):
        driven_motion(four_bar(), {"motor": (1.0, 2.0)}, mode=3)


def test_two_drives_move_together():
    """A five-bar linkage: the tip is the intersection of two circles."""
    mechanism = parse_mechanism("""
mechanism: five_bar
ground: {points: {right: [1, 0, 0]}}
parts:
  left: {mass: 1, points: {tip: [1, 0, 0]}}
  right: {mass: 1, points: {tip: [1, 0, 0]}}
  upper_left: {mass: 1, points: {tip: [1.2, 0, 0]}}
  upper_right: {mass: 1, points: {tip: [1.2, 0, 0]}}
joints:
  one: {type: revolute, between: [ground, left], axis: [0, 0, 1], position: 120 deg}
  other: {type: revolute, between: [ground.right, right], axis: [0, 0, 1], position: 60 deg}
  left_elbow: {type: revolute, between: [left.tip, upper_left], axis: [0, 0, 1], position: -80 deg, guess: true}
  right_elbow: {type: revolute, between: [right.tip, upper_right], axis: [0, 0, 1], position: 80 deg, guess: true}
  tip: {type: revolute, between: [upper_left.tip, upper_right.tip], axis: [0, 0, 1], cut: true}
""")
    with pytest.raises(InputError, match=r"2 degrees of freedom, and 1 coordinate is driven. Give ranges for 1 more"):
        driven_motion(mechanism, {"one": (2.0, 2.5)})
    motion = driven_motion(mechanism, {"one": (2.0, 1.8), "other": (1.0, 1.4)}, 11, speed=2.0)
    elbows = np.exp(1j * motion.drives[:, 0]), 1.0 + np.exp(1j * motion.drives[:, 1])
    middle, half = (elbows[0] + elbows[1]) / 2, (elbows[1] - elbows[0]) / 2
    tip = middle + 1j * half / np.abs(half) * np.sqrt(1.2**2 - np.abs(half) ** 2)
    assert np.max(np.abs(motion.point("upper_left.tip").position @ [1, 1j, 0] - tip)) < 1e-13
    assert motion.u[:, 0] == pytest.approx(-2.0) and motion.u[:, 1] == pytest.approx(4.0)


def test_a_drive_of_time_is_replaced_by_the_range():
    timed = parse_mechanism(
        four_bar().source.text.replace("position: 60 deg}", "drive: 1 + 2*t}").replace("plane_four_bar", "timed")
    )
    motion = driven_motion(timed, {"motor": (0.5, 1.5)}, 3)
    assert motion.coordinate("pivot")[0] == pytest.approx(rocker_angles(motion.drive)[0], abs=1e-13)
    with pytest.raises(MechanismError, match="also moves as a function of time: motor"):
        driven_motion(timed, {"pin": (0.5, 1.5)})


@pytest.mark.parametrize(
    ("drives", "message"),
    [
        ({"moter": (0.0, 1.0)}, "there is no coordinate 'moter'. Did you mean 'motor'"),
        ({"rocker_pin": (0.0, 1.0)}, "'rocker_pin' closes a loop.*Write 'cut: true' at another joint"),
        ({"motor": (1.0, 1.0)}, "no drive moves"),
        ({"motor": (0.0, np.nan)}, "is not finite"),
    ],
)
def test_wrong_drives_are_refused(drives, message):
    with pytest.raises(InputError, match=message):
        driven_motion(four_bar(), drives)


def test_velocity_constraints_are_refused():
    with pytest.raises(MechanismError, match="because of constraints on velocities"):
        driven_motion(load_mechanism("rolling_disc"), {"flight.x": (0.0, 1.0)})
