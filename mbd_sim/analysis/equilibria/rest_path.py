"""Paths of rest: the configurations in which a load that is taken away step by step holds a mechanism.

The path is followed by a predictor along its tangent and Newton's method, past the points at which the load turns back.
It does not move along directions in which nothing changes, such as that of a cart on a level rail.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mbd_sim.analysis.equilibria.rest_balance import Rest, RestBalance, RestSlopes
from mbd_sim.base.geometry.pose import Array

SINGULAR = 1e-10  # singular values up to this fraction of the largest, or this, count as zero
BALANCED, CORRECTED = 1e-9, 1e-7  # what may remain of the balance at an equilibrium, and along the path
SHORT = 1e-8  # Newton's last step to an equilibrium
STATIONARY = 1e-7  # the least part of the load in a tangent
FIRST, LEAST, LONGEST = 0.02, 1e-7, 1e12  # lengths of steps
LARGEST_TURN = 0.2  # rad in a step
STRAIGHT, BENT = 0.995, 0.9  # cosines of the angle between tangents with which steps become longer, and shorter
SLOW, SETTLED = (
    0.5,
    1e-4,
)  # the first step of time while it sinks, and the balance from which on Newton's method goes on
STEPS, CORRECTIONS, ITERATIONS, SETTLING = 300, 6, 60, 200


@dataclass(frozen=True, eq=False)
class _Place:
    """A point of the path, and the tangent (nv + s + 1,) there."""

    rest: Rest
    tangent: Array


def equilibria_along(balance: RestBalance, direction: float, within: float = math.inf) -> Iterator[Rest]:
    """The equilibria on the path from the start, in their order.

    :param direction: 1 where the load falls at first, -1 where it grows.
    :param within: the distance from the start in m at which the path ends.
    """
    falling = np.append(np.zeros(len(balance.force) - 1), -1.0)
    slopes = balance.slopes(balance.start)
    first = _tangent(slopes, falling)
    if first is None or abs(first[-1]) <= STATIONARY:
        first = _tangent(slopes, balance.force)
    if first is None:
        return
    place, length = _Place(balance.start, direction * first), FIRST
    for number in range(STEPS):
        following, length = _next(balance, place, length)
        if following is None:
            return
        before, after = place.rest.load, following.rest.load
        if before * after <= 0.0 and before != after:
            nearer = place if abs(before) < abs(after) else following
            if (found := balanced(balance, nearer.rest)) is None:
                return
            yield found
        place = following
        away = balance.from_start(place.rest)
        away[-1] = place.rest.load - 1.0
        if balance.distance(place.rest) > within or (number > 2 and np.linalg.norm(away) < 0.5 * length):
            return  # too far, or back at the start


def balanced(balance: RestBalance, guess: Rest) -> Rest | None:
    """The equilibrium next to a configuration by Newton's method, of a family the one nearest to the start."""
    rest, drawn = replace(guess, load=0.0), True
    for _ in range(ITERATIONS):
        remaining, slopes = balance.at(rest), balance.slopes(rest)
        size = float(np.linalg.norm(remaining))
        if not (np.isfinite(size) and np.all(np.isfinite(slopes.matrix))):
            return None
        step, neutral = _newton_step(slopes.matrix[:, :-1], remaining)
        back = neutral.T @ (neutral @ -slopes.along(balance.from_start(rest))[:-1]) if drawn else np.zeros_like(step)
        whole = slopes.whole(np.append(step + back, 0.0))
        moved = balance.moved(rest, whole * _shortening(balance, whole))
        if moved is None:
            return None
        if size <= BALANCED and back.any() and not np.linalg.norm(balance.at(moved)) <= BALANCED:
            drawn = False  # a family that bends away from the start, or a direction that only looks neutral
            continue
        if size <= BALANCED and np.linalg.norm(whole) <= SHORT * (1.0 + np.linalg.norm(balance.from_start(rest))):
            return moved
        rest = moved
    return None


def settled(balance: RestBalance) -> Rest | None:
    """The equilibrium in which the mechanism comes to rest if it sinks very slowly from its start.

    That is ζ' = r(ζ) with the balance r, by the implicit method of Euler, with steps that grow as it comes to rest.
    """
    rest, pause = replace(balance.start, load=0.0), SLOW
    remaining = balance.at(rest)
    size = float(np.linalg.norm(remaining))
    for _ in range(SETTLING):
        if size <= SETTLED:
            return balanced(balance, rest)
        slopes = balance.slopes(rest)
        if not np.all(np.isfinite(slopes.matrix)):
            return None
        matrix = slopes.matrix[:, :-1]
        along = np.vstack([slopes.free.T @ matrix[: len(slopes.free)], matrix[len(slopes.free) :]])
        pushed = np.concatenate([slopes.free.T @ remaining[: len(slopes.free)], remaining[len(slopes.free) :]])
        step = np.linalg.lstsq(np.eye(len(along)) / pause - along, pushed, rcond=None)[0]
        whole = slopes.whole(np.append(step, 0.0))
        turn = balance.turned_by(whole)
        moved = balance.moved(rest, whole * min(1.0, LARGEST_TURN / max(turn, 1e-300)))
        if moved is None:
            pause *= 0.25
            continue
        rest, remaining = moved, balance.at(moved)
        before, size = size, float(np.linalg.norm(remaining))
        if not np.isfinite(size):
            return None
        pause = min(pause * min(max(before / max(size, 1e-300), 0.5), 2.0), 1e12) if turn <= LARGEST_TURN else pause
    return None


def _tangent(slopes: RestSlopes, near: Array) -> Array | None:
    """The tangent (nv + s + 1,), on the side of another direction, which it follows where the load is stationary.

    It has no part along directions in which nothing changes.
    """
    if not np.all(np.isfinite(slopes.matrix)):
        return None
    _, along = _newton_step(slopes.matrix, np.zeros(len(slopes.matrix)))
    tangent, wanted = along.T @ along[:, -1], slopes.along(near)
    if np.linalg.norm(tangent) <= STATIONARY:
        tangent = along.T @ (along @ wanted)
    size = float(np.linalg.norm(tangent))
    return slopes.whole(tangent * ((1.0 if tangent @ wanted >= 0.0 else -1.0) / size)) if size > STATIONARY else None


def _next(balance: RestBalance, place: _Place, length: float) -> tuple[_Place | None, float]:
    """The next point of the path, None if there is none, and the length of the step after it."""
    while length >= LEAST:
        step = length * place.tangent
        step *= min(1.0, LARGEST_TURN / max(balance.turned_by(step), 1e-300))
        found = _corrected(balance, place, step)
        if found is not None and (cosine := float(found.tangent @ place.tangent)) >= BENT:
            taken = float(np.linalg.norm(step))
            return found, min(2.0 * taken if cosine >= STRAIGHT else taken, LONGEST)
        length = 0.4 * min(length, float(np.linalg.norm(step)))
    return None, length


def _corrected(balance: RestBalance, place: _Place, step: Array) -> _Place | None:
    """The point of the path next to where a step leads; None if Newton's method does not find it quickly."""
    rest = balance.moved(place.rest, step)
    for _ in range(CORRECTIONS):
        if rest is None:
            return None
        remaining, slopes = balance.at(rest), balance.slopes(rest)
        if not (np.all(np.isfinite(remaining)) and np.all(np.isfinite(slopes.matrix))):
            return None
        whole = slopes.whole(_newton_step(slopes.matrix, remaining)[0])
        size = float(np.linalg.norm(whole))
        if size <= CORRECTED * (1.0 + float(np.linalg.norm(step))) and np.linalg.norm(remaining) <= CORRECTED:
            tangent = _tangent(slopes, place.tangent)
            return None if tangent is None else _Place(balance.turned(rest), tangent)
        if size > 0.5 * np.linalg.norm(step):
            return None
        rest = balance.moved(rest, whole)
    return None


def _newton_step(matrix: Array, remaining: Array) -> tuple[Array, Array]:
    """The least step that balances linearized forces, and an orthonormal basis (k, n) of those that change nothing."""
    left, values, axes = np.linalg.svd(matrix)
    count = int(np.sum(values > SINGULAR * max(1.0, float(np.max(values, initial=0.0)))))
    step = -axes[:count].T @ (left[:, :count].T @ remaining / values[:count])
    return np.asarray(step), axes[count:]


def _shortening(balance: RestBalance, step: Array) -> float:
    return min(1.0, LARGEST_TURN / max(balance.turned_by(step), 1e-300))
