"""The constraints of a mechanism whose drives are prescribed: positions, velocities and accelerations at given drives.

The coordinates are those of the spanning tree. With the selection S of the driven ones, positions satisfy Φ(q) = 0 and
S q = c, velocities G u = 0 and S u = c', accelerations G u' + γ = 0 and S u' = c'' (Nikravesh, ch. 3). Redundant rows
are kept, and the systems solved by least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.assembly import CLOSED
from mbd_sim.dynamics.constraint_rank import least_solution
from mbd_sim.dynamics.evaluation import evaluated
from mbd_sim.dynamics.initial_conditions import assemble
from mbd_sim.dynamics.symbolic_parameters import SymbolicParameters
from mbd_sim.dynamics.time_functions import require_smooth
from mbd_sim.dynamics.tracing import trace
from mbd_sim.errors import InputError, MbdSimError, MechanismError, Problem, counted, listed
from mbd_sim.geometry.pose import Array
from mbd_sim.interrupts import interruptible_tracing
from mbd_sim.kinematic_analysis.prescribed_drives import coordinate_columns, drivable, undriven
from mbd_sim.mechanism.records import Mechanism, require_mechanism

ITERATIONS = 50
LONGEST = 0.5  # step of Newton's method, rad, or in lengths the size of the mechanism
SETTLED = 1e-9  # step of Newton's method after which the error, about its square, is round-off
SINGULAR = 1e-7  # singular value, relative to the largest, at which velocities are not determined


class KinematicSystem:
    """A mechanism with the driven coordinates `drives`, all others following from them.

    `start` (nq,) is the configuration of the file. `scale` (nv,) is 1 for angles and the size of the mechanism in m for
    displacements. `angles` (nq,) marks the coordinates that are angles. `values` are those of the symbolic parameters.
    """

    @interruptible_tracing()
    def __init__(
        self, mechanism: Mechanism, drives: Sequence[str], parameters: SymbolicParameters | None = None
    ) -> None:
        """Trace the constraints and close the loops.

        :raises InputError: a drive does not exist, or their number is not that of the degrees of freedom.
        :raises MechanismError: the loops cannot be closed, or constraints depend on time or on velocities.
        """
        mechanism = undriven(require_mechanism(mechanism), drives)
        require_smooth(mechanism)
        self.traced = trace(mechanism, (), parameters)
        self.assembly = assemble(self.traced)
        self.mechanism, self.layout, self.drives = mechanism, self.traced.layout, tuple(drives)
        self.constraints = self.assembly.functions
        if not np.all(self.constraints.holonomic):
            rows = zip(self.assembly.equations.rows, self.constraints.holonomic, strict=True)
            names = dict.fromkeys(str(row.owner[1]) for row, holonomic in rows if not holonomic)
            message = f"positions do not follow from drives, because of constraints on velocities: {listed([*names])}"
            raise MechanismError([Problem(message, "Simulate the motion instead.", file=mechanism.source.file)])
        self.start = self.assembly.start.q
        self.values = self.traced.parameters.base
        self.u_driven = np.array([mechanism.coordinate_names.index(name) for name in drives], dtype=np.intp)
        self.q_driven = np.array([self._place_in_q(name) for name in drives], dtype=np.intp)
        self.dependent = np.setdiff1d(np.arange(self.layout.nv), self.u_driven)
        self.scale = self.constraints.scales
        self.angles = self._plain_angles()
        self._require_determined()
        state = self.traced.state
        symbols = [state.t, state.q, state.u, self.traced.parameters.symbols]
        self._bias = ca.Function("bias", symbols, [ca.densify(self.assembly.equations.bias)])

    @property
    def degrees_of_freedom(self) -> int:
        """The number of independent speeds."""
        return self.layout.nv - self.assembly.start.rank

    def with_values(self, values: Array) -> KinematicSystem:
        """A copy with other values of the symbolic parameters."""
        other: Any = object.__new__(KinematicSystem)
        other.__dict__.update(self.__dict__)
        other.values, other.constraints = values, self.constraints.with_values(values)
        return other  # type: ignore[no-any-return]

    def gradient(self, q: Array) -> Array:
        """G (m, nv)."""
        return self.constraints.gradient(0.0, q)

    def bias(self, q: Array, u: Array) -> Array:
        """γ (m,)."""
        return evaluated(self._bias, 0.0, q, u, self.values).ravel()

    def displaced(self, q: Array, step: Array) -> Array:
        """The coordinates after a small step (nv,) along the speeds."""
        return self.constraints.displaced(q, step)

    def closed_at(self, q: Array, drives: Array, iterations: int = ITERATIONS) -> Array | None:
        """The coordinates near q that satisfy the constraints at the drives (n,), to round-off.

        None if Newton's method does not find them within this number of iterations.
        """
        q = q.copy()
        q[self.q_driven] = drives
        step = np.zeros(self.layout.nv)
        dependent = self.dependent
        for _ in range(iterations):
            gaps = self.constraints.position(0.0, q)
            slope = self.constraints.scaled_gradient(0.0, q)[:, dependent]
            if not (np.all(np.isfinite(gaps)) and np.all(np.isfinite(slope))):
                return None
            found = -least_solution(slope, self.in_natural_units(q, gaps))
            size = float(np.max(np.abs(found), initial=0.0))
            step[dependent] = self.scale[dependent] * found * min(1.0, LONGEST / max(size, LONGEST))
            q = self.displaced(q, step)
            if size <= SETTLED:  # the next step is round-off
                break
        return q if self.is_closed(q) else None

    def is_closed(self, q: Array) -> bool:
        """Whether a configuration satisfies the constraints in the right assembly mode."""
        gaps = self.constraints.position(0.0, q)
        right = np.all(self.constraints.branch_checks(0.0, q) > 0.0)
        return bool(np.all(np.abs(gaps) <= CLOSED * self.constraints.row_sizes(0.0, q)) and right)

    def rates(self, q: Array, speeds: Array, accelerations: Array) -> tuple[Array, Array] | None:
        """u (nv,) and u' (nv,) for speeds (n,) and accelerations (n,) of the drives; None at a dead point."""
        matrix = self.stacked(q)
        left, values, right = np.linalg.svd(matrix, full_matrices=False)
        if values[-1] <= SINGULAR * values[0]:
            return None

        def solved(rows: Array, driven: Array) -> Array:
            wanted = np.concatenate([self.in_natural_units(q, rows), driven / self.scale[self.u_driven]])
            found = right.T @ ((left.T @ wanted) / values)
            found += right.T @ ((left.T @ (wanted - matrix @ found)) / values)
            result = self.scale * found
            result[self.u_driven] = driven
            return np.asarray(result)

        u = solved(np.zeros(len(matrix) - len(self.drives)), speeds)
        return u, solved(-self.bias(q, u), accelerations)

    def stacked(self, q: Array) -> Array:
        """G above S in natural units."""
        selection = np.eye(self.layout.nv)[self.u_driven]
        return np.vstack([self.constraints.scaled_gradient(0.0, q), selection])

    def in_natural_units(self, q: Array, rows: Array) -> Array:
        """Right sides (m, …) of the rows, such as gaps; zero for rows without a size."""
        sizes = self.constraints.row_sizes(0.0, q)
        return np.asarray((rows.T / np.where(sizes > 0.0, sizes, np.inf)).T)

    def _plain_angles(self) -> NDArray[np.bool_]:
        """Which of the coordinates (nq,) are angles."""
        found = np.zeros(self.layout.nq, dtype=bool)
        for name, joint in self.mechanism.joints.items():
            if joint.kind.quaternion is None:
                found[self.layout.q[name]] = [one.rotation for one in joint.kind.coordinates]
        return found

    def _place_in_q(self, name: str) -> int:
        return coordinate_columns(self.mechanism)[self.mechanism.coordinate_names.index(name)]

    def _require_determined(self) -> None:
        free, given = self.degrees_of_freedom, len(self.drives)
        if free == given:
            return
        others = [name for name in drivable(self.mechanism) if name not in self.drives]
        remedy = f"Give ranges for {counted(free, 'coordinate')}, of {listed(list(drivable(self.mechanism)))}."
        if free > given:
            remedy = f"Give ranges for {free - given} more of {listed(others)}; a constant one holds a coordinate."
            if sum(joint.type == "spherical" for joint in self.mechanism.all_joints.values()) > 1:
                remedy += " A part between two spherical joints can turn idly: replace it by a 'distance' constraint."
        raise InputError(
            f"{self.mechanism.name} has {free} degree{'s' if free != 1 else ''} of freedom, and {given} "
            f"coordinate{'s are' if given != 1 else ' is'} driven",
            remedy,
        )


class UnreachableError(MbdSimError):
    """A drive cannot go through its range: the text says how far it gets."""
