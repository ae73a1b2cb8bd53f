"""The constraints and the mass matrix as functions of numbers, for the assembly and for analyses.

What is round-off in the constraint matrix G cannot be told from G alone: of a loop that its joints satisfy by
themselves, such as a shaft in two bearings, nothing else is left. So each row has a natural size, the change of its
position if the parts move by the size of the mechanism, or turn by 1 rad; and each speed has a unit, the size of the
mechanism or 1 rad. In these units all entries of G are of the order of 1 at most, and what is below `RANK`
of `mbd_sim.dynamics.math.rank` is zero, whatever the units of the file are.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import norm
from mbd_sim.dynamics.constraints.equations import ConstraintEquations
from mbd_sim.dynamics.kinematics.poses import normalized_quaternions
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.expressions import evaluated, evaluated_for_all
from mbd_sim.dynamics.math.rank import null_space, rank_of
from mbd_sim.mechanism.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class ConstraintFunctions:
    """The constraints as functions of time and state, for given `values` of the symbolic parameters."""

    _traced: TracedFunctions
    values: Array

    def with_values(self, values: Array) -> ConstraintFunctions:
        """These functions for other values (n,) of the parameters."""
        return ConstraintFunctions(self._traced, values)

    def position(self, t: float, q: Array) -> Array:
        """The position Φ (m,), zero in nonholonomic rows."""
        return evaluated(self._traced.position, t, q, self.values).ravel()

    def gradient(self, t: float, q: Array) -> Array:
        """The constraint matrix G (m, nv)."""
        return evaluated(self._traced.gradient, t, q, self.values)

    def row_sizes(self, t: float, q: Array) -> Array:
        """The natural size (m,) of each row, in the unit of its position."""
        return evaluated(self._traced.row_sizes, t, q, self.values).ravel()

    def scaled_gradient(self, t: float, q: Array) -> Array:
        """G (m, nv) in natural units: zero up to `mbd_sim.dynamics.math.rank.RANK`."""
        return scaled(self.gradient(t, q), self.row_sizes(t, q), self.scales)

    def rank(self, t: float, q: Array) -> int:
        """The rank of G."""
        return rank_of(self.scaled_gradient(t, q))

    def free_directions(self, t: float, q: Array) -> Array:
        """An orthonormal basis (nv, k) of the speeds with G u = 0."""
        gradient = self.gradient(t, q)
        return null_space(gradient, rank_of(scaled(gradient, self.row_sizes(t, q), self.scales)))

    def drift(self, t: float, q: Array) -> Array:
        """The drift b (m,): the constraints are G u + b = 0."""
        return evaluated(self._traced.drift, t, q, self.values).ravel()

    def rate_of_drives(self, t: float, q: Array) -> float:
        """The largest rate in 1/s at which drives move a part: of b, what is far smaller is round-off."""
        return float(evaluated(self._traced.rate_of_drives, t, q, self.values)[0, 0])

    def bias(self, t: float, q: Array, u: Array) -> Array:
        """γ (m,) with G u' + γ = 0."""
        return evaluated(self._traced.bias, t, q, u, self.values).ravel()

    def mass_matrix(self, t: float, q: Array) -> Array:
        """The mass matrix M (nv, nv)."""
        return evaluated(self._traced.mass_matrix, t, q, self.values)

    def momentum(self, t: float, q: Array) -> Array:
        """The momenta p (nv,) that drives cause by themselves: the kinetic energy is ½ uᵀ M u + pᵀ u + c."""
        return evaluated(self._traced.momentum, t, q, self.values).ravel()

    def branch_checks(self, t: float, q: Array) -> Array:
        """Numbers that are positive where all loops are closed in the right assembly mode."""
        return evaluated(self._traced.branch_checks, t, q, self.values).ravel()

    def displaced(self, q: Array, displacement: Array) -> Array:
        """The coordinates (nq,) after a small displacement (nv,) along the speeds, with unit quaternions."""
        return evaluated(self._traced.displaced, q, displacement, self.values).ravel()

    @property
    def traced(self) -> TracedFunctions:
        """The constraints as CasADi functions of (t, q, values), for other languages."""
        return self._traced

    @property
    def size(self) -> float:
        """The size of the mechanism in m: the largest distance of a point of a part from the part's origin."""
        return self._traced.size

    @property
    def scales(self) -> Array:
        """The natural unit (nv,) of each speed and displacement: 1 rad, or the size of the mechanism in m."""
        return self._traced.scales

    @property
    def coordinate_scales(self) -> Array:
        """The natural unit (nq,) of each coordinate; 1 for quaternions."""
        return self._traced.coordinate_scales

    @property
    def holonomic(self) -> Array:
        """Which of the rows (m,) are holonomic."""
        return self._traced.holonomic


def scaled(gradient: Array, row_sizes: Array, scales: Array) -> Array:
    """G (…, m, nv) in natural units; rows without a size are zero."""
    sizes = np.where(row_sizes > 0.0, row_sizes, np.inf)
    found: Array = gradient * scales / sizes[..., None]
    return found


class ManyConstraints:
    """The constraints at t = 0 of many variants, with `values` (k, n) of the symbolic parameters.

    Each function takes rows of numbers and the indices (n,) of the variants to which they belong.
    """

    def __init__(self, constraints: ConstraintFunctions, values: Array) -> None:
        self._traced, self._values = constraints._traced, values
        self.size, self.holonomic, self.scales = constraints.size, constraints.holonomic, constraints.scales

    def position(self, q: Array, which: NDArray[np.intp]) -> Array:
        """The positions Φ (n, m), of the coordinates of all variants (k, nq) or of some (n, nq)."""
        return self._rows(self._traced.position, _of(q, which), which)

    def gradient(self, q: Array, which: NDArray[np.intp]) -> Array:
        """The constraint matrices G (n, m, nv)."""
        return self._matrices(self._traced.gradient, q, which)

    def row_sizes(self, q: Array, which: NDArray[np.intp]) -> Array:
        """The natural sizes (n, m) of the rows."""
        return self._rows(self._traced.row_sizes, _of(q, which), which)

    def rate_of_drives(self, q: Array, which: NDArray[np.intp]) -> Array:
        """The rates (n, 1), see `ConstraintFunctions.rate_of_drives`."""
        return self._rows(self._traced.rate_of_drives, _of(q, which), which)

    def drift(self, q: Array, which: NDArray[np.intp]) -> Array:
        """The drifts b (n, m)."""
        return self._rows(self._traced.drift, _of(q, which), which)

    def mass_matrix(self, q: Array, which: NDArray[np.intp]) -> Array:
        """The mass matrices M (n, nv, nv)."""
        return self._matrices(self._traced.mass_matrix, q, which)

    def momentum(self, q: Array, which: NDArray[np.intp]) -> Array:
        """The momenta (n, nv), see `ConstraintFunctions.momentum`."""
        return self._rows(self._traced.momentum, _of(q, which), which)

    def branch_checks(self, q: Array, which: NDArray[np.intp]) -> Array:
        """Numbers (n, c), see `ConstraintFunctions.branch_checks`."""
        return self._rows(self._traced.branch_checks, _of(q, which), which)

    def displaced(self, q: Array, displacements: Array, which: NDArray[np.intp]) -> Array:
        """The coordinates (n, nq) after displacements (n, nv)."""
        return evaluated_for_all(self._traced.displaced, q, displacements, self._values[which])

    def _rows(self, function: ca.Function, q: Array, which: NDArray[np.intp]) -> Array:
        return evaluated_for_all(function, np.zeros((len(which), 1)), q, self._values[which])

    def _matrices(self, function: ca.Function, q: Array, which: NDArray[np.intp]) -> Array:
        rows, columns = function.size_out(0)
        flat = self._rows(function, _of(q, which), which).reshape(len(which), columns, rows)
        return np.ascontiguousarray(flat.swapaxes(1, 2))


def _of(q: Array, which: NDArray[np.intp]) -> Array:
    return q if len(q) == len(which) else q[which]


def constraint_functions(traced: TracedMechanism, constraints: ConstraintEquations) -> ConstraintFunctions:
    """The functions of some constraints, with the values of the mechanism itself."""
    return ConstraintFunctions(TracedFunctions(traced, constraints), traced.parameters.base)


class TracedFunctions:
    """CasADi functions of the state and the parameters, each traced when it is first called."""

    def __init__(self, traced: TracedMechanism, constraints: ConstraintEquations) -> None:
        self._mechanism, self._constraints = traced, constraints

    @cached_property
    def position(self) -> ca.Function:
        """See `ConstraintFunctions.position`."""
        return self._of_position("position", self._constraints.position)

    @cached_property
    def gradient(self) -> ca.Function:
        """See `ConstraintFunctions.gradient`."""
        return self._of_position("gradient", self._constraints.gradient)

    @cached_property
    def drift(self) -> ca.Function:
        """See `ConstraintFunctions.drift`."""
        u = self._mechanism.state.u
        return self._of_position("drift", ca.substitute(self._constraints.velocity, u, ca.SX.zeros(u.shape[0], 1)))

    @cached_property
    def row_sizes(self) -> ca.Function:
        """See `ConstraintFunctions.row_sizes`."""
        rows, wrenches = self._constraints.rows, self._constraints.wrenches
        sizes = []
        for index, row in enumerate(rows):
            acting = [wrench[:, index] for wrench in wrenches if wrench[:, index].nnz()]
            terms = [_norm(wrench[:3]) for wrench in acting] + [self.size * _norm(wrench[3:]) for wrench in acting]
            terms += [ca.SX(abs(k) * self._unit_of(name)) for name, k in row.factors.items()]
            size = functools.reduce(ca.fmax, terms) if terms else ca.SX(self.size if row.unit == "m" else 1.0)
            sizes.append(size)
        return self._of_position("row_sizes", ca.vertcat(ca.SX(0, 1), *sizes))

    @cached_property
    def rate_of_drives(self) -> ca.Function:
        """See `ConstraintFunctions.rate_of_drives`."""
        u, rate = self._mechanism.state.u, ca.SX(1, 1)
        if self._mechanism.mechanism.driven_names:
            for motion in self._mechanism.motions:
                twist = ca.substitute(ca.densify(motion.V_WL), u, ca.SX.zeros(u.shape[0], 1))
                rate = ca.fmax(rate, ca.fmax(_norm(twist[:3]), _norm(twist[3:]) / self.size))
        return self._of_position("rate_of_drives", rate)

    @cached_property
    def bias(self) -> ca.Function:
        """See `ConstraintFunctions.bias`."""
        state = self._mechanism.state
        return self._function("bias", [state.t, state.q, state.u], self._constraints.bias)

    @cached_property
    def mass_matrix(self) -> ca.Function:
        """See `ConstraintFunctions.mass_matrix`."""
        hessian = ca.hessian(self._mechanism.kinetic_energy, self._mechanism.state.u)[0]
        return self._of_position("mass_matrix", hessian)

    @cached_property
    def momentum(self) -> ca.Function:
        """See `ConstraintFunctions.momentum`."""
        u = self._mechanism.state.u
        at_rest = ca.substitute(self._mechanism.momenta, u, ca.SX.zeros(u.shape[0], 1))
        return self._of_position("momentum", at_rest)

    @cached_property
    def branch_checks(self) -> ca.Function:
        """See `ConstraintFunctions.branch_checks`."""
        return self._of_position("branch_checks", self._constraints.branch_checks)

    @cached_property
    def displaced(self) -> ca.Function:
        """(q, displacement, values) -> q: see `ConstraintFunctions.displaced`."""
        state = self._mechanism.state
        displacement = ca.SX.sym("d", state.u.shape[0])
        q = state.q + ca.jacobian(state.q_rates, state.u) @ displacement
        return self._function("displaced", [state.q, displacement], normalized_quaternions(self._mechanism.links, q))

    @cached_property
    def size(self) -> float:
        """See `ConstraintFunctions.size`."""
        return _size(self._mechanism.numeric)

    @cached_property
    def scales(self) -> Array:
        """See `ConstraintFunctions.scales`."""
        scales = np.ones(self._mechanism.layout.nv)
        for name, speeds in self._mechanism.layout.u.items():
            scales[speeds] = self._units_of(name)[: speeds.stop - speeds.start]
        return scales

    @cached_property
    def coordinate_scales(self) -> Array:
        """See `ConstraintFunctions.coordinate_scales`."""
        scales = np.ones(self._mechanism.layout.nq)
        for name, coordinates in self._mechanism.layout.q.items():
            units = self._units_of(name)[: coordinates.stop - coordinates.start]
            scales[coordinates.start : coordinates.start + len(units)] = units
        for name, states in self._mechanism.layout.drives.items():
            scales[states.start] = self._units_of(name)[0]
        return scales

    def _units_of(self, joint: str) -> list[float]:
        kind = self._mechanism.numeric.joints[joint].kind
        return [1.0 if one.rotation else self.size for one in kind.coordinates]

    def _unit_of(self, coordinate: str) -> float:
        """The natural unit of a coordinate, also of a driven joint, by its name."""
        return 1.0 if self._mechanism.numeric.coordinate(coordinate).rotation else self.size

    @cached_property
    def holonomic(self) -> Array:
        """See `ConstraintFunctions.holonomic`."""
        return np.array([row.position is not None for row in self._constraints.rows], dtype=bool)

    def _of_position(self, name: str, expression: ca.SX) -> ca.Function:
        return self._function(name, [self._mechanism.state.t, self._mechanism.state.q], expression)

    def _function(self, name: str, inputs: list[ca.SX], expression: ca.SX) -> ca.Function:
        return ca.Function(name, [*inputs, self._mechanism.parameters.symbols], [ca.densify(expression)])


def _norm(vector: ca.SX) -> ca.SX:
    return ca.sqrt(ca.dot(vector, vector))


def _size(mechanism: Mechanism) -> float:
    poses = [pose for joint in mechanism.all_joints.values() for pose in (joint.parent_pose, joint.child_pose)]
    poses += [pose for part in mechanism.parts.values() for pose in part.points.values()]
    points = [*(pose.position for pose in poses), *(part.center for part in mechanism.parts.values())]
    largest = max((norm(point) for point in points), default=0.0)
    gyration = [np.sqrt(np.trace(part.inertia) / part.mass) for part in mechanism.parts.values() if part.mass > 0.0]
    starts = [
        value
        for joint in mechanism.joints.values()
        for value, coordinate in zip(joint.position, joint.kind.coordinates, strict=False)
        if not coordinate.rotation
    ]
    return largest or float(max(gyration, default=0.0)) or norm(np.array(starts)) or 1.0
