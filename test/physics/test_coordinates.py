"""A change of coordinates does not change the motion (Lidström, theorem 9.2).

The same mechanism is written with other joints, cut at another joint, or with the parts of its joints exchanged. From
the same start both have the same motion, and the joints that they share transmit the same forces.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry.rotation import from_quaternion, unit
from test.generators.mechanisms import accelerations


def near(expected, size):
    return pytest.approx(np.asarray(expected, dtype=float), rel=0.0, abs=size)


def assert_alike(found, expected, size):
    """The parts that two simulations share have the same poses, and the energies agree."""
    poses = found.poses()
    for name, pose in expected.poses().items():
        if name in poses:
            assert poses[name].position == near(pose.position, size)
            assert poses[name].rotation == near(pose.rotation, size)
    assert found.energies.kinetic == near(expected.energies.kinetic, 10.0 * size)
    assert found.energies.potential == near(expected.energies.potential, 10.0 * size)


# A rod of 1 kg and 1 m on a pin; it swings in a plane for any choice of coordinates.
ROD = """
mechanism: rod
parts:
  rod: {mass: 1, shape: {type: rod, to: [0, 0, -1]}, points: {middle: [0, 0, -0.5], tip: [0, 0, -1]}}
EXTRA
joints:
JOINTS
"""
PIN = "  pin: {type: revolute, between: [ground, rod], axis: [0, -1, 0]"

# Further joints, parts and constraints; q and u as functions of the angle a and the speed w.
RODS = {
    "revolute": (PIN + "}", "", lambda a, w: ([a], [w])),
    "a planar joint, the pin cut": (
        f"  plane: {{type: planar, between: [ground, rod], axis: [0, -1, 0], x_axis: [1, 0, 0]}}\n{PIN}, cut: true}}",
        "",
        lambda a, w: ([0.0, 0.0, a], [0.0, 0.0, w]),
    ),
    "two slides and a hinge at the middle, with its end on a line": (
        "  x: {type: prismatic, between: [ground, carriage], axis: [1, 0, 0]}\n"
        "  z: {type: prismatic, between: [carriage, block], axis: [0, 0, 1]}\n"
        "  turn: {type: revolute, between: [block, rod.middle], axis: [0, -1, 0]}\n"
        "constraints:\n  pin: {type: on_line, point: rod, direction: [0, 1, 0]}",
        "  carriage: {mass: 0}\n  block: {mass: 0}",
        lambda a, w: (
            [0.5 * np.sin(a), -0.5 * np.cos(a), a],
            [0.5 * np.cos(a) * w, 0.5 * np.sin(a) * w, w],
        ),
    ),
}


def rod(name, a, w):
    joints, parts, state = RODS[name]
    sim = Simulation.from_text(ROD.replace("EXTRA", parts).replace("JOINTS", joints))
    q, u = state(a, w)
    sim.reset(q=q, u=u)
    assert sim.q == near(q, 1e-14) and sim.u == near(u, 1e-14)
    return sim


@pytest.mark.parametrize("name", [name for name in RODS if name != "revolute"])
def test_rod_pendulum_in_other_coordinates(name):
    expected, found = rod("revolute", 1.2, 0.7), rod(name, 1.2, 0.7)
    for _ in range(4):
        for sim in (expected, found):
            sim.step(500)
        assert_alike(found, expected, 1e-12)
        force = expected.reactions()["pin"].force
        if "pin" in found.reactions():
            assert found.reactions()["pin"].force == near(force, 1e-12)
        else:
            assert np.sort(np.abs(found.multipliers()["pin"])) == near(np.sort(np.abs(force[[0, 2]])), 1e-12)


ABSOLUTE = """
mechanism: double_rod_absolute
parts:
  upper: {mass: 1, shape: {type: rod, to: [0, 0, -1]}, points: {tip: [0, 0, -1]}}
  lower: {mass: 1, shape: {type: rod, to: [0, 0, -1]}}
joints:
  shoulder: {type: revolute, between: [ground, upper], axis: [0, -1, 0]}
  lower: {type: planar, between: [ground, lower], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [0, -1, 0], guess: true}
  elbow: {type: revolute, between: [upper.tip, lower], axis: [0, -1, 0], cut: true}
"""


def in_absolute_angles(q, u):
    """The lower rod's x, its height, and the sums of the angles."""
    (a, b), (a1, b1) = np.cumsum(q), np.cumsum(u)
    return [a, np.sin(a), -np.cos(a), b], [a1, np.cos(a) * a1, np.sin(a) * a1, b1]


def test_double_rod_in_absolute_and_in_relative_angles():
    relative, absolute = Simulation.from_file("double_rod"), Simulation.from_text(ABSOLUTE)
    rng = np.random.default_rng(141)
    for _ in range(20):
        q, u = rng.uniform(-2.5, 2.5, (2, 2))
        expected = accelerations(relative.model.equations, q, u)
        found = accelerations(absolute.model.equations, *in_absolute_angles(q, u))
        assert found[[0, 3]] == near(np.cumsum(expected), 1e-12 * np.max(np.abs(expected)))
    state = in_absolute_angles(relative.q, relative.u)
    absolute.reset(*state)
    for _ in range(4):
        relative.step(500)
        absolute.step(500)
        assert absolute.q == near(in_absolute_angles(relative.q, relative.u)[0], 1e-12)
        assert_alike(absolute, relative, 1e-12)


ROW = """
mechanism: row
parts:
  a: {mass: 1, center: [0.1, 0.2, 0.1], inertia: [0.3, 0.4, 0.35], points: {p: {at: [0.3, 0, 0.4], rotate: {axis: [1, 0, 2], angle: 0.5}}}}
  b: {mass: 1, center: [0.2, -0.1, 0], inertia: [0.2, 0.3, 0.3], points: {p: [0, 0.4, 0.3]}}
  c: {mass: 2, center: [0, 0.1, 0.2], inertia: [0.3, 0.2, 0.4], points: {p: {at: [0.1, 0, 0], rotate: {axis: [0, 1, 2], angle: -0.7}}}}
  d: {mass: 1, center: [0, 0.3, 0], inertia: [0.4, 0.2, 0.3], points: {p: [0, 0, 0.5]}}
  e: {mass: 1, center: [0.3, 0, 0], inertia: [0.2, 0.2, 0.3], points: {p: [0.2, 0, 0.5]}}
  f: {mass: 1, center: [0, 0.2, 0.3], inertia: [0.3, 0.2, 0.2]}
joints:
"""
CHAIN = [
    ("j1", "revolute", "ground", "a", {"axis": [1, 2, 2]}),
    ("j2", "screw", "a.p", "b", {"axis": [0, 3, 4], "lead": 0.4}),
    ("j3", "cylindrical", "b.p", "c", {"axis": [2, -1, 2]}),
    ("j4", "universal", "c.p", "d", {"axes": [[1, 0, 0], [0.2, 1, 0]]}),
    ("j5", "prismatic", "d.p", "e", {"axis": [1, 1, 0]}),
    ("j6", "spherical", "e.p", "f", {}),
]


def with_parts_exchanged(kind, options):
    """The same joint from its second part to its first: with opposite axes, and two axes in reverse order."""
    opposite = {key: (-np.array(value, dtype=float)).tolist() for key, value in options.items() if key.startswith("ax")}
    if kind == "universal":
        opposite["axes"].reverse()
    return {**options, **opposite}


def test_joints_with_their_parts_exchanged():
    """All coordinates stay the same except the angles of a universal joint, which swap, and a ball's rotation."""
    lines, others = [], []
    for name, kind, first, second, options in CHAIN:
        lines.append(f"  {name}: {json.dumps({'type': kind, 'between': [first, second], **options})}")
        other = {"type": kind, "between": [second, first], **with_parts_exchanged(kind, options)}
        others.append(f"  {name}: {json.dumps(other)}")
    one, other = (Simulation.from_text(ROW + "\n".join(joints)) for joints in (lines, others))
    rng = np.random.default_rng(142)
    q, u = np.append(rng.uniform(-1.0, 1.0, 7), unit(rng.normal(size=4))), rng.uniform(-2.0, 2.0, 10)
    one.reset(q=q, u=u)
    ball = from_quaternion(q[7:])
    swapped = [0, 1, 2, 3, 5, 4, 6]
    other.reset(q=[*q[swapped], *(q[7:] * [1, -1, -1, -1])], u=[*u[swapped], *(-ball @ u[7:])])
    for _ in range(5):
        assert_alike(other, one, 1e-12)
        assert other.q[:7] == near(one.q[swapped], 1e-12)
        one.step(200)
        other.step(200)
        efforts = rng.uniform(-2.0, 2.0, 7)
        one.set_efforts([*efforts, 0.0, 0.0, 0.0])
        other.set_efforts([*efforts[swapped], 0.0, 0.0, 0.0])
    assert other.energies.work_applied == near(one.energies.work_applied, 1e-12)
