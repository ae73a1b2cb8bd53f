"""What pictures show of contacts is what acts: drawn forces balance with the other forces on a part and its motion."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.pictures.shapes.touching import NORMAL, SHORT, ForceScale, touching_now

TABLE = """
mechanism: table
parts: {block: {shape: {type: block, mass: 2, size: [0.2, 0.2, 0.1]}}, top: {shape: {type: block, mass: 5, size: [1, 1, 0.1]}}}
joints:
  block: {type: free, between: [ground, block], position: [0, 0, 0.1], velocity: [1, 0, 0]}
  top: {type: fixed, between: [ground, top]}
contacts: {slides: {between: [block, top], friction: 0.3}}
"""


def test_the_drawn_forces_of_slots_are_those_that_change_the_momentum_of_the_part():
    """Of a contact with several points; a normal that is not that of the row, or a force twice, shows here."""
    sim = Simulation.from_text(TABLE)
    sim.step(50)
    shown, motion = touching_now(sim), sim.frame("block")
    assert len(shown.points) >= 3
    total = shown.forces.sum(axis=0) + 2.0 * sim.mechanism.gravity
    assert total == pytest.approx(2.0 * motion.acceleration, abs=1e-9)
    assert motion.acceleration == pytest.approx([-0.3 * 9.81, 0.0, 0.0], abs=1e-9)
    moment = np.cross(shown.points - motion.position, shown.forces).sum(axis=0)
    assert moment == pytest.approx(np.zeros(3), abs=1e-9)
    assert shown.normals == pytest.approx(np.tile([0.0, 0.0, 1.0], (len(shown.points), 1)), abs=1e-15)
    states = [state for state in sim.contacts().values() if state.state != "open"]
    assert [state.direction.tolist() for state in states] == shown.normals.tolist()
    for state in states:
        assert state.force @ state.direction == pytest.approx(state.normal, rel=1e-12)
    open_ones = [state for state in sim.contacts().values() if state.state == "open"]
    assert all(state.point is state.force is state.direction is None for state in open_ones)
    assert all(state.gap < 0.1 for state in open_ones)  # a distance, and not the natural length


def test_arrows_end_where_bodies_push_and_lines_show_the_normals():
    sim = Simulation.from_text(TABLE)
    shown = touching_now(sim)
    arrows = list(shown.arrows(1.0, 2.0 * 9.81))
    assert [tip.tolist() for _, tip in arrows] == shown.points.tolist()
    assert sum(float(np.linalg.norm(tip - start)) for start, tip in arrows) == pytest.approx(0.25 * np.hypot(1.0, 0.3))
    assert not list(shown.arrows(1.0, 20.0 / SHORT))
    lines = shown.normal_lines(2.0)
    assert lines[:, 1] - lines[:, 0] == pytest.approx(4.0 * NORMAL * shown.normals)


def test_the_scale_of_arrows_fits_forces_far_from_the_weight():
    """By the weight, the teeth of a clock had no arrows, and all those of a detent were as long."""
    for forces, full in (
        ([0.3, 1.0, 0.5], 1.0),  # of the order of the weight, which is 1 N
        ([0.001] * 95 + [0.2] * 5, 0.001),
        ([10.0] * 95 + [5.0] * 5, 10.0),
        ([1e-9, 0.0], 1.0),  # round-off
    ):
        scale = ForceScale(1.0)
        for force in forces:
            scale.add(np.array([[0.0, 0.0, force], [0.0, 0.5 * force, 0.0]]))
        assert scale.full == pytest.approx(full)
