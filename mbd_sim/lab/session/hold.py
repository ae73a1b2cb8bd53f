"""Taking hold of a mechanism: the spring of a hand in a run, and configurations under the hand while it is paused."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry.pose import Array, unpack_poses
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions
from mbd_sim.simulation.model.penetrations import penetrations
from mbd_sim.simulation.run.simulation import BaseSimulation

FREQUENCY = 2.0  # Hz, of the held point on the spring of the hand
DAMPING_RATIO = 0.7
STRONGEST = 10.0  # times the weight of the mechanism on Earth: the largest force of the hand
EARTH = 9.80665  # m/s²
ITERATIONS, SMALL = 8, 1e-7
SOFTNESS = 1e-3  # of the least-squares steps: directions that hardly move the point are left alone
LONGEST_STEP = 0.3  # of a coordinate in one iteration, in natural units
HALVINGS, PROGRESS = 6, 0.999


@dataclass(frozen=True, eq=False)
class Hold:
    """A spring and a damper from a point (3,) of a part, in its frame, to a `target` (3,) in ground's frame.

    `stiffness` is in N/m and `damping` in N·s/m. The force is at most `strongest`, in N.
    """

    part: str
    point: Array
    target: Array
    stiffness: float
    damping: float
    strongest: float = math.inf

    def acting(self, simulation: BaseSimulation) -> tuple[Array, Array]:
        """The position (3,) of the held point, and the force (3,) in N on it, in ground's frame."""
        frame = simulation.frame(self.part)
        arm = frame.rotation @ self.point
        position, velocity = frame.position + arm, frame.velocity + np.cross(frame.angular_velocity, arm)
        force = self.stiffness * (self.target - position) - self.damping * velocity
        return position, force * min(1.0, self.strongest / max(float(np.linalg.norm(force)), 1e-300))

    def apply(self, simulation: BaseSimulation) -> None:
        """Exert the force of the present state from the next step on."""
        simulation.set_wrench(self.part, self.acting(simulation)[1], at=self.point)


def spring_for(simulation: BaseSimulation, part: str, point: Array, target: Array) -> Hold:
    """A spring that suits the inertia felt at a point of a part: neither too weak to move it nor unstable."""
    frame = simulation.frame(part)
    jacobian, arm = frame.jacobian, frame.rotation @ point
    at_point = jacobian[:3] - np.cross(arm, jacobian[3:].T).T
    felt = at_point @ np.linalg.pinv(simulation.mass_matrix()) @ at_point.T
    mobility = float(np.max(np.linalg.eigvalsh(felt), initial=0.0))
    mass = 1.0 / mobility if mobility > 0.0 else simulation.mechanism.mass
    rate = 2.0 * np.pi * FREQUENCY
    strongest = STRONGEST * EARTH * simulation.live_mechanism.mass
    return Hold(part, point, target, mass * rate**2, 2.0 * DAMPING_RATIO * mass * rate, strongest)


def pulled(simulation: BaseSimulation, part: str, point: Array, target: Array) -> Array | None:
    """The state y near the present one, at rest, in which a point of a part is as close to a target as it gets.

    Loops stay closed; stops and contacts are not passed. None if nothing can move.

    :param point: (3,) in the part's frame; `target` (3,) in ground's.
    """
    before = simulation.q.copy()
    q = _Hand(simulation, part, point).follow(before.copy(), target)
    return None if np.array_equal(q, before) else at_rest(simulation, q)


def at_rest(simulation: BaseSimulation, q: Array) -> Array:
    """The present state y with other coordinates (nq,), which close its loops, and as slow as its drives allow."""
    from mbd_sim.dynamics.constraints.assembly import nearest_speeds

    model, y = simulation.model, simulation.state
    y[model.q_range] = q
    y[model.u_range] = nearest_speeds(_constraints(simulation), simulation.time, q, np.zeros(model.layout.nv))
    return y


def _constraints(simulation: BaseSimulation) -> ConstraintFunctions:
    """Those of the present lengths."""
    values = np.asarray(simulation.inputs)[simulation.model.input_layout.values]
    return simulation.model.equations.constraints.with_values(values)


class _Hand:
    """A point (3,) of a part that is led through the configurations of a mechanism."""

    def __init__(self, simulation: BaseSimulation, part: str, point: Array) -> None:
        model = self._model = simulation.model
        self._time, self._y, self._inputs = simulation.time, simulation.state, np.asarray(simulation.inputs)
        self._index, self._point = model.part_names.index(part), point
        self._constraints = _constraints(simulation)

    def follow(self, q: Array, target: Array) -> Array:
        """The coordinates (nq,) near q, with loops closed, for which the point is close to the target (3,).

        Gauss-Newton along the directions that the constraints leave free, until the gap does not fall any more.
        """
        for _ in range(ITERATIONS):
            gap = target - self._place(q)
            step = self._step(q, gap)
            moved = None if step is None else self._closer(q, step, target, float(np.linalg.norm(gap)))
            if moved is None:
                break
            q = moved
        return q

    def _step(self, q: Array, gap: Array) -> Array | None:
        """The displacement (nv,) that reduces the gap (3,); None if nothing can move."""
        directions = self._constraints.free_directions(self._time, q)
        if not directions.shape[1]:
            return None
        here = self._place(q)
        ahead = [self._place(self._constraints.displaced(q, SMALL * one)) for one in directions.T]
        slopes = (np.column_stack(ahead) - here[:, None]) / SMALL
        softness = SOFTNESS * (float(np.linalg.norm(slopes, 2)) or 1.0)
        matrix = slopes.T @ slopes + softness**2 * np.eye(directions.shape[1])
        step: Array = directions @ np.linalg.solve(matrix, slopes.T @ gap)
        longest = float(np.max(np.abs(step) / self._constraints.scales))
        return step * min(1.0, LONGEST_STEP / max(longest, 1e-300))

    def _closer(self, q: Array, step: Array, target: Array, gap: float) -> Array | None:
        """The configuration after a step or a shorter one, in which the gap is smaller; None: there is none."""
        from mbd_sim.dynamics.constraints.assembly import close_nearby

        for _ in range(HALVINGS):
            closure = close_nearby(self._constraints, self._time, self._constraints.displaced(q, step))
            left = float(np.linalg.norm(target - self._place(closure.q)))
            if closure.closed and left < PROGRESS * gap and self._is_allowed(closure.q):
                return closure.q
            step = 0.5 * step
        return None

    def _state(self, q: Array) -> Array:
        y = self._y.copy()
        y[self._model.q_range] = q
        return y

    def _place(self, q: Array) -> Array:
        """The point (3,) in ground's frame."""
        positions, rotations = unpack_poses(self._model.pose_array(self._time, self._state(q), self._inputs))
        return np.asarray(positions[self._index] + rotations[self._index] @ self._point)

    def _is_allowed(self, q: Array) -> bool:
        """Whether nothing is inside something else, or beyond a stop."""
        return not penetrations(self._model, self._time, self._state(q), self._inputs)
