"""Inverse kinematics against closed forms, and by forward kinematics on random robots; limits, loops, and what is too far."""

import math
import random

import numpy as np
import pytest

from mbd_sim import Kinematics, inverse_kinematics, load_mechanism
from mbd_sim.analysis.mechanics import inverse_kinematics as module
from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.rotation import from_rpy, rotation_vector, to_quaternion
from mbd_sim.files.load import parse_mechanism

ONE, TWO = 0.7, 0.5
PLANAR = f"""
mechanism: two_links
parts:
  upper: {{mass: 1, points: {{end: [{ONE}, 0, 0]}}}}
  lower: {{mass: 1, points: {{tip: [{TWO}, 0, 0]}}}}
joints:
  shoulder: {{type: revolute, between: [ground, upper], axis: [0, 0, 1]}}
  elbow: {{type: revolute, between: [upper.end, lower], axis: [0, 0, 1], position: 0.5}}
"""
A2, A3, D3, D4 = 0.43, 0.02, 0.15, 0.43  # of a PUMA 560, rounded
PUMA = f"""
mechanism: puma
parts: {{b1: {{mass: 1}}, b2: {{mass: 1, points: {{end: [{A2}, 0, {D3}]}}}}, b3: {{mass: 1, points: {{wrist: [{A3}, {D4}, 0]}}}}, b4: {{mass: 1}}, b5: {{mass: 1}}, b6: {{mass: 1}}}}
joints:
  q1: {{type: revolute, between: [ground, b1], axis: [0, 0, 1]}}
  q2: {{type: revolute, between: [b1.turned, b2], axis: [0, 0, 1], position: 0.4}}
  q3: {{type: revolute, between: [b2.end, b3], axis: [0, 0, 1], position: -0.5}}
  q4: {{type: revolute, between: [b3.wrist, b4], axis: [0, 1, 0]}}
  q5: {{type: revolute, between: [b4, b5], axis: [0, 0, 1], position: 0.6}}
  q6: {{type: revolute, between: [b5, b6], axis: [0, 1, 0]}}
""".replace("b1: {mass: 1}", "b1: {mass: 1, points: {turned: {rotate: {rpy: [-90 deg, 0, 0]}}}}")


@pytest.fixture(scope="module")
def planar():
    return Kinematics(parse_mechanism(PLANAR))


@pytest.mark.parametrize("elbow", [1, -1])
@pytest.mark.parametrize("target", [(0.6, 0.4), (0.1, -0.25), (-0.9, -0.6)])
def test_a_planar_arm_reaches_the_angles_of_the_closed_form(planar, target, elbow):
    x, y = target
    cosine = (x * x + y * y - ONE**2 - TWO**2) / (2 * ONE * TWO)
    bent = elbow * math.acos(cosine)
    turned = math.atan2(y, x) - math.atan2(TWO * math.sin(bent), ONE + TWO * cosine)
    found = inverse_kinematics(planar, "lower.tip", [x, y, 0.0], q=[turned + 0.2, bent + 0.1 * elbow])
    assert found.reached and found.distance < 1e-12
    assert np.allclose(np.exp(1j * (found.q - [turned, bent])), 1.0, atol=1e-9)


def test_the_nearest_point_of_a_planar_arm_is_on_the_line_to_the_target(planar):
    found = inverse_kinematics(planar, "lower.tip", [3.0, 4.0, 0.0])
    assert not found.reached and found.distance == pytest.approx(5.0 - ONE - TWO, rel=1e-7)
    assert planar.point("lower.tip", found.q) == pytest.approx([1.2 * 0.6, 1.2 * 0.8, 0.0], abs=1e-5)
    assert found.reason == "The target is out of reach: the nearest position that was found is 3.8 m from the target."
    inner = inverse_kinematics(planar, "lower.tip", [0.05, 0.0, 0.0])  # in the hole around the shoulder
    assert inner.distance == pytest.approx(ONE - TWO - 0.05, rel=1e-7)


def test_a_wrist_at_one_point_reaches_the_angles_of_the_closed_form():
    arm = Kinematics(parse_mechanism(PUMA))
    for angles in ([0.3, 0.5, -0.7, 0.4, 0.6, -0.9], [-1.0, 0.9, -0.2, -0.8, 0.9, 1.3]):
        pose = arm.poses(angles)["b6"]
        found = inverse_kinematics(arm, "b6", pose.position, pose.rotation, q=np.add(angles, 0.15))
        assert found.reached
        x, y, z = pose.position
        # Of the wrist's point alone: q1 from the offset d3, then q3 from its distance from the shoulder.
        q1 = math.atan2(y, x) - math.atan2(D3, math.sqrt(x * x + y * y - D3**2))
        reach = x * math.cos(q1) + y * math.sin(q1)
        between = (reach**2 + z * z - A2**2 - A3**2 - D4**2) / (2 * A2 * math.hypot(A3, D4))
        q3 = math.acos(between) * math.copysign(1.0, angles[2] + math.atan2(D4, A3)) - math.atan2(D4, A3)
        assert found.q[[0, 2]] == pytest.approx([q1, q3], abs=1e-9)
        wrist = arm.poses([*found.q[:3], 0.0, 0.0, 0.0])["b6"].rotation.T @ pose.rotation  # Ry(q4) Rz(q5) Ry(q6)
        assert math.cos(found.q[4]) == pytest.approx(wrist[1, 1], abs=1e-9)


def test_a_point_of_a_coupler_closes_the_loop_and_reaches_the_angle_of_the_closed_form():
    linkage = Kinematics(load_mechanism("four_bar"))
    start = linkage.point("coupler", linkage.start)
    moved = linkage.closed(linkage.start + np.array([0.3, 0.0, 0.0]))
    goal = linkage.poses(moved)["coupler"]
    assert np.linalg.norm(goal.position - start) > 0.01
    found = inverse_kinematics(linkage, "coupler", goal.position, goal.rotation)
    assert found.reached
    arm = np.linalg.norm(start)  # the coupler begins at the end of the crank, on a circle around the origin
    assert np.linalg.norm(linkage.point("coupler", found.q)) == pytest.approx(arm, abs=1e-12)
    assert np.max(np.abs(linkage.constraints.position(0.0, found.q))) < 1e-10
    assert found.q == pytest.approx(moved, abs=1e-8)
    beside = inverse_kinematics(linkage, "coupler", goal.position * 1.5, tries=1)
    assert not beside.reached and beside.distance == pytest.approx(0.5 * arm, rel=1e-6)


def random_robot(rng, loops=False):
    """A chain of hinges and sliders with random axes, some with limits, perhaps on a base that turns freely."""
    count = rng.randint(3, 8)
    parts = ", ".join(
        f"p{i}: {{mass: 1, points: {{end: [{rng.uniform(0.2, 0.5):.3f}, 0.1, {rng.uniform(-0.2, 0.2):.3f}]}}}}"
        for i in range(count)
    )
    lines = []
    for i in range(count):
        kind = "prismatic" if rng.random() < 0.2 else "revolute"
        axis = [round(rng.uniform(-1, 1), 3) for _ in range(3)]
        limits = ", limits: {lower: -1.2, upper: 1.4}" if rng.random() < 0.5 else ""
        inboard = "ground" if i == 0 else f"p{i - 1}.end"
        lines.append(f"  j{i}: {{type: {kind}, between: [{inboard}, p{i}], axis: {axis}{limits}}}")
    if rng.random() < 0.3:
        lines[0] = "  j0: {type: spherical, between: [ground, p0]}"
    return f"mechanism: random\nparts: {{{parts}}}\njoints:\n" + "\n".join(lines), f"p{count - 1}"


@pytest.mark.parametrize("seed", range(5))
def test_random_robots_reach_where_forward_kinematics_has_been(seed):
    rng, numbers = random.Random(seed), np.random.default_rng(seed)
    text, last = random_robot(rng)
    robot = Kinematics(parse_mechanism(text))
    q = robot.constraints.displaced(robot.start, numbers.uniform(-1.0, 1.0, robot.layout.nv))
    goal = robot.poses(q)[last]
    rotation = goal.rotation if seed % 2 else None
    found = inverse_kinematics(robot, last, goal.position, rotation)
    assert found.reached, found.reason
    again = robot.poses(found.q)[last]
    assert np.max(np.abs(again.position - goal.position)) < 1e-9
    if rotation is not None:
        assert np.max(np.abs(again.rotation - rotation)) < 1e-9
    for name, joint in robot.mechanism.joints.items():
        if joint.limits:
            assert -1.2 <= found.q[robot.layout.q[name]][0] <= 1.4


@pytest.mark.parametrize(
    ("mechanism", "frame", "target", "turned", "most"),
    [
        ("four_bar", "rocker.tip", [-0.5, 1.6, 5.8], True, 22),
        ("slider_crank", "coupler", [0.3, 2.0, 0.1], False, 22),
        ("six_axis_arm", "tool", [4.8, -3.6, 1.1], True, 50),
    ],
)
def test_the_nearest_position_to_a_target_out_of_reach_is_found_in_few_steps(
    mechanism, frame, target, turned, most, monkeypatch
):
    """Steps without the curvature, which are 2 to 10 times as many; and a wrong curvature."""
    kinematics, steps, moves, starts = Kinematics(load_mechanism(mechanism)), [], [], []
    for owner, name, calls in (
        (module._Vicinity, "__init__", steps), (module._Reaching, "_moved", moves), (module._Reaching, "descended", starts),
    ):  # fmt: skip
        monkeypatch.setattr(owner, name, counted(getattr(owner, name), calls))
    rotation = from_rpy(0.3, -0.4, 0.5) if turned else None
    found = inverse_kinematics(kinematics, frame, target, rotation)
    assert not found.reached
    assert len(steps) + len(moves) <= most * len(starts)
    size = kinematics.constraints.size

    def error(q):
        pose = kinematics.poses(q)[frame.split(".")[0]]
        distance = np.linalg.norm(kinematics.point(frame, q) - target) / size
        angle = np.linalg.norm(rotation_vector(to_quaternion(pose.rotation @ rotation.T))) if turned else 0.0
        return np.hypot(distance, angle)

    least, rng = error(found.q), np.random.default_rng(1)
    for _ in range(20):  # on all sides, farther
        near = kinematics.closed(found.q + 1e-3 * rng.normal(size=len(found.q)))
        assert error(near) > least - 1e-12
    grown = [error(kinematics.closed(found.q + 1e-3 * rng.normal(size=len(found.q)))) - least for _ in range(5)]
    assert max(grown) > 1e-9


def counted(function, calls):
    def counting(*arguments, **keywords):
        calls.append(None)
        return function(*arguments, **keywords)

    return counting


def test_a_search_stops_when_it_is_told_to_with_the_best_position_so_far():
    linkage, asked = Kinematics(load_mechanism("four_bar")), iter([False] * 4 + [True] * 9)
    found = list(module.improving(linkage, "coupler.P", [9.0, 0.0, 0.0], None, stop=lambda: next(asked)))
    whole = inverse_kinematics(linkage, "coupler.P", [9.0, 0.0, 0.0])
    assert len(found) == 1 and whole.distance < found[0].distance
    assert np.max(np.abs(linkage.constraints.position(0.0, found[0].q))) < 1e-10


def test_limits_hold_back_and_are_named(planar):
    limited = Kinematics(
        parse_mechanism(
            PLANAR.replace("axis: [0, 0, 1], position", "axis: [0, 0, 1], limits: {lower: 0.2, upper: 1}, position")
        )
    )
    found = inverse_kinematics(limited, "lower.tip", [0.2, 0.2, 0.0])
    assert not found.reached and found.at_limits == ("elbow",) and "The limits of elbow hold it back" in found.reason
    nearest = math.hypot(ONE + TWO * math.cos(1.0), TWO * math.sin(1.0)) - math.hypot(0.2, 0.2)
    assert found.distance == pytest.approx(nearest, rel=1e-7)  # the circle of the tip at the largest angle of the elbow
    assert inverse_kinematics(limited, "lower.tip", [0.2, 0.2, 0.0], limits=False).reached


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("lowr", [0, 0, 0]), "there is no part or point 'lowr'. Did you mean 'lower'?"),
        (("lower.tip",), "there is no target"),
        (("lower.tip", [0, math.nan, 0]), "3 finite numbers"),
        (("lower.tip", None, np.eye(3) * 2), "a rotation matrix"),
        (("lower.tip", None, -np.eye(3)), "a rotation matrix"),
    ],
)
def test_what_does_not_fit_is_refused(planar, arguments, expected):
    with pytest.raises(InputError, match=expected.replace("?", r"\?")):
        inverse_kinematics(planar, *arguments)


def test_another_point_is_given_in_the_axes_of_a_frame(planar):
    """The tip as seen from a point of the part whose axes are turned by 90 deg is (-y, x) of what it is in the part."""
    text = PLANAR.replace(
        f"tip: [{TWO}, 0, 0]", f"tip: [{TWO}, 0, 0], mark: {{at: [0.1, 0.2, 0], rotate: {{rpy: [0, 0, 90 deg]}}}}"
    )
    arm, q = Kinematics(parse_mechanism(text)), [0.3, 0.7]
    tip = inverse_kinematics(planar, "lower.tip", [0.6, 0.4, 0.0], q=q)
    for frame, at in (("lower", [TWO, 0.0, 0.0]), ("lower.mark", [-0.2, -(TWO - 0.1), 0.0])):
        assert inverse_kinematics(arm, frame, [0.6, 0.4, 0.0], at=at, q=q).q == pytest.approx(tip.q, abs=1e-9)
    with pytest.raises(ValueError, match="at must be a list of 3 values"):
        inverse_kinematics(arm, "lower", [0.6, 0.4, 0.0], at=[1.0])


def test_an_orientation_alone(planar):
    found = inverse_kinematics(planar, "lower", rotation=from_rpy(0.0, 0.0, 2.0))
    assert found.reached and found.q.sum() == pytest.approx(2.0, abs=1e-12)
    tilted = inverse_kinematics(planar, "lower", rotation=from_rpy(0.3, 0.0, 0.0), tries=2)
    assert not tilted.reached and tilted.angle == pytest.approx(0.3, rel=1e-6)


@pytest.mark.parametrize("commands", [("position", "position"), ("velocity", None), (None, "position")])
def test_joints_whose_drives_follow_commands_reach_what_they_reach_without_drives(planar, commands):
    text = PLANAR
    for joint, command in zip(("shoulder", "elbow"), commands, strict=True):
        drive = f"drive: {{command: {command}, bandwidth: 50, lower: -3, upper: 2.9, position: 0.1}}"
        if command is not None:
            line = next(line for line in PLANAR.splitlines() if line.strip().startswith(joint))
            text = text.replace(line, line.replace(", position: 0.5", "").replace("}", f", {drive}}}"))
    arm = Kinematics(parse_mechanism(text))
    found = inverse_kinematics(arm, "lower.tip", [0.6, 0.4, 0.0])
    assert found.reached and arm.point("lower.tip", found.q) == pytest.approx([0.6, 0.4, 0.0], abs=1e-9)
    plain = [found.positions["shoulder"], found.positions["elbow"]]
    assert planar.point("lower.tip", plain) == pytest.approx([0.6, 0.4, 0.0], abs=1e-9)
    again = inverse_kinematics(arm, "lower.tip", [0.6, 0.4, 0.0], q=found.q)
    assert again.positions == pytest.approx(found.positions, abs=1e-9)  # which begins there
    behind = inverse_kinematics(arm, "lower.tip", [-(ONE + TWO), 0.0, 0.0])  # by half a turn of the shoulder
    assert behind.reached == (commands[0] is None)
    assert behind.reached or (behind.at_limits == ("shoulder",) and abs(behind.positions["shoulder"]) >= 2.9)


def test_what_an_expression_of_time_moves_is_named_where_a_target_is_out_of_reach():
    arm = Kinematics(parse_mechanism(PLANAR.replace("0, 1]}", "0, 1], drive: t}", 1)))
    found = inverse_kinematics(arm, "lower.tip", [0.0, 1.2, 0.0], time=0.5)
    assert not found.reached and found.reason.endswith(
        " shoulder is a function of time, here at 0.5 s: only the other joints were moved."
    )


def test_coordinates_of_a_wrong_number_are_named_in_their_order(planar):
    with pytest.raises(ValueError, match="They are, in this order: shoulder, elbow"):
        planar.poses([0.1])
