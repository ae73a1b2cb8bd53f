"""A consistent start: loops closed by Newton around the start values that are given, and speeds that fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.geometry.pose import Array

CLOSED = 1e-10  # relative to the mechanism's size, what may stay open
FITTING = 1e-9  # relative to the speeds, what a given speed may miss
RANK = 1e-9  # of the largest singular value, what counts as none
ITERATIONS, STARTS, LONGEST = 60, 30, 0.6
STALLED = 1e-4  # of the gap, what a step must close at least


@dataclass(frozen=True, eq=False)
class Conditions:
    """The constraints as numbers.

    `position(t, q)` (m,) is Φ, zero in nonholonomic rows; `gradient(t, q)` (m, nv) is G; `drift(t, q)` (m,) is b, with
    G u + b = 0; `mass(t, q)` (nv, nv); `senses(t, q)` are positive the right way round. `moved(q, d)` is q after a
    small displacement d (nv,) along the speeds, with unit quaternions. `size` in m is that of the mechanism.
    """

    position: Callable[[float, Array], Array]
    gradient: Callable[[float, Array], Array]
    drift: Callable[[float, Array], Array]
    mass: Callable[[float, Array], Array]
    senses: Callable[[float, Array], Array]
    moved: Callable[[Array, Array], Array]
    size: float
    holonomic: Array


@dataclass(frozen=True, eq=False)
class Closing:
    """Coordinates (nq,) as near to closed as was found; `gaps` (m,) are what stays open, in m or 1."""

    q: Array
    gaps: Array
    closed: bool


@np.errstate(over="ignore", invalid="ignore")
def close_loops(conditions: Conditions, t: float, q: Array, free: Array) -> Closing:
    """Move the `free` (nv,) coordinates until the constraints hold, as little as Newton's steps do.

    Where a guess does not lead there, others around it are tried, the same ones each time.
    """
    random = np.random.default_rng(0)
    best = _newton(conditions, t, q, free)
    for attempt in range(STARTS):
        if best.closed or not free.any():
            break
        scatter = random.normal(size=len(free)) * free * min(2.0, 0.1 * 1.3**attempt)
        other = _newton(conditions, t, conditions.moved(q, scatter), free)
        if other.closed or not np.linalg.norm(best.gaps) <= np.linalg.norm(other.gaps):
            best = other
    return best


@np.errstate(over="ignore", invalid="ignore")
def _newton(conditions: Conditions, t: float, q: Array, free: Array) -> Closing:
    """Gauss and Newton with steps of least norm, shortened while the gap would grow or have no value."""
    gaps = conditions.position(t, q)
    for _ in range(ITERATIONS):
        norm = float(np.linalg.norm(gaps))
        if norm == 0.0:
            break
        slope = conditions.gradient(t, q)[conditions.holonomic][:, free]
        if not (np.isfinite(norm) and np.all(np.isfinite(slope))):
            break
        step = np.zeros(len(free))
        if slope.size:
            step[free] = -np.linalg.lstsq(slope, gaps[conditions.holonomic], rcond=RANK)[0]
        step *= min(1.0, LONGEST / max(float(np.max(np.abs(step), initial=0.0)), 1e-300))
        for _ in range(12):
            tried = conditions.moved(q, step)
            open_ = conditions.position(t, tried)
            if np.linalg.norm(open_) < norm:
                break
            step *= 0.5
        else:
            break
        q, gaps = tried, open_
        if np.linalg.norm(gaps) > (1.0 - STALLED) * norm:
            break
    closed = bool(np.all(np.abs(gaps) <= CLOSED * conditions.size))
    upright = bool(np.all(conditions.senses(t, q) > 0.0))
    return Closing(q, gaps, closed and upright)


def without_value(conditions: Conditions, t: float, q: Array) -> Array:
    """The rows (m,) that have no finite value or derivative, such as the length of a cable between points that meet."""
    values = [conditions.position(t, q), conditions.drift(t, q), *conditions.gradient(t, q).T]
    return np.asarray(~np.all(np.isfinite(values), axis=0), dtype=bool)


@dataclass(frozen=True, eq=False)
class Speeds:
    """Speeds (nv,); `misses` (m,) is what the constraints' velocities are off where they cannot be met."""

    u: Array
    misses: Array
    fitting: bool


def fit_speeds(conditions: Conditions, t: float, q: Array, u: Array, held: Array) -> Speeds:
    """The speeds of least kinetic energy that meet the constraints and the `held` (nv,) values of u."""
    gradient, drift = conditions.gradient(t, q), conditions.drift(t, q)
    kept = np.eye(len(u))[held]
    rows, wanted = np.vstack([gradient, kept]), np.concatenate([-drift, u[held]])
    if not rows.size:
        return Speeds(np.zeros(len(u)), np.zeros(0), True)
    found = _least_speeds(conditions.mass(t, q), rows, wanted)
    found[held] = u[held]
    misses = gradient @ found + drift
    sizes = np.linalg.norm(gradient, axis=1) * np.linalg.norm(found)
    allowed = FITTING * (sizes + np.abs(drift) + conditions.size * 1e-3)
    return Speeds(found, misses, bool(np.all(np.abs(misses) <= allowed)))


def nearest_speeds(conditions: Conditions, t: float, q: Array, u: Array) -> Array:
    """The speeds that meet the constraints with the least kinetic energy of the change from u (nv,)."""
    gradient = conditions.gradient(t, q)
    return u - _least_speeds(conditions.mass(t, q), gradient, gradient @ u + conditions.drift(t, q))


def _least_speeds(mass: Array, rows: Array, wanted: Array) -> Array:
    """The speeds u of least kinetic energy with rows @ u = `wanted`, refined once, whatever the units of the rows."""
    to_unit = _unit_speeds(mass)
    scaled = rows @ to_unit
    sizes = np.linalg.norm(scaled, axis=1)
    sizes[np.linalg.norm(rows, axis=1) < 1e-12] = np.inf
    scaled /= sizes[:, None]
    found: Array = np.zeros(len(mass))
    for _ in range(2):
        found += to_unit @ np.linalg.lstsq(scaled, (wanted - rows @ found) / sizes, rcond=RANK)[0]
    return found


def _unit_speeds(mass: Array) -> Array:
    """Combinations of speeds (nv, nv) whose kinetic energy is ½ each; those without inertia count a little."""
    weights, axes = np.linalg.eigh(mass)
    combinations: Array = axes / np.sqrt(np.maximum(weights, 1e-12 * max(weights.max(initial=0.0), 1e-300)))
    return combinations


def nearby(conditions: Conditions, q: Array, times: Sequence[float], steps: int = 12) -> list[tuple[float, Array]]:
    """Configurations around a closed one: along directions that the constraints leave, and later in time."""
    random = np.random.default_rng(1)
    found = [(0.0, q)]
    everything = np.ones(conditions.gradient(0.0, q).shape[1], dtype=bool)
    for sign in (1.0, -1.0):
        at, direction = q, None
        for _ in range(steps // 2):
            directions = null_space(conditions.gradient(0.0, at))
            if not directions.shape[1]:
                break
            wish = random.normal(size=directions.shape[1]) if direction is None else directions.T @ direction
            direction = directions @ wish
            direction *= sign if len(found) == 1 else 1.0
            direction /= max(float(np.max(np.abs(direction))), 1e-300)
            closing = _newton(conditions, 0.0, conditions.moved(at, 0.15 * direction), everything)
            if not closing.closed or without_value(conditions, 0.0, closing.q).any():
                break
            at = closing.q
            found.append((0.0, at))
    at = q
    for t in times:
        closing = _newton(conditions, t, at, everything)
        if not closing.closed or without_value(conditions, t, closing.q).any():
            break
        at = closing.q
        found.append((t, at))
    return found


def null_space(matrix: Array) -> Array:
    """An orthonormal basis (n, k) of what a matrix (m, n) maps to zero."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    if matrix.shape[0] > matrix.shape[1]:
        matrix = np.asarray(np.linalg.qr(matrix, mode="r"))  # the same null space, from fewer rows
    _, values, axes = np.linalg.svd(matrix)
    rank = int(np.sum(values > RANK * max(values.max(initial=0.0), 1e-300)))
    return np.ascontiguousarray(axes[rank:].T)


def independent_rows(gradients: Sequence[Array]) -> tuple[list[int], list[int]]:
    """Rows that span all others in as many configurations as possible, and the rank of G in each configuration.

    Rows are chosen one by one, each for what it adds where it adds least.
    """
    unit = [_unit_rows(gradient) for gradient in gradients]
    ranks = [rank_of(gradient) for gradient in unit]
    most = max(ranks)
    return _greedy([gradient for gradient, rank in zip(unit, ranks, strict=True) if rank == most], most), ranks


def rank_of(matrix: Array) -> int:
    """The rank of a matrix with rows of order one, to round-off of the assembly."""
    return int(np.linalg.matrix_rank(matrix, tol=RANK)) if matrix.size else 0


def _unit_rows(gradient: Array) -> Array:
    size = np.linalg.norm(gradient, axis=1, keepdims=True)
    unit: Array = np.divide(gradient, size, out=np.zeros_like(gradient), where=size > 1e-12)
    return unit


def _greedy(gradients: Sequence[Array], rank: int) -> list[int]:
    rest = [gradient.copy() for gradient in gradients]
    chosen: list[int] = []
    for _ in range(rank):
        gain = np.min([np.linalg.norm(matrix, axis=1) for matrix in rest], axis=0)
        gain[chosen] = 0.0
        best = int(np.argmax(gain > 0.99 * gain.max()))
        chosen.append(best)
        for matrix in rest:
            size = np.linalg.norm(matrix[best])
            if size > 0.0:
                direction = matrix[best] / size
                matrix -= np.outer(matrix @ direction, direction)
    return sorted(chosen)
