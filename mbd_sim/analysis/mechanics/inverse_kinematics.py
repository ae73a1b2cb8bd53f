"""Inverse kinematics: the coordinates that bring a point or a pose of a part to a target, with all loops closed.

Each step is damped least squares (Levenberg and Marquardt) along the free directions of the loops, with the Jacobian of
the point; then the loops are closed again. Where the error falls slowly or not at all, as near the nearest position to
a target that is out of reach, the step is Newton's: with the curvature of the error along the free directions, from
differences of its gradient. Coordinates at a limit towards which a step points stay there. Drives that follow commands
move as coordinates do, within their ranges, because they can be commanded to any position there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.analysis.mechanics.free_drives import FreeDrives
from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.errors import InputError, listed, nearest
from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import rotation_vector, to_quaternion
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import short_repr
from mbd_sim.dynamics.constraints.assembly import close_loops, close_nearby
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions
from mbd_sim.dynamics.kinematics.frames import frame_function
from mbd_sim.dynamics.math.rank import null_space, rank_of
from mbd_sim.mechanism.spanning_tree import split_reference

ITERATIONS = 200
CONVERGED = 1e-13  # error, in natural units, below which no further step is taken
LEAST_STEP = 1e-12  # in natural units
LONGEST_STEP = 0.5  # in natural units
STALLED, MOST_STALLED = 1e-9, 3  # share by which a step reduces the error too little, and how often it may
SLOW = 0.999  # of the error: where a step leaves more than that, or promises no more, the next one is Newton's
NEGLIGIBLE = 1e-15  # of the square of the error, which a step may still promise where it is the last
DIFFERENCE = 1e-6  # in natural units, for the curvature
FLAT = 1e-6  # of the largest curvature: smaller ones are not distinguished from zero
ALIKE, MOST_ALIKE = 1e-6, 3  # share by which errors differ that count as the same, and how often the same is found
TRIES, TOLERANCE = 30, 1e-9  # by default
DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-13, 1e8

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """What `inverse_kinematics` found: coordinates `q` (nq,), in the order of `Simulation.q`, with all loops closed.

    `positions` are the same in rad and m by the names of coordinates, those of drives that follow commands among them:
    what to command. A free joint has x, y, z and its rotation vector. In q, these drives are at rest.

    If the target is not `reached`, q is the nearest position that was found, where 1 rad counts as much as the size of
    the mechanism, which is its largest part. `distance` in m and `angle` in rad are those from the target, `at_limits`
    names the coordinates that limits hold back there, and `reason` is a sentence about it.
    """

    q: Array
    positions: Mapping[str, float]
    reached: bool
    distance: float
    angle: float
    at_limits: tuple[str, ...] = ()
    reason: str = ""

    __repr__ = short_repr


@interruptible()
def inverse_kinematics(
    kinematics: Kinematics,
    frame: str,
    position: Sequence[float] | Array | None = None,
    rotation: Sequence[Sequence[float]] | Array | None = None,
    *,
    at: Sequence[float] | Array | None = None,
    q: Sequence[float] | Array | None = None,
    time: float = 0.0,
    limits: bool = True,
    tries: int = TRIES,
    tolerance: float = TOLERANCE,
) -> InverseKinematics:
    """The coordinates that bring a point or a frame of a part to a target in ground's frame.

    The solution is one near `q`, if there is one that can be reached from there; else one from other starts, the same
    ones in every run. Of redundant mechanisms, coordinates move as little as the way there takes.

    >>> from mbd_sim import Kinematics, inverse_kinematics, load_mechanism
    >>> arm = Kinematics(load_mechanism("six_axis_arm"))
    >>> target = arm.poses([0.3, 0.4, -0.6, 0.2, 0.5, 0.1])["tool"]
    >>> inverse_kinematics(arm, "tool", target.position, target.rotation).reached
    True

    :param frame: a part, or a point `part.point` with its axes.
    :param position: (3,) in m, where the origin of the frame shall be; None for anywhere.
    :param rotation: (3, 3), how its axes shall stand in ground's; None for any way.
    :param at: (3,) in m, in the axes of the frame, another point that shall be there instead of its origin.
    :param q: (nq,) where to begin, by default at the start.
    :param time: in s, on which drives by expressions depend: these prescribe the motion of their joints.
    :param limits: whether the coordinates stay within the `limits` of their joints, and drives within their ranges.
    :param tries: how many starts are tried.
    :param tolerance: up to which the target counts as reached, in rad and relative to the size of the mechanism.
    :raises ValueError: there is no such frame, or numbers do not fit; or no position from q closes the loops.
    """
    *_, best = improving(kinematics, frame, position, rotation, at, q, time, limits, tries, tolerance)
    return best


def _never() -> bool:
    return False


def improving(
    kinematics: Kinematics,
    frame: str,
    position: Sequence[float] | Array | None,
    rotation: Sequence[Sequence[float]] | Array | None,
    at: Sequence[float] | Array | None = None,
    q: Sequence[float] | Array | None = None,
    time: float = 0.0,
    limits: bool = True,
    tries: int = TRIES,
    tolerance: float = TOLERANCE,
    stop: Callable[[], bool] = _never,
) -> Iterator[InverseKinematics]:
    """The best that was found after each start, of which the last is that of `inverse_kinematics`: first from `q`.

    :param stop: is asked before each step of the search; where it says so, the position found so far is the last.
    """
    free = kinematics.with_free_drives
    drives = FreeDrives(kinematics.layout, free.layout)
    problem = _Reaching(free, frame, at, _target(position, rotation), time, limits)
    random, best, alike = np.random.default_rng(0), None, 0
    start = free.closed(drives.released(kinematics.checked(q)), time)
    for attempt in range(max(1, tries)):
        if best is not None and stop():
            break
        begin = start if attempt == 0 else problem.scattered(random, start)
        if begin is None:
            continue
        found = problem.descended(begin, stop)
        if best is not None and abs(found.error - best.error) <= ALIKE * best.error:
            alike += 1
        if best is None or found.error < best.error:
            best, alike = found, alike if best and found.error > (1.0 - ALIKE) * best.error else 0
        yield problem.answer(best, tolerance, drives)
        if best.error <= tolerance or alike >= MOST_ALIKE:
            break


@dataclass(frozen=True)
class _Target:
    position: Array | None
    rotation: Array | None


def _target(position: Sequence[float] | Array | None, rotation: Sequence[Sequence[float]] | Array | None) -> _Target:
    if position is None and rotation is None:
        raise InputError("there is no target", "Give a position, a rotation or both.")
    at = None if position is None else np.asarray(position, dtype=float)
    turned = None if rotation is None else np.asarray(rotation, dtype=float)
    if at is not None and (at.shape != (3,) or not np.all(np.isfinite(at))):
        raise InputError("the position must be 3 finite numbers", "Give x, y and z in m.")
    if turned is not None and (
        turned.shape != (3, 3)
        or not np.allclose(turned.T @ turned, np.eye(3), atol=1e-9)
        or np.linalg.det(turned) < 0.0
    ):
        raise InputError("the rotation must be a rotation matrix (3, 3)", "Give one, such as that of a Pose.")
    return _Target(at, turned)


@dataclass(frozen=True, eq=False)
class _Found:
    """A position, its residual in natural units, whose norm is the `error`, and which coordinates limits hold."""

    q: Array
    residual: Array
    held: Mask

    @property
    def error(self) -> float:
        return float(np.linalg.norm(self.residual))


class _Reaching:
    """The residual of a frame and its Jacobian, in natural units, and the loops."""

    def __init__(
        self,
        kinematics: Kinematics,
        frame: str,
        at: Sequence[float] | Array | None,
        target: _Target,
        time: float,
        limits: bool,
    ) -> None:
        self.kinematics, self.target, self.time = kinematics, target, time
        self.constraints: ConstraintFunctions = kinematics.constraints
        part, self.local = _frame(kinematics, frame, at)
        traced = kinematics.traced
        self._pose, self._jacobian = (frame_function(traced, part, quantity) for quantity in ("pose", "jacobian"))
        self._y = np.zeros(traced.y.numel())
        self._inputs = np.zeros(traced.inputs.numel())
        self._inputs[traced.input_layout.values] = traced.parameters.base
        self.scales = self.constraints.scales
        self.size = self.constraints.size or 1.0
        self.names, self.places, self.lower, self.upper = _ranges(kinematics, limits)

    def residual(self, q: Array) -> Array:
        """How far the frame is from its target: (position / size, rotation vector in ground's axes)."""
        numbers = self._evaluated(self._pose, q).ravel()
        parts = []
        if self.target.position is not None:
            parts.append((numbers[:3] - self.target.position) / self.size)
        if self.target.rotation is not None:
            turned = numbers[3:].reshape(3, 3).T @ self.local.rotation
            parts.append(rotation_vector(to_quaternion(turned @ self.target.rotation.T)))
        return np.concatenate(parts)

    def jacobian(self, q: Array) -> Array:
        """The derivative (n, nv) of the residual along the speeds in natural units, up to the first order of angles."""
        both = self._evaluated(self._jacobian, q).T * self.scales
        rows = [both[:3] / self.size] if self.target.position is not None else []
        return np.vstack([*rows, *([both[3:]] if self.target.rotation is not None else [])])

    def holonomic_rows(self, q: Array) -> Array:
        """The gradients (m, nv) of the loops in natural units."""
        return np.asarray(self.constraints.scaled_gradient(self.time, q)[self.constraints.holonomic])

    def _evaluated(self, function: ca.Function, q: Array) -> Array:
        self._y[: len(q)] = q
        return np.array(function(self.time, self._y, self._inputs, self.local.position))

    def descended(self, q: Array, stop: Callable[[], bool]) -> _Found:
        """The nearest position downhill from one with closed loops, or as far as the search comes until the stop."""
        q = self._within(q)
        found, damping = _Found(q, self.residual(q), np.zeros(len(self.scales), dtype=bool)), DAMPING
        stalled, curved = 0, False
        for _ in range(ITERATIONS):
            if found.error <= CONVERGED or stalled > MOST_STALLED or stop():
                break
            here = _Vicinity(self, found, curved=curved)
            while damping <= MOST_DAMPING:
                step, held, promise = here.step(damping)
                if not curved and promise <= (1.0 - SLOW) * found.error**2:
                    here, curved = _Vicinity(self, found, curved=True), True
                    continue
                found = _Found(found.q, found.residual, held)
                if float(np.max(np.abs(step), initial=0.0)) < LEAST_STEP:
                    return found
                if (following := self._moved(found.q, step, held)) is not None:
                    taken = _Found(following, self.residual(following), held)
                    if curved and promise <= NEGLIGIBLE * found.error**2:
                        return taken if taken.error <= (1.0 + NEGLIGIBLE) * found.error else found
                    if taken.error < found.error:
                        curved = taken.error > SLOW * found.error
                        stalled = stalled + 1 if taken.error > (1.0 - STALLED) * found.error else 0
                        found, damping = taken, max(LEAST_DAMPING, 0.1 * damping)
                        break
                if curved:
                    damping *= 10.0
                else:
                    here, curved = _Vicinity(self, found, curved=True), True
            else:
                break
        return found

    def beyond(self, q: Array, step: Array) -> Mask:
        """The coordinates at a limit that a step moves beyond it."""
        found = np.zeros(len(step), dtype=bool)
        at, along = q[self.places[1]], step[self.places[0]]
        near = 1e-9 * self.scales[self.places[0]]
        found[self.places[0]] = ((at <= self.lower + near) & (along < 0.0)) | (
            (at >= self.upper - near) & (along > 0.0)
        )
        return found

    def _moved(self, q: Array, step: Array, held: Mask) -> Array | None:
        """The position after a step, with limited coordinates within their limits and closed loops; None if open."""
        moved = self._within(self.constraints.displaced(q, self.scales * step))
        if not np.any(self.constraints.holonomic):
            return moved
        fixed = held.copy()
        for _ in range(len(self.places[0]) + 1):
            closing = close_nearby(self.constraints, self.time, moved, ~fixed)
            if not closing.closed:
                return None
            inside = self._within(closing.q)
            if np.max(np.abs(inside - closing.q), initial=0.0) <= 1e-12:
                return closing.q
            fixed[self.places[0]] |= inside[self.places[1]] != closing.q[self.places[1]]
            moved = inside
        return None

    def _within(self, q: Array) -> Array:
        q = q.copy()
        q[self.places[1]] = np.clip(q[self.places[1]], self.lower, self.upper)
        return q

    def scattered(self, random: np.random.Generator, start: Array) -> Array | None:
        """Another start: anywhere within the limits, or near the first where there are none; None if loops are open."""
        scatter = self.scales * random.uniform(-np.pi, np.pi, len(self.scales))
        q = self.constraints.displaced(start, scatter)
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        inside = self.lower + random.uniform(size=len(self.lower)) * (self.upper - self.lower)
        q[self.places[1][bounded]] = inside[bounded]
        if not np.any(self.constraints.holonomic):
            return q
        closing = close_loops(self.constraints, self.time, q, np.ones(len(self.scales), dtype=bool))
        return closing.q if closing.closed else None

    def answer(self, found: _Found, tolerance: float, drives: FreeDrives) -> InverseKinematics:
        """The result, with what stands in the way."""
        residual, count = found.residual, 0 if self.target.position is None else 3
        distance = self.size * float(np.linalg.norm(residual[:count]))
        angle = float(np.linalg.norm(residual[count:]))
        reached = found.error <= tolerance
        result = InverseKinematics(
            drives.commanded(found.q), self.kinematics.positions(found.q), reached, distance, angle
        )
        if reached:
            return result
        held = tuple(name for name, place in zip(self.names, self.places[0], strict=True) if found.held[place])
        parts = [f"{distance:.3g} m" if count else "", f"{angle:.3g} rad" if len(residual) > count else ""]
        near = f"the nearest position that was found is {' and '.join(filter(None, parts))} from the target"
        why = f"The limits of {listed(held)} hold it back: " if held else "The target is out of reach: "
        return replace(result, at_limits=held, reason=f"{why}{near}.{self._prescribed()}")

    def _prescribed(self) -> str:
        """A sentence about the joints that cannot be moved, as they are functions of time."""
        if not (names := self.kinematics.mechanism.driven_names):
            return ""
        what = "is a function" if len(names) == 1 else "are functions"
        return f" {listed(names)} {what} of time, here at {self.time:g} s: only the other joints were moved."


class _Vicinity:
    """The error near a position, up to second order: of Gauss and Newton, or with its curvature (`curved`)."""

    def __init__(self, problem: _Reaching, found: _Found, *, curved: bool) -> None:
        self._problem, self._found, self._curved = problem, found, curved
        self._jacobian = problem.jacobian(found.q)
        self._gradient = self._jacobian.T @ found.residual
        self._rows = problem.holonomic_rows(found.q)
        self._known: dict[bytes, tuple[Array, Array]] = {}

    def step(self, damping: float) -> tuple[Array, Mask, float]:
        """A step (nv,) in natural units, the coordinates that limits hold, and the fall of the error's square.

        Held coordinates would go beyond their limits; the fall is what the second order promises.
        """
        held = np.zeros(len(self._gradient), dtype=bool)
        while True:
            free, curvature = self._along(held)
            downhill = -free.T @ self._gradient[~held]
            weights, axes = np.linalg.eigh(curvature)
            least = FLAT * float(np.max(np.abs(weights), initial=0.0)) if self._curved else 0.0
            along = axes @ ((axes.T @ downhill) / (np.maximum(np.abs(weights), least) + damping))
            promise = float(2.0 * downhill @ along - along @ curvature @ along)
            step = np.zeros(len(held))
            step[~held] = free @ along
            longest = float(np.max(np.abs(step), initial=0.0))
            step *= min(1.0, LONGEST_STEP / max(longest, 1e-300))
            beyond = self._problem.beyond(self._found.q, step) & ~held
            if not beyond.any():
                return step, held, promise
            held |= beyond

    def _along(self, held: Mask) -> tuple[Array, Array]:
        """The free directions (nv - held, n), and half the second derivative (n, n) of the error's square there."""
        if (known := self._known.get(held.tobytes())) is not None:
            return known
        rows = self._rows[:, ~held]
        free = null_space(rows, rank_of(rows)) if rows.size else np.eye(int(np.sum(~held)))
        slope = self._jacobian[:, ~held] @ free
        curvature = self._curvature(held, free) if self._curved else slope.T @ slope
        self._known[held.tobytes()] = free, curvature
        return free, curvature

    def _curvature(self, held: Mask, free: Array) -> Array:
        """Of the Lagrangian, whose multipliers are the forces that keep the loops closed against the gradient."""
        problem, q = self._problem, self._found.q
        multipliers = np.linalg.lstsq(self._rows[:, ~held].T, self._gradient[~held], rcond=None)[0]

        def slope(at: Array, residual: Array) -> Array:
            pull = problem.jacobian(at).T @ residual - problem.holonomic_rows(at).T @ multipliers
            return np.asarray(free.T @ pull[~held])

        here, columns = slope(q, self._found.residual), []
        for direction in free.T:
            step = np.zeros(len(held))
            step[~held] = DIFFERENCE * direction
            there = problem.constraints.displaced(q, problem.scales * step)
            columns.append((slope(there, problem.residual(there)) - here) / DIFFERENCE)
        matrix = np.reshape(columns, (len(columns), len(columns)))
        return np.asarray(0.5 * (matrix + matrix.T))


def _frame(kinematics: Kinematics, name: str, at: Sequence[float] | Array | None) -> tuple[str, Pose]:
    """The part of a frame, and its pose there, with its origin moved to `at` (3,)."""
    parts = kinematics.mechanism.parts
    known = {one.name: one.points for one in parts.values()}
    try:
        part, point = split_reference(name, known)
    except InputError as error:
        valid = [text for owner, points in known.items() for text in (owner, *(f"{owner}.{p}" for p in points))]
        raise InputError(f"there is no part or point '{name}'", nearest(name, valid)) from error
    pose = known[part][point] if point else identity_pose()
    moved = finite_vector([0.0, 0.0, 0.0] if at is None else at, 3, "at")
    return part, pose @ Pose(moved, np.eye(3))


def _ranges(kinematics: Kinematics, limits: bool) -> tuple[list[str], tuple[Array, Array], Array, Array]:
    """The names of limited coordinates, their places in u and in q, and their least and greatest values."""
    names: list[str] = []
    places: list[tuple[int, int]] = []
    ends: list[tuple[float, float]] = []
    for joint in kinematics.mechanism.joints.values() if limits else ():
        if joint.drive or joint.kind.quaternion is not None:
            continue
        for number, name in enumerate(joint.motion_names[: joint.kind.nv]):
            if (range_of := joint.limits_of(number)) is not None:
                names.append(name)
                places.append(
                    (kinematics.layout.u[joint.name].start + number, kinematics.layout.q[joint.name].start + number)
                )
                ends.append((float(range_of.lower), float(range_of.upper)))
    in_u, in_q = np.array(places, dtype=int).reshape(-1, 2).T
    lower, upper = np.array(ends, dtype=float).reshape(-1, 2).T
    return names, (in_u, in_q), lower, upper
