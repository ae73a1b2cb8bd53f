"""Small motions about a state along the directions that constraints and contacts leave free.

With q' = N u, small changes of the variables are ξ = (ν, δu, s, further ones): displacements ν, which change q by N ν,
changes of speed, and changes of the states of actuators. The further ones are given: inputs, and the motion of drives.
Constraints Φ(q, t) = 0 and G u + b = 0 leave

    ν = D p + P g,    δu = R p + S w + T g,

with the given changes g. D and S span the null spaces of the holonomic rows of G, and of all of them; P, R and T are
the least solutions of the differentiated constraints.

Eigenvalues say how small motions go on only in axes in which the derivatives stay constant, which matters for spherical
and free joints that turn. The speeds of such a joint have the angular velocity ω in the axes of its second part, and
displacements ν a small rotation δ in these axes. They turn with the part, so that δ' = δω - ω × δ. A part that spins
about a fixed axis without external moments has constant derivatives in these axes. A wheel that rolls straight on has
them in the axes before the joint instead, in which δ and δω have the components φ = R δ and R δω:

    φ' = R δω,    (R δω)' = R (δω' + ω × δω).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from mbd_sim.analysis.mechanics.one_sided_motion import OneSidedMotion
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.constraints.functions import scaled
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.layouts.actuators import require_continuous
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.dynamics.math.rank import least_solution, null_space, rank_of
from mbd_sim.mechanism.elements.joint_types import STATES

AHEAD = 1e-5  # s times 1/s: how far derivatives are compared, relative to the time of a radian
CONSTANT = 1e-7  # relative change of derivatives in the time of a radian that is round-off
STEADIER = 0.5  # the change of derivatives in the other axes, relative to that in the part's


def turning_of_parts(equations: Equations, u: Array) -> Array:
    """[ω]× of each spherical and free joint in its place (nv, nv), with zeros elsewhere."""
    found = np.zeros((len(u), len(u)))
    for name, joint in equations.mechanism.joints.items():
        if joint.kind.quaternion is not None and not joint.drive:
            span = slice(equations.layout.u[name].stop - 3, equations.layout.u[name].stop)
            x, y, z = u[span].tolist()
            found[span, span] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return found


def steadier_before_joints(equations: Equations, t: float, y: Array, inputs: Array, turning: Array) -> bool:
    """Whether the derivatives change less in the axes before the joints than in those that turn with the parts.

    :param turning: see `turning_of_parts`.
    """
    columns, nv = equations.derivative_layout, len(turning)
    rates = evaluated(equations.rates, t, y, inputs).ravel()
    step = AHEAD / float(np.max(np.abs(turning)))

    def derivatives(after: float) -> Array:
        return evaluated(equations.derivatives, t + after, y + after * rates, inputs).T

    change, here = (derivatives(step) - derivatives(-step)) / (2.0 * step), derivatives(0.0)
    of_columns = np.zeros((columns.size, columns.size))
    of_columns[columns.displacements, columns.displacements] = turning
    of_columns[columns.speeds, columns.speeds] = turning
    otherwise = change - here @ of_columns
    otherwise[:nv] += turning @ here[:nv]
    state = slice(0, columns.states.stop)
    own, other, size = (float(np.linalg.norm(matrix[:, state])) for matrix in (change, otherwise, here))
    return own > CONSTANT * float(np.max(np.abs(turning))) * size and other < STEADIER * own


@dataclass(frozen=True, eq=False)
class SmallMotion:
    """x' = A x + B g with x = (p, w, s): the given changes g are those of `acting` and `drives` in `DerivativeLayout`.

    `directions` (variables, n + given) are the changes of all variables with x and g, or None where constraints leave
    everything free: then x and g are these variables. `drive_rates` (drive states, variables) are the derivatives of
    the rates of commanded drives.
    """

    a: Array
    b: Array
    displacements: Array
    speeds: Array
    directions: Array | None
    drive_rates: Array

    def along(self, derivatives: Array) -> tuple[Array, Array]:
        """The derivatives of quantities (k, variables) by x (k, n) and by g (k, given)."""
        found = derivatives if self.directions is None else derivatives @ self.directions
        return found[:, : len(self.a)], found[:, len(self.a) :]


def small_motion(
    equations: Equations, t: float, y: Array, inputs: Array, derivatives: Callable[[], Array] | None = None
) -> SmallMotion:
    """The small motions about a state y (n,) that satisfies the constraints.

    :param derivatives: `Equations.derivatives` in this state, by default evaluated by CasADi.
    :raises MechanismError: an actuator changes only between steps: it is sampled, delayed, or has a rate limit.
    :raises MbdSimError: a contact is about to change, so that there is no linearization.
    """
    require_continuous(equations.mechanism, equations.actuator_layout, "cannot be linearized")
    nq, nv, core = equations.layout.nq, equations.layout.nv, equations.core
    columns = equations.derivative_layout
    found = evaluated(equations.derivatives, t, y, inputs).T if derivatives is None else derivatives()
    states, drives = core.stop - core.start, STATES * len(equations.layout.drives)
    rates, drive_rates, constrained = found[:states], found[states : states + drives], found[states + drives :]
    holonomic, constraints = equations.constraints.holonomic, equations.constraints
    row_sizes = constraints.with_values(inputs[equations.inputs.values]).row_sizes(t, y[:nq])
    if equations.has_contact(inputs):
        motion = OneSidedMotion(equations).at(t, y[:nq], y[nq : nq + nv], y[nq + nv : core.stop], inputs)
        rates = rates.copy()
        rates[:, columns.displacements] = motion.by_state[:, :nq] @ motion.n
        rates[:, nv : nv + states] = motion.by_state[:, nq:]
        rates[:, columns.acting] = motion.by_inputs
        closed = np.zeros((len(motion.gradient), columns.size))
        closed[:, columns.displacements], closed[:, columns.speeds] = motion.slopes @ motion.n, motion.gradient
        constrained = np.vstack([constrained, closed])
        row_sizes = np.append(row_sizes, np.linalg.norm(motion.gradient * constraints.scales, axis=1))
        holonomic = np.concatenate([holonomic, motion.holonomic]).astype(bool)
    free = np.zeros((nv, columns.size))
    free[:, columns.speeds] = _identity(nv)
    turning = turning_of_parts(equations, y[nq : nq + nv])
    if turning.any():
        if steadier_before_joints(equations, t, y, inputs, turning):
            rates = rates.copy()
            rates[:nv, columns.speeds] += turning
        else:
            free[:, columns.displacements] = -turning
    if not len(constrained):
        moving = np.concatenate((free, rates))
        return _split(moving, 2 * nv + states - nv, _identity(nv).copy(), _identity(nv).copy(), None, drive_rates)
    rows = _Rows(constrained[:, columns.speeds], row_sizes, constraints.scales)
    displacements, speeds = rows.some(holonomic).free, rows.free
    directions = _directions(equations, constrained, holonomic, rows)
    moving = np.vstack([displacements.T @ free, speeds.T @ rates[:nv], rates[nv:]])
    size = displacements.shape[1] + speeds.shape[1] + states - nv
    return _split(moving @ directions, size, displacements, speeds, directions, drive_rates)


@cache
def _identity(size: int) -> Array:
    """The identity matrix, to be copied."""
    return np.eye(size)


def _split(
    both: Array, size: int, displacements: Array, speeds: Array, directions: Array | None, drive_rates: Array
) -> SmallMotion:
    return SmallMotion(both[:, :size], both[:, size:], displacements, speeds, directions, drive_rates)


@dataclass(frozen=True, eq=False)
class _Rows:
    """The constraint matrix G (m, nv), the natural sizes (m,) of its rows, and the units (nv,) of speeds."""

    gradient: Array
    sizes: Array
    scales: Array

    def some(self, which: Array) -> _Rows:
        """Some of the rows."""
        return _Rows(self.gradient[which], self.sizes[which], self.scales)

    @cached_property
    def free(self) -> Array:
        """An orthonormal basis (nv, k) of the null space."""
        return null_space(self.gradient, rank_of(scaled(self.gradient, self.sizes, self.scales)))

    def least(self, right: Array) -> Array:
        """The solutions (nv, k) of least norm for right sides (m, k)."""
        sizes = np.where(self.sizes > 0.0, self.sizes, np.inf)
        matrix = scaled(self.gradient, self.sizes, self.scales)
        found = self.scales[:, None] * least_solution(matrix, right / sizes[:, None])
        return found - self.free @ (self.free.T @ found)


def _directions(equations: Equations, constrained: Array, holonomic: Array, rows: _Rows) -> Array:
    """The changes (variables, n + given) of all variables with x and with what is given.

    :param constrained: the derivatives (m, variables) of G u + b, whose derivatives by the speeds are the `rows`.
    """
    columns, nv = equations.derivative_layout, equations.layout.nv
    displacements, speeds = rows.some(holonomic).free, rows.free
    given = slice(columns.acting.start, columns.size)
    k, own = displacements.shape[1], displacements.shape[1] + speeds.shape[1]
    rest = columns.size - 2 * nv  # states of actuators, and what is given
    found = np.zeros((columns.size, own + rest))
    found[columns.displacements, :k], found[columns.speeds, k:own] = displacements, speeds
    found[2 * nv :, own:] = np.eye(rest)
    positions = _position_derivatives(equations, constrained)[:, given]
    if positions.any():
        found[columns.displacements, -positions.shape[1] :] = rows.some(holonomic).least(-positions[holonomic])
    remaining = constrained @ found
    remaining[:, k:own] = 0.0  # round-off
    if remaining.any():
        found[columns.speeds] += rows.least(-remaining)
    return found


def _position_derivatives(equations: Equations, constrained: Array) -> Array:
    """The derivatives of Φ by what is given: those by the position of a drive are those of G u + b by its speed."""
    columns, found = equations.derivative_layout, np.zeros_like(constrained)
    for position, speed, _ in equations.inputs.drive_disturbances:
        index = columns.acting.start + equations.inputs.acting.index(position)
        found[:, index] = constrained[:, columns.acting.start + equations.inputs.acting.index(speed)]
    for first in range(columns.drives.start, columns.drives.stop, STATES):
        found[:, first] = constrained[:, first + 1]
    return found
