"""A body on two feet, one of them on a moving belt: its accelerations are those of a mode that the laws admit.

There can be several: friction of the foot on the belt can lift the other one, which could bear the body as well.
"""

from __future__ import annotations

import itertools

import numpy as np

from mbd_sim import Simulation

GRAVITY, SPEED, STEP = 10.0, 0.5, 1e-6


# At rest above a floor and a belt; all of its numbers are live values.
FEET = """
mechanism: feet
gravity: [0, 0, -10]
parameters: {a: 0, b: 0.1, height: 1, inertia: 1, speed: 0.5, friction: 0.5, static: 0.6}
parts:
  body: {mass: 1, inertia: [inertia, inertia, inertia], points: {first: [a, 0, -height], second: [b, 0, -height]}}
  belt: {mass: 1, inertia: [1, 1, 1]}
joints:
  body: {type: planar, between: [ground, body], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [0, 9, 0]}
  belt: {type: prismatic, between: [ground, belt], axis: [1, 0, 0], drive: speed*t}
constraints:
  first: {type: on_plane, bound: at_least, point: body.first, friction: friction, static_friction: static}
  second: {type: on_plane, bound: at_least, point: body.second, plane: belt, friction: friction, static_friction: static}
"""


def stand(simulation, turn, side, height, inertia, law):
    """A body of 1 kg, whose center of mass is above the origin, at rest; the belt runs to one side."""
    values = {"a": side[0], "b": side[1], "height": height, "inertia": inertia, "speed": turn * SPEED}
    simulation.reset()
    simulation.set_live(values | {"friction": law["friction"], "static": law["static_friction"]})
    simulation.reset([0.0, height, 0.0])


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
    simulation = Simulation.from_text(FEET, step=STEP, live=["parameters.*"])
    chance, several = np.random.default_rng(5), 0
    for _ in range(14):
        given = random_feet(chance)
        laws = admitted(*given)
        several += len(laws) > 1
        stand(simulation, *given)
        assert is_admitted(simulation, laws)
    assert several >= 3
