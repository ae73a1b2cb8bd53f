"""Forces, motions and inertias across a joint, against the matrices (6, 6) of spatial algebra."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.kinematics.tracing import trace
from mbd_sim.dynamics.recursion.articulated_body import inboard_force, inboard_inertia, outboard_motion
from mbd_sim.files.load import parse_mechanism

AXES = ("[0, -1, 0]", "[1, 0, 0]", "[0, 0, 1]", "[1, 2, 2]")


@pytest.mark.parametrize(
    "kind", [*(f"revolute, axis: {axis}" for axis in AXES), "spherical", "screw, axis: [0, 1, 0], lead: 2"]
)
def test_transforms_are_those_of_the_matrices(kind):
    joints = f"h: {{type: revolute, between: [ground, a], axis: [2, 1, 2]}}, j: {{type: {kind}, between: [a.at, b]}}"
    part = "{mass: 1, inertia: [1, 1, 1], points: {at: [0.1, 0.2, 0.3]}}"
    traced = trace(parse_mechanism(f"mechanism: m\nparts: {{a: {part}, b: {part}}}\njoints: {{{joints}}}"))
    link, motion = traced.links[1], traced.motions[1]
    rng, state = np.random.default_rng(1), [traced.state.t, traced.y]
    root, vector = rng.uniform(-1.0, 1.0, (6, 6)), rng.uniform(-1.0, 1.0, 6)
    matrix, column = ca.SX(ca.DM(root @ root.T)), ca.SX(ca.DM(vector))
    pairs = [
        (inboard_force(motion, column), motion.transform.T @ column),
        (outboard_motion(motion, column), motion.transform @ column),
        (inboard_inertia(link, motion, matrix), motion.transform.T @ matrix @ motion.transform),
    ]
    y = rng.uniform(-1.0, 1.0, traced.y.shape[0])
    if kind == "spherical":
        y[1:5] /= np.linalg.norm(y[1:5])
    for found, expected in pairs:
        found, expected = (np.array(ca.Function("f", state, [value])(0.2, y)) for value in (found, expected))
        assert found == pytest.approx(expected, abs=2e-15 * np.max(np.abs(expected)))
