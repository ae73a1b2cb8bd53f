"""A body on two feet, one of them on a moving belt: its accelerations are those of a mode that the laws admit.

There can be several: friction of the foot on the belt can lift the other one, which could bear the body as well.
"""

from __future__ import annotations

import itertools
import json

import numpy as np

from mbd_sim import Simulation

GRAVITY, SPEED, STEP = 10.0, 0.5, 1e-6


def standing(turn, side, height, inertia, law):
    """A body of 1 kg, whose center of mass is above the origin, at rest; the belt runs to one side."""
    law = {"type": "on_plane", "bound": "at_least"} | law
    points = {"first": [side[0], 0, -height], "second": [side[1], 0, -height]}
    parts = {"body": {"mass": 1, "inertia": [inertia] * 3, "points": points}, "belt": {"mass": 1, "inertia": [1, 1, 1]}}
    joints = {
        "body": {"type": "planar", "between": ["ground", "body"], "axis": [0, -1, 0], "x_axis": [1, 0, 0]},
        "belt": {"type": "prismatic", "between": ["ground", "belt"], "axis": [1, 0, 0], "drive": f"{turn * SPEED}*t"},
    }
    joints["body"]["position"] = [0, height, 0]
    constraints = {"first": law | {"point": "body.first"}, "second": law | {"point": "body.second", "plane": "belt"}}
    mechanism = {"mechanism": "feet", "gravity": [0, 0, -GRAVITY], "parts": parts, "joints": joints}
    return Simulation.from_text(json.dumps(mechanism | {"constraints": constraints}), step=STEP)


def admitted(turn, side, height, inertia, law):
    """The accelerations (x, z, angle) of all modes that Coulomb's law and the complementarity of both feet admit."""
    along, up = ([np.array(row) for row in rows] for rows in ([[1, 0, height]] * 2, [[0, 1, x] for x in side]))
    weights, found = np.array([1.0, 1.0, 1.0 / inertia]), []
    for first, second in itertools.product(("open", "sticks", 1, -1), (False, True)):
        held = [up[0]] * (first != "open") + [along[0]] * (first == "sticks") + [up[1]] * second
        pushed = [up[0]] if first in ("open", "sticks") else [up[0] - first * law["friction"] * along[0]]
        pushed = pushed * (first != "open") + [along[0]] * (first == "sticks")
        pushed += [up[1] + turn * law["friction"] * along[1]] * second
        free = weights * np.array([0.0, -GRAVITY, 0.0])
        if not held:
            continue
        forces = np.linalg.solve(np.array(held) @ (weights[:, None] * np.array(pushed).T), -np.array(held) @ free)
        rates = free + weights * (np.array(pushed).T @ forces)
        is_admitted = up[0] @ rates > 0.0 if first == "open" else forces[0] > 0.0
        is_admitted &= forces[-1] > 0.0 if second else up[1] @ rates > 0.0
        if first == "sticks":
            is_admitted &= abs(forces[1]) <= law["static_friction"] * forces[0]
        elif first != "open":
            is_admitted &= first * (along[0] @ rates) > 0.0
        if is_admitted:
            found.append(rates)
    return found


def random_feet(chance):
    """What `standing` takes; the center of mass is beside the first foot by a share of their distance."""
    distance, friction = chance.uniform(0.01, 0.3), chance.uniform(0.1, 0.9)
    side = np.array([0.0, distance]) - distance * chance.uniform(-1.0, 1.5)
    law = {"friction": friction, "static_friction": friction * chance.uniform(1.0, 1.5)}
    return int(chance.choice([-1, 1])), side.tolist(), chance.uniform(0.1, 1.5), chance.uniform(0.01, 1.0), law


def is_admitted(simulation, laws):
    """Whether the body is accelerated as one of the modes says."""
    return any(np.allclose(simulation.u_rates[:3], rates, rtol=1e-9, atol=1e-9) for rates in laws)


def test_feet_that_begin_to_bear_move_as_the_laws_admit():
    """The foot on the ground was found sliding against its acceleration, in the direction in which it moved while open."""
    chance, several = np.random.default_rng(5), 0
    for _ in range(14):
        given = random_feet(chance)
        laws = admitted(*given)
        several += len(laws) > 1
        assert is_admitted(standing(*given), laws)
    assert several >= 3
