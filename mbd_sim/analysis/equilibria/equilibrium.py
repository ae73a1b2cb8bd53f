"""Equilibria: configurations near the start in which a mechanism can stay at rest.

A load that holds the mechanism at the start is taken away step by step. The configurations that it holds are a path,
followed by a predictor along its tangent and Newton's method, past the points at which the load turns back. The path
does not move along directions in which nothing changes, such as that of a cart on a level rail.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from mbd_sim.analysis.equilibria.rest_balance import Rest, RestBalance, RestSlopes, displacement_between
from mbd_sim.analysis.linear.linearization import linearize, size_of_zeros
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.dynamics.constraints.assembly import close_loops
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions
from mbd_sim.dynamics.equations import Equations, require_equations
from mbd_sim.dynamics.layouts.actuators import require_continuous
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.natural_units import natural_units

FLAT = 1e-10  # singular values up to this fraction of the largest, or this, count as zero
BALANCED, CORRECTED = 1e-9, 1e-7  # what may remain of the balance at an equilibrium, and along the path
SHORT = 1e-8  # Newton's last step to an equilibrium
STATIONARY = 1e-7  # the least part of the load in a tangent
FIRST, LEAST, LONGEST = 0.02, 1e-7, 1e12  # lengths of steps
LARGEST_TURN = 0.2  # rad in a step
STRAIGHT, BENT = 0.995, 0.9  # cosines of the angle between tangents with which steps become longer, and shorter
SLOW, SETTLED = 0.5, 1e-4  # the first step of time while it sinks, and the balance from which Newton's method goes on
STEPS, CORRECTIONS, ITERATIONS, SETTLING = 300, 6, 60, 200
UNCHANGED = 60  # steps in a row that leave the load as it is, after which a path is left: a weight that falls


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
    place, length, unchanged = _Place(balance.start, direction * first), FIRST, 0
    for number in range(STEPS):
        following, length = _next(balance, place, length)
        if following is None:
            return
        before, after = place.rest.load_factor, following.rest.load_factor
        unchanged = unchanged + 1 if abs(after - before) <= CORRECTED else 0
        if unchanged == UNCHANGED:
            return
        if before * after <= 0.0 and before != after:
            nearer = place if abs(before) < abs(after) else following
            if (found := balanced(balance, nearer.rest)) is None:
                return
            yield found
        place = following
        away = balance.from_start(place.rest)
        away[-1] = place.rest.load_factor - 1.0
        if balance.distance(place.rest) > within or (number > 2 and np.linalg.norm(away) < 0.5 * length):
            return  # too far, or back at the start


def balanced(balance: RestBalance, guess: Rest) -> Rest | None:
    """The equilibrium next to a configuration by Newton's method, of a family the one nearest to the start."""
    rest, drawn = replace(guess, load_factor=0.0), True
    for _ in range(ITERATIONS):
        remaining, slopes = balance.at(rest), balance.slopes(rest)
        size = float(np.linalg.norm(remaining))
        if not (np.isfinite(size) and np.all(np.isfinite(slopes.matrix))):
            return None
        step, neutral = _newton_step(slopes.matrix[:, :-1], remaining)
        back = neutral.T @ (neutral @ -slopes.along(balance.from_start(rest))[:-1]) if drawn else np.zeros_like(step)
        whole = slopes.whole(np.append(step + back, 0.0))
        moved = balance.moved(rest, whole * min(1.0, LARGEST_TURN / max(balance.turned_by(whole), 1e-300)))
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
    rest, pause = replace(balance.start, load_factor=0.0), SLOW
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
    count = int(np.sum(values > FLAT * max(1.0, float(np.max(values, initial=0.0)))))
    step = -axes[:count].T @ (left[:, :count].T @ remaining / values[:count])
    return np.asarray(step), axes[count:]


ATTEMPTS = 12  # other configurations from which equilibria are sought
SCATTER = 0.3  # rad, or the same share of the size of the mechanism, between these
BALANCED_START = 1e-12  # of the accelerations, in units of gravity: those of round-off
SAME = 1e-6  # of distances, in sizes of the mechanism
TIMES = (0.0, 0.137, 0.71, 1.9)  # in natural units, at which accelerations are compared
CHANGED = 1e-9  # of what is compared, or of its natural unit, that counts as a change


@record
class Equilibrium:
    """Coordinates q (nq,) and `states` of actuators (s,) in which a mechanism can stay at rest.

    `displacement` (nv,) leads there from the start, along the speeds: in m and rad. `distance` is its size in m: the
    displacement of each coordinate, weighted with its inertia at the start, relative to the mass of the mechanism.
    Small motions grow with the rate `growth` in 1/s; 0 at a stable equilibrium, nan where they are not smooth,
    because a contact is about to change.
    """

    q: Array
    states: Array
    displacement: Array
    distance: float
    growth: float

    @property
    def stable(self) -> bool:
        """Whether no small motion about it grows."""
        return self.growth == 0.0


def equilibrium(equations: Equations, inputs: Array | None = None, q: Array | None = None) -> Array | None:
    """Coordinates (nq,) in which the mechanism can stay at rest, or None if none are found: see `nearest_equilibrium`.

    :raises TypeError: `equations` are none, for example a simulation.
    """
    found = nearest_equilibrium(equations, inputs, q)
    return None if found is None else found.q


def nearest_equilibrium(
    equations: Equations, inputs: Array | None = None, q: Array | None = None, states: Array | None = None
) -> Equilibrium | None:
    """The equilibrium nearest to a configuration, stable or not, or None if none is found.

    A configuration without accelerations is the equilibrium. From any other one, two paths of rest are followed (see
    `mbd_sim.analysis.equilibria.equilibrium`), and the nearer of the equilibria to which they lead is taken; of two at
    the same distance, the stabler one. Directions in which nothing changes, such as that of a cart on a level rail,
    keep their coordinates. If neither path leads to an equilibrium, the nearest one of `equilibria` is taken.

    :param inputs: all inputs of the equations, for efforts, wrenches, commands and live values; by default there are no
        efforts and wrenches, commands are those at the start, and live values those of the mechanism.
    :param q: (nq,) the configuration, which satisfies the constraints; by default the start.
    :param states: (s,) states of actuators near those at the equilibrium; by default those at the start.
    :raises TypeError: `equations` are none, for example a simulation.
    :raises MechanismError: an actuator changes only between steps: it is sampled, delayed, or has a rate limit.
    """
    return _EquilibriumSearch(equations, inputs, q, states).nearest()


def equilibria(
    equations: Equations, inputs: Array | None = None, q: Array | None = None, states: Array | None = None
) -> list[Equilibrium]:
    """The equilibria that are found near a configuration, the nearest first: see `nearest_equilibrium`.

    They are sought along the paths of rest from it, and from other configurations around it. There may be more.
    """
    return _EquilibriumSearch(equations, inputs, q, states).all()


def is_autonomous(equations: Equations) -> bool:
    """Whether accelerations and constraints do not depend on time, judged by their values at the start at `TIMES`."""
    constraints, q = equations.constraints, equations.start.q
    rate = natural_units(equations.mechanism, equations.step).rate
    times = [time / rate for time in TIMES]
    if any(np.any(np.abs(constraints.drift(t, q)) > CHANGED * rate * constraints.row_sizes(t, q)) for t in times):
        return False
    y = equations.start_state
    inputs = equations.inputs_without_commands
    first, *others = (np.array(equations.rates.call([t, y, inputs])[0]) for t in times)
    least = CHANGED * (np.abs(first.ravel()) + rate * np.array(equations.scales))
    return all(np.all(np.abs(other.ravel() - first.ravel()) <= least) for other in others)


def growth_of(matrix: Array, rate: float) -> float:
    """The largest real part in 1/s of the eigenvalues of a matrix (n, n); zero where none is positive.

    :param rate: the natural rate in 1/s.
    """
    values = np.linalg.eigvals(matrix)
    growth = float(np.max(values.real, initial=0.0))
    return growth if growth > size_of_zeros(values, rate) else 0.0


class _EquilibriumSearch:
    """The search for equilibria around a configuration."""

    def __init__(self, equations: Equations, inputs: Array | None, q: Array | None, states: Array | None) -> None:
        require_equations(equations)
        require_continuous(equations.mechanism, equations.actuator_layout, "has no equilibrium that can be found")
        self._equations = equations
        self._inputs = equations.inputs_without_commands if inputs is None else inputs
        held = slice(equations.layout.nq + equations.layout.nv, equations.core.stop)
        self._states = equations.start_state[held] if states is None else states
        self._balance = self._balance_at(equations.start.q if q is None else q)

    def _balance_at(self, q: Array) -> RestBalance:
        return RestBalance(self._equations, q, self._states, self._inputs)

    def nearest(self) -> Equilibrium | None:
        """The nearer of the first equilibria on the two paths; of two at the same distance, the stabler one."""
        balance = self._balance
        if balance.imbalance <= BALANCED_START:
            return self._described(balance.start)
        if self._falls():
            return None
        found: list[Equilibrium] = []
        for direction in (1.0, -1.0):
            within = (1.0 + SAME) * min((one.distance for one in found), default=math.inf)
            found += [self._described(rest) for rest in islice(equilibria_along(balance, direction, within), 1)]
        found += self._settled()
        if not found:
            return next(iter(self._around()), None)
        least = min(one.distance for one in found)
        return min((one for one in found if one.distance <= (1.0 + SAME) * least), key=lambda one: one.growth)

    def all(self) -> list[Equilibrium]:
        """All that are found, the nearest first."""
        balance = self._balance
        if self._falls():
            return []
        found = [self._described(balance.start)] if balance.imbalance <= BALANCED_START else []
        for direction in (1.0, -1.0):
            found += [self._described(rest) for rest in islice(equilibria_along(balance, direction), ATTEMPTS)]
        return self._distinct([*found, *self._settled(), *self._around()])

    def _falls(self) -> bool:
        """Whether a body that is free in space has weight, and nothing but one-sided elements can hold it.

        The paths would only follow its fall, for minutes in a heap of thirty balls.
        """
        equations, mechanism = self._equations, self._equations.mechanism
        compliant = [contact for contact in mechanism.contacts if not contact.rigid]
        if equations.rows or mechanism.force_elements or mechanism.actuators or compliant or np.any(self._acting()):
            return False
        holding = self._balance.start.holding
        weights = [
            np.linalg.norm(holding[equations.layout.u[name]][:3])  # of all that hangs on the joint
            for name, joint in mechanism.joints.items()
            if joint.type == "free" and joint.parent == GROUND
        ]
        return bool(max(weights, default=0.0) > BALANCED * float(np.max(np.abs(holding), initial=0.0)))

    def _acting(self) -> Array:
        """The efforts and wrenches among the inputs."""
        layout = self._equations.inputs
        wrenches = [self._inputs[where] for where in layout.wrenches.values()]
        return np.concatenate([self._inputs[layout.efforts], *wrenches])

    def _settled(self) -> list[Equilibrium]:
        rest = settled(self._balance)
        return [] if rest is None else [self._described(rest)]

    def _around(self) -> list[Equilibrium]:
        """Those that are found from other configurations, the nearest first."""
        balance, random = self._balance, np.random.default_rng(2)
        found = []
        for attempt in range(1, ATTEMPTS):
            q = _scattered(balance.constraints, balance.start.q, random, 2 * attempt)
            nearest = next(equilibria_along(self._balance_at(q), 1.0), None)
            near = None if nearest is None else balanced(balance, nearest)
            if near is not None:
                found.append(self._described(near))
        return self._distinct(found)

    def _described(self, rest: Rest) -> Equilibrium:
        equations, balance = self._equations, self._balance
        rest = self._unwound(rest)
        efforts, zeros = self._inputs[equations.inputs.efforts], np.zeros(equations.layout.nv)
        small = linearize(equations, rest.q, zeros, efforts, inputs=self._inputs, states=rest.states)
        displacement = displacement_between(equations, balance.start.q, rest.q)
        return Equilibrium(rest.q, rest.states, displacement, balance.distance(rest), growth_of(small.a, small.rate))

    def _unwound(self, rest: Rest) -> Rest:
        """A configuration without whole turns since the start, if that is an equilibrium as well."""
        equations, balance = self._equations, self._balance
        turns = np.round(displacement_between(equations, balance.start.q, rest.q) / (2.0 * math.pi))
        turns[~balance.rotations] = 0.0
        if not turns.any():
            return rest
        q = balance.constraints.displaced(rest.q, -2.0 * math.pi * turns)
        return balanced(balance, replace(rest, q=q)) or rest

    def _distinct(self, found: Sequence[Equilibrium]) -> list[Equilibrium]:
        """Each of them once, the nearest first."""
        distinct: list[Equilibrium] = []
        for one in sorted(found, key=lambda one: one.distance):
            size = SAME * (1.0 + float(np.linalg.norm(self._balance.weighted(one.displacement))))
            if all(self._apart(one, other) > size for other in distinct):
                distinct.append(one)
        return distinct

    def _apart(self, one: Equilibrium, other: Equilibrium) -> float:
        """The distance between two equilibria, without dimension and without whole turns."""
        difference, rotations = one.displacement - other.displacement, self._balance.rotations
        difference[rotations] = np.remainder(difference[rotations] + math.pi, 2.0 * math.pi) - math.pi
        return float(np.linalg.norm(self._balance.weighted(difference)))


def _scattered(constraints: ConstraintFunctions, q: Array, random: np.random.Generator, steps: int) -> Array:
    """A configuration (nq,) some steps away from q, in a random free direction."""
    all_free, direction = np.ones(constraints.gradient(0.0, q).shape[1], dtype=bool), None
    for _ in range(steps):
        free = constraints.free_directions(0.0, q)
        components = random.normal(size=free.shape[1]) if direction is None else free.T @ direction
        direction = free @ components
        direction *= SCATTER / max(float(np.max(np.abs(direction) / constraints.scales, initial=0.0)), 1e-300)
        closing = close_loops(constraints, 0.0, constraints.displaced(q, direction), all_free)
        if not closing.closed:
            break
        q = closing.q
    return q
