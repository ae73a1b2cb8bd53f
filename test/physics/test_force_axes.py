"""Forces and couples in the axes of parts and points, and the eight forces on the box kite."""

from __future__ import annotations

import re

import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.text.library import find
from test.generators.mechanisms import accelerations
from test.oracles import kane


def test_a_force_in_the_axes_of_another_part_rotates_with_that_part():
    """A clock's hand turns at 2 rad/s; a force along its x pushes a free ball: v = F/2m (sin 2t, 1 - cos 2t)."""
    text = """
mechanism: clock
gravity: [0, 0, 0]
parts:
  hand: {mass: 1, inertia: [1, 1, 1], points: {tip: {rotate: {axis: [0, 0, 1], angle: ANGLE}}}}
  ball: {mass: 2, inertia: [1, 1, 1]}
joints:
  pin: {type: revolute, between: [ground, hand], axis: [0, 0, 1], velocity: 2}
  fly: {type: free, between: [ground, ball]}
forces:
  f: {type: force, at: ball, vector: [3, 0, 0], axes: AXES}
"""
    for axes, angle in (("hand", 0.0), ("hand.tip", 0.4)):
        sim = Simulation.from_text(text.replace("AXES", axes).replace("ANGLE", str(angle)))
        sim.run(until=1.0)
        ends = np.array([np.sin(2 + angle) - np.sin(angle), np.cos(angle) - np.cos(2 + angle), 0.0])
        assert sim.u[1:4] == pytest.approx(3 / 4 * ends, abs=1e-13)
        assert sim.energies.work_applied == pytest.approx(sim.u[1:4] @ sim.u[1:4], rel=1e-12)


def test_a_couple_in_the_axes_of_a_point_of_ground():
    text = """
mechanism: wheel
gravity: [0, 0, 0]
ground: {points: {skew: {rotate: {axis: [1, 0, 0], angle: 60 deg}}}}
parts: {wheel: {mass: 1, inertia: [1, 1, 0.5]}}
joints: {pin: {type: revolute, between: [ground, wheel], axis: [0, 0, 1]}}
forces: {c: {type: couple, on: wheel, vector: [0, 0, 3], axes: ground.skew}}
"""
    equations = derive(parse_mechanism(text))
    assert accelerations(equations, np.zeros(1), np.zeros(1)) == pytest.approx([3.0 * 0.5 / 0.5], rel=1e-15)


BRYAN = """
  alpha: {type: revolute, between: [ground, outer], axis: [1, 0, 0]}
  beta: {type: revolute, between: [outer, inner], axis: [0, 1, 0]}
  gamma: {type: revolute, between: [inner, box], axis: [0, 0, 1]}
"""


@pytest.mark.parametrize("angles", ["quaternion", "bryan"])
def test_the_eight_forces_on_the_box_kite_equal_one_through_o_and_a_couple(angles):
    """Huston & Liu, P11.5.9-10: F = Σ Fi at O and M = Σ ri × Fi, whose generalized forces are the same."""
    text = find("box_kite").read_text(encoding="utf-8")
    if angles == "bryan":
        text = re.sub(r"  tether:.*?\n\n", BRYAN.lstrip("\n") + "\n", text, flags=re.DOTALL)
        text = text.replace("parts:\n", "parts:\n  outer: {mass: 0}\n  inner: {mass: 0}\n")
    eight = parse_mechanism(text)
    vectors = np.array([[expression.at(0.0) for expression in force.vector] for force in eight.applied])
    total = vectors.sum(axis=0)
    couple = sum(np.cross(force.at.point, vector) for force, vector in zip(eight.applied, vectors, strict=True))
    assert len(vectors) == 8 and np.linalg.norm(total) > 1.0 and np.linalg.norm(couple) > 0.1
    one = text[: text.index("  F1:")]
    one += f"  F: {{type: force, at: box, vector: {total.tolist()}, axes: part}}\n"
    one += f"  M: {{type: couple, on: box, vector: {couple.tolist()}, axes: part}}\n"
    without = text[: text.index("forces:")]
    first, second, third = (derive(parse_mechanism(version)) for version in (text, one, without))
    rng = np.random.default_rng(75)
    for _ in range(30):
        u = rng.uniform(-3, 3, 3)
        q = rng.uniform(-1, 1, 3) if angles == "bryan" else (lambda p: p / np.linalg.norm(p))(rng.normal(size=4))
        by_eight, by_one, by_none = (accelerations(equations, q, u) for equations in (first, second, third))
        assert by_one == pytest.approx(by_eight, rel=1e-12, abs=1e-11)
        # Their contributions to M u' are the generalized forces M·ω_r, because O does not move.
        gained = kane.equations(eight, q, u, np.zeros(3)).mass @ (by_eight - by_none)
        assert gained == pytest.approx(partial_angular_velocities(angles, q) @ couple, abs=1e-11)


def partial_angular_velocities(angles, q):
    """(3, 3): ω_r in the box's axes, one row per speed, for the dextral angles of Huston & Liu, P11.4.3."""
    if angles == "quaternion":
        return np.eye(3)
    (_, cb, cg), (_, sb, sg) = np.cos(q), np.sin(q)
    return np.array([[cb * cg, -cb * sg, sb], [sg, cg, 0.0], [0.0, 0.0, 1.0]])
