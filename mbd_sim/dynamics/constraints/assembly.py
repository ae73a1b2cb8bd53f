"""The assembly of mechanisms: loops closed by Newton's method, and speeds that satisfy the constraints.

Many variants of a mechanism can be assembled at once, each with the bits that it would get alone: the operations are
the same, on arrays with a row for each variant. Variants for which Newton's method fails, whose constraints are
undefined, whose speeds are not consistent, or which start with speeds in a singular configuration, are left to the
functions for a single mechanism.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base import linear_algebra as la
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import norm as norm_of
from mbd_sim.base.linear_algebra import norms, product
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions, ManyConstraints, scaled
from mbd_sim.dynamics.math.rank import RANK, least_solution, least_solutions, row_is_zero

CLOSED = 1e-10  # tolerated gap, relative to the natural size of its row
CONSISTENT = 1e-9  # tolerated error of given speeds, relative to the speeds
ITERATIONS, ATTEMPTS = 60, 30
FAR_ITERATIONS = 120
LONGEST_STEP = 0.6  # rad, or the same share of the size of the mechanism
CONVERGED = 1e-6  # step that may remain at a solution far away, relative to 1 + |q| in natural units
WEIGHTLESS = 1e-12  # the least inertia that counts, relative to the largest
STALLED = 1e-4  # an iteration that reduces the gap by less than this fraction is the last


@dataclass(frozen=True, eq=False)
class ClosingStep:
    """A step from coordinates `q` (nq,): `factor` times that of least norm, or a `displacement` to another guess.

    It moves no coordinate by more than `longest`, in natural units.
    """

    q: Array
    displacement: Array | None
    factor: float
    longest: float = LONGEST_STEP


@dataclass(frozen=True, eq=False)
class LoopClosure:
    """The coordinates (nq,) with the smallest gap that was found; `gaps` (m,) remain, in m or 1.

    The `path` are the steps that led there.
    """

    q: Array
    gaps: Array
    closed: bool
    path: tuple[ClosingStep, ...] = ()


@np.errstate(over="ignore", invalid="ignore")
def close_loops(constraints: ConstraintFunctions, t: float, q: Array, free: Array | NDArray[np.bool_]) -> LoopClosure:
    """Move the `free` (nv,) coordinates as little as possible so that the constraints are satisfied at time t.

    If Newton's method fails from q, it is tried from other guesses around q, the same ones in every run, and then
    from q with steps that grow, for a mechanism that is many meters large. Gaps that only vanish at infinity, as 1/x
    does, stay open.
    """
    random = np.random.default_rng(0)
    best = _newton(constraints, t, q, free)
    for attempt in range(ATTEMPTS):
        if best.closed or not free.any():
            break
        scatter = constraints.scales * random.normal(size=len(free)) * free * min(2.0, 0.1 * 1.3**attempt)
        other = _newton(constraints, t, constraints.displaced(q, scatter), free)
        if other.closed or not norm_of(best.gaps) <= norm_of(other.gaps):
            best = replace(other, path=(ClosingStep(q, scatter, 1.0), *other.path))
    if best.closed or not free.any():
        return best
    far = _newton(constraints, t, q, free, far=True)
    return far if far.closed and _converged(constraints, t, far, free) else best


def close_nearby(
    constraints: ConstraintFunctions, t: float, q: Array, free: NDArray[np.bool_] | None = None
) -> LoopClosure:
    """Close loops by Newton's method from q alone, to follow a path without jumps; by default all (nv,) are `free`."""
    return _newton(constraints, t, q, np.ones(len(constraints.scales), dtype=bool) if free is None else free)


def _converged(constraints: ConstraintFunctions, t: float, found: LoopClosure, free: Array | NDArray[np.bool_]) -> bool:
    """Whether Newton's next step is short; towards a solution at infinity, each one is about as long as q."""
    step = _least_step(constraints, t, found.q, found.gaps, free)
    return step is not None and is_short(constraints, constraints.scales * step, found.q)


def _least_step(
    constraints: ConstraintFunctions, t: float, q: Array, gaps: Array, free: Array | NDArray[np.bool_]
) -> Array | None:
    """The displacement (nv,) in natural units, of least norm, that closes linearized gaps; None if it is undefined."""
    sizes = constraints.row_sizes(t, q)
    slope = scaled(constraints.gradient(t, q), sizes, constraints.scales)
    rows = np.logical_and(constraints.holonomic, sizes > 0.0)
    slope = slope[rows][:, free]
    if not (np.all(np.isfinite(gaps)) and np.all(np.isfinite(slope))):
        return None
    step = np.zeros(len(free))
    step[free] = -least_solution(slope, gaps[rows] / sizes[rows])
    return step


def is_short(constraints: ConstraintFunctions, step: Array, q: Array) -> bool:
    """Whether a step (nv,) is short enough for Newton's method to have converged at q, however far away."""
    size = float(np.max(np.abs(step / constraints.scales), initial=0.0))
    return size <= CONVERGED * (1.0 + float(np.max(np.abs(q / constraints.coordinate_scales), initial=0.0)))


@np.errstate(over="ignore", invalid="ignore")
def _newton(
    constraints: ConstraintFunctions, t: float, q: Array, free: Array | NDArray[np.bool_], far: bool = False
) -> LoopClosure:
    """Gauss-Newton with steps of least norm, shortened while the gap would grow or become undefined.

    If the solution may be `far` away, the longest step doubles after each one that it limits.
    """
    gaps, path, longest = constraints.position(t, q), list[ClosingStep](), LONGEST_STEP
    for _ in range(FAR_ITERATIONS if far else ITERATIONS):
        norm = norm_of(gaps)
        if norm == 0.0:
            break
        step = _least_step(constraints, t, q, gaps, free)
        if step is None:
            break
        factor = min(1.0, longest / max(float(np.max(np.abs(step), initial=0.0)), 1e-300))
        growing = far and factor < 1.0
        step = factor * constraints.scales * step
        for _ in range(12):
            next_q = constraints.displaced(q, step)
            next_gaps = constraints.position(t, next_q)
            if norm_of(next_gaps) < norm:
                break
            step *= 0.5
            factor *= 0.5
        else:
            break
        path.append(ClosingStep(q, None, factor, longest))
        q, gaps = next_q, next_gaps
        if growing:
            longest *= 2.0
        elif norm_of(gaps) > (1.0 - STALLED) * norm:
            break
    closed = bool(np.all(np.abs(gaps) <= CLOSED * constraints.row_sizes(t, q)))
    right_branch = bool(np.all(constraints.branch_checks(t, q) > 0.0))
    return LoopClosure(q, gaps, closed and right_branch, tuple(path))


def undefined_rows(constraints: ConstraintFunctions, t: float, q: Array) -> Array:
    """Which rows (m,) have no finite value or derivative, such as the length of a cable between coincident points."""
    values = [constraints.position(t, q), constraints.drift(t, q), *constraints.gradient(t, q).T]
    return np.asarray(~np.all(np.isfinite(values), axis=0), dtype=bool)


@dataclass(frozen=True, eq=False)
class FittedSpeeds:
    """Speeds u (nv,), the violation `errors` (m,) of the velocity constraints, and whether that is tolerable."""

    u: Array
    errors: Array
    consistent: bool


def fit_speeds(constraints: ConstraintFunctions, t: float, q: Array, u: Array, fixed: Array) -> FittedSpeeds:
    """The speeds of least kinetic energy that satisfy the constraints and keep the `fixed` (nv,) entries of u.

    Where no constraint restricts them, as with bearings that repeat each other, all others are zero.
    """
    gradient, drift = constraints.gradient(t, q), constraints.drift(t, q)
    speeds = np.zeros(len(u))
    if constraints.rank(t, q):
        resting = resting_speeds(constraints.mass_matrix(t, q), constraints.momentum(t, q), constraints.scales)
        right = np.concatenate([-drift - product(gradient, resting), (u - resting)[fixed]])
        speeds = resting + _least_energy_speeds(constraints, t, q, fixed, right)
    speeds[fixed] = u[fixed]
    errors = product(gradient, speeds) + drift
    tolerated = tolerated_errors(constraints, t, q, speeds)  # undefined at rest for a row of infinite size
    return FittedSpeeds(speeds, errors, bool(np.all((errors == 0.0) | (np.abs(errors) <= tolerated))))


def tolerated_errors(constraints: ConstraintFunctions, t: float, q: Array, u: Array) -> Array:
    """The errors (m,) of G u + b that count as round-off of given speeds u."""
    rate = float(np.max(np.abs(u) / constraints.scales, initial=constraints.rate_of_drives(t, q)))
    return CONSISTENT * (constraints.row_sizes(t, q) * rate + np.abs(constraints.drift(t, q)))


def nearest_speeds(constraints: ConstraintFunctions, t: float, q: Array, u: Array, fixed: Array | None = None) -> Array:
    """The speeds (nv,) that satisfy the constraints with the least kinetic energy of the change from u.

    With `fixed` (nv,), these entries stay; if they contradict the constraints, a violation remains.
    """
    violation = product(constraints.gradient(t, q), u) + constraints.drift(t, q)
    if fixed is None:
        fixed = np.zeros(len(u), dtype=bool)
    change = _least_energy_speeds(constraints, t, q, fixed, np.concatenate([violation, np.zeros(fixed.sum())]))
    return np.where(fixed, u, u - change)


def resting_speeds(mass_matrix: Array, momentum: Array, scales: Array) -> Array:
    """The speeds (nv,) of least kinetic energy ½ uᵀ M u + pᵀ u without constraints; those without inertia are zero.

    Inertias are compared in the natural units of the coordinates, of which (nv,) are the `scales`.
    """
    if not momentum.any():
        return np.zeros(len(momentum))
    weights, axes = la.eigh(mass_matrix * scales * scales[:, None])
    heavy = weights > WEIGHTLESS * weights.max()
    along = product(axes[:, heavy].T, scales * momentum) / weights[heavy]
    return np.asarray(-scales * product(axes[:, heavy], along))


def _least_energy_speeds(constraints: ConstraintFunctions, t: float, q: Array, fixed: Array, right: Array) -> Array:
    """The speeds u (nv,) of least kinetic energy with G u and then the `fixed` of u equal to `right`; refined once."""
    gradient = constraints.gradient(t, q)
    sizes, scales = constraints.row_sizes(t, q), constraints.scales
    rows = np.vstack([gradient, np.eye(len(scales))[fixed]])
    zero = np.concatenate([row_is_zero(scaled(gradient, sizes, scales)), np.zeros(int(fixed.sum()), dtype=bool)])
    to_unit, unit, lengths = energy_rows(constraints.mass_matrix(t, q), rows, zero, scales)
    u: Array = np.zeros(len(scales))
    for _ in range(2):
        u += product(to_unit, least_solution(unit, (right - product(rows, u)) / lengths))
    return u


def energy_rows(mass_matrix: Array, rows: Array, zero: NDArray[np.bool_], scales: Array) -> tuple[Array, Array, Array]:
    """Combinations (nv, nv) of speeds with unit energy, and rows (m, nv) in these: of unit length, and their lengths.

    Rows that are `zero` (m,) have an infinite length. Speeds without inertia get a small one; if nothing has inertia,
    each speed in its natural unit gets the same.
    """
    weights, axes = la.eigh(mass_matrix * scales * scales[:, None])
    least = WEIGHTLESS * weights.max(initial=0.0)
    to_unit: Array = scales[:, None] * axes / np.sqrt(np.maximum(weights, least if least > 0.0 else 1.0))
    found = product(rows, to_unit)
    lengths = norms(found)
    lengths[zero] = np.inf
    return to_unit, found / lengths[:, None], lengths


def nearby_configurations(
    constraints: ConstraintFunctions, q: Array, times: Sequence[float], steps: int = 12
) -> list[tuple[float, Array]]:
    """Pairs (t, q) around an assembled configuration: along free directions at t = 0, and at later `times`."""
    random = np.random.default_rng(1)
    configurations = [(0.0, q)]
    all_free = np.ones(constraints.gradient(0.0, q).shape[1], dtype=bool)
    for sign in (1.0, -1.0):
        at, direction = q, None
        for _ in range(steps // 2):
            directions = constraints.free_directions(0.0, at)
            if not directions.shape[1]:
                break
            weights = random.normal(size=directions.shape[1]) if direction is None else product(directions.T, direction)
            direction = product(directions, weights)
            direction *= sign if len(configurations) == 1 else 1.0
            direction /= max(float(np.max(np.abs(direction) / constraints.scales)), 1e-300)
            closure = _newton(constraints, 0.0, constraints.displaced(at, 0.15 * direction), all_free)
            if not closure.closed or undefined_rows(constraints, 0.0, closure.q).any():
                break
            at = closure.q
            configurations.append((0.0, at))
    at = q
    for t in times:
        closure = _newton(constraints, t, at, all_free)
        if not closure.closed or undefined_rows(constraints, t, closure.q).any():
            break
        at = closure.q
        configurations.append((t, at))
    return configurations


def configurations_of_drives(
    constraints: ConstraintFunctions, q: Array, positions: Sequence[int]
) -> list[tuple[float, Array]]:
    """Pairs (0, q) around an assembled configuration, to which drives that follow commands may take it.

    :param positions: the indices in q of their positions.
    """
    all_free = np.ones(constraints.gradient(0.0, q).shape[1], dtype=bool)
    configurations = []
    for index in positions:
        for change in (0.15, -0.15):
            moved = q.copy()
            moved[index] += change * constraints.coordinate_scales[index]
            closure = _newton(constraints, 0.0, moved, all_free)
            if closure.closed and not undefined_rows(constraints, 0.0, closure.q).any():
                configurations.append((0.0, closure.q))
    return configurations


HALVINGS = 12


@dataclass(frozen=True, eq=False)
class ManyStarts:
    """Coordinates (k, nq) and speeds (k, nv), and whether those of each variant (k,) satisfy the constraints."""

    q: Array
    u: Array
    assembled: NDArray[np.bool_]


@np.errstate(all="ignore")
def start_many(
    constraints: ManyConstraints,
    q: Array,
    u: Array,
    fixed_q: NDArray[np.bool_],
    fixed_u: NDArray[np.bool_],
    rank: int,
) -> ManyStarts:
    """Close the loops and fit the speeds of all variants at t = 0.

    :param q: (k, nq) and `u` (k, nv) of the file.
    :param fixed_q: (nv,) which coordinates are kept, as displacements; `fixed_u` (nv,) which speeds.
    :param rank: of the constraint matrix almost everywhere.
    """
    q, closed = _closed(constraints, q, ~fixed_q)
    going = np.flatnonzero(closed & _defined(constraints, q))
    speeds, assembled = np.zeros_like(u), np.zeros(len(q), dtype=bool)
    if going.size:
        speeds[going], consistent = _fitted(constraints, q[going], u[going], fixed_u, going)
        gradient = constraints.gradient(q[going], going)
        matrices = scaled(gradient, constraints.row_sizes(q[going], going), constraints.scales)
        ranks = la.ranks(matrices, RANK)
        assembled[going] = consistent & ((ranks >= rank) | ~speeds[going].any(axis=1))
    return ManyStarts(q, speeds, assembled)


def _defined(constraints: ManyConstraints, q: Array) -> NDArray[np.bool_]:
    """For which variants (k,) all that speeds and ranks are found from is finite."""
    everyone = np.arange(len(q))
    gradient, mass_matrix = constraints.gradient(q, everyone), constraints.mass_matrix(q, everyone)
    values = [array.reshape(len(q), -1) for array in (gradient, constraints.drift(q, everyone), mass_matrix)]
    return np.asarray(np.all(np.isfinite(np.concatenate(values, axis=1)), axis=1))


def _closed(constraints: ManyConstraints, start: Array, free: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Gauss–Newton as for one mechanism; each variant stops by itself."""
    q, going = start.copy(), np.arange(len(start))
    gaps = constraints.position(q, going)
    for _ in range(ITERATIONS):
        norm = norms(gaps[going])
        sizes = constraints.row_sizes(q, going)
        slopes = scaled(constraints.gradient(q, going), sizes, constraints.scales)[:, constraints.holonomic][:, :, free]
        finite = (norm != 0.0) & np.isfinite(norm) & np.all(np.isfinite(slopes), axis=(1, 2))
        going, norm, slopes, sizes = going[finite], norm[finite], slopes[finite], sizes[finite]
        if not going.size:
            break
        step = np.zeros((len(going), len(free)))
        if slopes[0].size:
            held = (array[:, constraints.holonomic] for array in (gaps[going], sizes))
            step[:, free] = _steps(slopes, *held)
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.max(np.abs(step), axis=1), 1e-300))[:, None]
        going = _searched(constraints, q, gaps, going, norm, constraints.scales * step)
    everyone = np.arange(len(q))
    closed = np.all(np.abs(gaps) <= CLOSED * constraints.row_sizes(q, everyone), axis=1)
    return q, closed & np.all(constraints.branch_checks(q, everyone) > 0.0, axis=1)


def _steps(slopes: Array, gaps: Array, sizes: Array) -> Array:
    """The displacements (k, n) of the free coordinates; rows of size zero are left out."""
    counts = sizes > 0.0
    steps = np.zeros((len(slopes), slopes.shape[2]))
    for rows in np.unique(counts, axis=0):
        which = np.all(counts == rows, axis=1)
        right = gaps[which][:, rows] / sizes[which][:, rows]
        steps[which] = -least_solutions(slopes[which][:, rows], right)
    return steps


def _searched(
    constraints: ManyConstraints, q: Array, gaps: Array, going: NDArray[np.intp], norm: Array, step: Array
) -> NDArray[np.intp]:
    """Halve steps until the gap falls, and take them, in place; the variants for which it is worth going on."""
    further: list[NDArray[np.intp]] = []
    for _ in range(HALVINGS):
        moved = constraints.displaced(q[going], step, going)
        moved_gaps = constraints.position(moved, going)
        moved_norm = norms(moved_gaps)
        falls = moved_norm < norm
        taken = going[falls]
        q[taken], gaps[taken] = moved[falls], moved_gaps[falls]
        further.append(taken[~(moved_norm[falls] > (1.0 - STALLED) * norm[falls])])
        going, norm, step = going[~falls], norm[~falls], step[~falls] * 0.5
        if not going.size:
            break
    return np.sort(np.concatenate(further))


def _fitted(
    constraints: ManyConstraints, q: Array, u: Array, fixed: NDArray[np.bool_], which: NDArray[np.intp]
) -> tuple[Array, NDArray[np.bool_]]:
    """The speeds of least kinetic energy of some variants, as for one mechanism."""
    gradient, drift = constraints.gradient(q, which), constraints.drift(q, which)
    selection = np.broadcast_to(np.eye(u.shape[1])[fixed], (len(q), int(fixed.sum()), u.shape[1]))
    rows, right = np.concatenate([gradient, selection], axis=1), np.concatenate([-drift, u[:, fixed]], axis=1)
    if not rows[0].size:
        return np.zeros_like(u), np.ones(len(q), dtype=bool)
    scales, row_sizes = constraints.scales, constraints.row_sizes(q, which)
    given = np.zeros((len(q), int(fixed.sum())), dtype=bool)
    zero_rows = row_is_zero(scaled(gradient, row_sizes, scales))
    zero = np.concatenate([zero_rows, given], axis=1)
    masses, momenta = constraints.mass_matrix(q, which), constraints.momentum(q, which)
    resting = np.array([resting_speeds(*one, scales) for one in zip(masses, momenta, strict=True)])
    right = right - product(rows, resting[:, :, None])[:, :, 0]
    in_energy = [energy_rows(*of_one, scales) for of_one in zip(masses, rows, zero, strict=True)]
    to_unit, unit, lengths = (np.array(each) for each in zip(*in_energy, strict=True))
    speeds = np.zeros_like(u)
    for _ in range(2):
        rest = (right - product(rows, speeds[:, :, None])[:, :, 0]) / lengths
        speeds += product(to_unit, least_solutions(unit, rest)[:, :, None])[:, :, 0]
    speeds = np.where(np.all(zero_rows, axis=1)[:, None], 0.0, speeds + resting)
    speeds[:, fixed] = u[:, fixed]
    errors = product(gradient, speeds[:, :, None])[:, :, 0] + drift
    rates = np.maximum(np.max(np.abs(speeds) / scales, axis=1, initial=0.0), constraints.rate_of_drives(q, which)[:, 0])
    tolerance = CONSISTENT * (row_sizes * rates[:, None] + np.abs(drift))
    return speeds, np.all(np.abs(errors) <= tolerance, axis=1)
