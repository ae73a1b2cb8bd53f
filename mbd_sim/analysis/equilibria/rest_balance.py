"""The balance of a mechanism at rest, and the load that holds it where it is not balanced.

With efforts λ h a mechanism stays at rest: at the start with λ = 1, where the holding efforts h balance everything
else. The rates of the states of actuators are held in the same way. Elsewhere h keeps its size and turns with the
directions that constraints leave free. All numbers are without dimension, so that nothing depends on units:
displacements are weighted with the inertia of their coordinates and divided by the size of the mechanism, and
accelerations by that of gravity or of the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import product, rotation_vector
from mbd_sim.dynamics.constraints.assembly import close_nearby
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.dynamics.math.rank import null_space
from mbd_sim.mechanism.mechanism import Mechanism

WEIGHTLESS = 1e-12  # the least weight of a coordinate, relative to the largest


@dataclass(frozen=True, eq=False)
class Rest:
    """Coordinates q (nq,) that satisfy the constraints, states of actuators (s,), and what holds them.

    The `load_factor` is λ, and `holding` (nv + s,) are the efforts h and the rates of the states.
    """

    q: Array
    states: Array
    load_factor: float
    holding: Array


@dataclass(frozen=True, eq=False)
class RestSlopes:
    """The derivatives (nv + s, k + s + 1) of the balance along the `free` directions (nv, k), by states and load."""

    matrix: Array
    free: Array

    def whole(self, change: Array) -> Array:
        """The change (nv + s + 1,) of all variables of one along the free directions (k + s + 1,)."""
        return np.concatenate([self.free @ change[: self.free.shape[1]], change[self.free.shape[1] :]])

    def along(self, whole: Array) -> Array:
        """The inverse of `whole`, for the part of a change that is along the free directions."""
        return np.concatenate([self.free.T @ whole[: len(self.free)], whole[len(self.free) :]])


class RestBalance:
    """The forces on a mechanism at rest near a start with coordinates q (nq,) and states of actuators (s,)."""

    def __init__(self, equations: Equations, q: Array, states: Array, inputs: Array) -> None:
        self._equations, self._inputs = equations, inputs
        self._nq, self._nv = equations.layout.nq, equations.layout.nv
        self.constraints = equations.constraints.with_values(inputs[equations.inputs.values])
        self.rotations = rotations_among(equations.mechanism)
        inertia = np.diag(self.constraints.mass_matrix(0.0, q))
        self._weights = np.sqrt(np.maximum(inertia, WEIGHTLESS * np.max(inertia, initial=0.0) or 1.0))
        self._mass = math.sqrt(equations.mechanism.mass or 1.0)
        free = Rest(q, states, 0.0, np.zeros(self._nv + len(states)))
        rates, by_all = np.nan_to_num(self._rates(free)), np.nan_to_num(self._derivatives(free))
        self._acceleration = self._unit_acceleration(rates[: self._nv])
        self._units = np.concatenate([self._mass * self.constraints.size / self._weights, np.ones(len(states))])
        self._rows = np.concatenate([self._weights / (self._mass * self._acceleration), np.ones(len(states))])
        self._scale_states(by_all)
        columns = equations.derivative_layout
        by_efforts = self._weights[:, None] * by_all[: self._nv, columns.acting][:, : self._nv] * self._weights
        held = np.linalg.lstsq(by_efforts, -self._weights * rates[: self._nv], rcond=WEIGHTLESS)[0]
        self.start = Rest(q, states, 1.0, np.concatenate([self._weights * held, -rates[self._nv :]]))

    def _unit_acceleration(self, accelerations: Array) -> float:
        gravity = float(np.linalg.norm(np.asarray(self._equations.mechanism.gravity, dtype=float)))
        return max(gravity, float(np.linalg.norm(self._weights * accelerations)) / self._mass) or 1.0

    def _scale_states(self, by_all: Array) -> None:
        """Choose units of the states by what they do to accelerations, and of their rates by what acts on these."""
        columns, nv = self._equations.derivative_layout, self._nv
        if not len(self._rows[nv:]):
            return
        acting = np.linalg.norm(self._rows[:nv, None] * by_all[:nv, columns.states], axis=0)
        self._units[nv:] = 1.0 / np.where(acting > 0.0, acting, 1.0)
        of_rates = np.hstack([by_all[nv:, columns.displacements], by_all[nv:, columns.states]]) * self._units
        sizes = np.linalg.norm(of_rates, axis=1)
        self._rows[nv:] = 1.0 / np.where(sizes > 0.0, sizes, 1.0)

    @property
    def force(self) -> Array:
        """The direction (nv + s + 1,) in which the forces of the start push; the load stays."""
        pushes = -self.start.holding[: self._nv] / self._weights
        return np.concatenate([pushes, np.zeros(len(self.start.states) + 1)])

    @property
    def imbalance(self) -> float:
        """The size of the balance at the start without its load."""
        return float(np.linalg.norm(self.at(replace(self.start, load_factor=0.0))))

    def at(self, rest: Rest) -> Array:
        """The balance (nv + s,): the accelerations and the rates of the states, see `of`."""
        return self.of(self._rates(rest))

    def of(self, rates: Array) -> Array:
        """Accelerations and rates of states (nv + s,) in units of gravity, or of the start if more."""
        return self._rows * rates

    def slopes(self, rest: Rest) -> RestSlopes:
        """The derivatives of the balance."""
        by_all, columns = self._derivatives(rest), self._equations.derivative_layout
        nv = self._nv
        by_load = by_all[:, columns.acting][:, :nv] @ rest.holding[:nv]
        by_load[nv:] += rest.holding[nv:]
        free = self._free(rest)
        moving = by_all[:, columns.displacements] @ (self._units[:nv, None] * free)
        by_states = by_all[:, columns.states] * self._units[nv:]
        matrix = np.hstack([moving, by_states, by_load[:, None]]) * self._rows[:, None]
        return RestSlopes(matrix, free)

    def moved(self, rest: Rest, change: Array) -> Rest | None:
        """The state after a change (nv + s + 1,) of all variables; None if loops cannot be closed there."""
        nv = self._nv
        q = self.constraints.displaced(rest.q, self._units[:nv] * change[:nv])
        states, load = rest.states + self._units[nv:] * change[nv:-1], rest.load_factor + float(change[-1])
        if not (np.all(np.isfinite(q)) and np.all(np.isfinite(self.constraints.gradient(0.0, q)))):
            return None
        if self._equations.rows:
            closing = close_nearby(self.constraints, 0.0, q)
            if not (closing.closed and np.all(np.isfinite(self.constraints.gradient(0.0, closing.q)))):
                return None
            q = closing.q
        return Rest(q, states, load, rest.holding)

    def turned_by(self, change: Array) -> float:
        """The largest angle in rad by which a change of all variables turns a joint."""
        return float(np.max(np.abs(self._units[: self._nv] * change[: self._nv])[self.rotations], initial=0.0))

    def from_start(self, rest: Rest) -> Array:
        """The change (nv + s + 1,) of all variables since the start, without that of states and load."""
        displacement = displacement_between(self._equations, self.start.q, rest.q)
        return np.concatenate([self.weighted(displacement), np.zeros(len(rest.states) + 1)])

    def weighted(self, displacement: Array) -> Array:
        """A displacement (nv,) without dimension."""
        return np.asarray(displacement / self._units[: self._nv])

    def distance(self, rest: Rest) -> float:
        """The distance in m from the start, see `Equilibrium`."""
        return float(np.linalg.norm(self.from_start(rest))) * self.constraints.size

    def turned(self, rest: Rest) -> Rest:
        """An equilibrium held by a load along the directions that are free there, of the size of that at the start."""
        nv, free = self._nv, self._free(rest)
        efforts = self._weights * (free @ (free.T @ (rest.holding[:nv] / self._weights)))
        size = float(np.linalg.norm(efforts / self._weights))
        if size == 0.0:
            return rest
        part = size / float(np.linalg.norm(self.start.holding[:nv] / self._weights))
        return replace(
            rest, load_factor=rest.load_factor * part, holding=np.concatenate([efforts, rest.holding[nv:]]) / part
        )

    def _free(self, rest: Rest) -> Array:
        gradient = self.constraints.gradient(0.0, rest.q) * self._units[: self._nv]
        return null_space(gradient, self.constraints.rank(0.0, rest.q))

    def _rates(self, rest: Rest) -> Array:
        y, inputs = self._point(rest)
        rates = evaluated(self._equations.rates, 0.0, y, inputs).ravel()[self._equations.core]
        rates[self._nv :] += rest.load_factor * rest.holding[self._nv :]
        return rates

    def _derivatives(self, rest: Rest) -> Array:
        found = evaluated(self._equations.derivatives, 0.0, *self._point(rest)).T
        return found[: self._nv + len(rest.states)]

    def _point(self, rest: Rest) -> tuple[Array, Array]:
        y, inputs = np.zeros(self._equations.start_state.size), self._inputs.copy()
        y[: self._nq], y[self._nq + self._nv : self._equations.core.stop] = rest.q, rest.states
        inputs[self._equations.inputs.efforts] += rest.load_factor * rest.holding[: self._nv]
        return y, inputs


def rotations_among(mechanism: Mechanism) -> NDArray[np.bool_]:
    """Which of the speeds (nv,) are rotations."""
    joints = [joint for joint in mechanism.joints.values() if not joint.drive]
    return np.array([one.rotation for joint in joints for one in joint.kind.coordinates], dtype=bool)


def displacement_between(equations: Equations, start: Array, q: Array) -> Array:
    """The displacement (nv,) along the speeds from coordinates `start` (nq,) to q (nq,), by rotation vectors."""
    layout, found = equations.layout, np.zeros(equations.layout.nv)
    for name, into in layout.u.items():
        kind, where = equations.mechanism.joints[name].kind, layout.q[name]
        if kind.quaternion is None or into.start == into.stop:
            found[into] = q[where] - start[where]
            continue
        before, after = start[where], q[where]
        first = kind.quaternion
        inverse = before[first : first + 4] * np.array([1.0, -1.0, -1.0, -1.0])
        turn = rotation_vector(product(inverse, after[first : first + 4]))
        found[into] = np.concatenate([after[:first] - before[:first], turn])
    return found
