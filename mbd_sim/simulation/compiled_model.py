"""A mechanism compiled: everything that can be computed from a state. It has no state of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.dynamics.assembly import close_loops, nearest_speeds
from mbd_sim.dynamics.equations import AUDIT, derive
from mbd_sim.dynamics.symbolic_parameters import Values
from mbd_sim.errors import MechanismError, Problem, nearest
from mbd_sim.geometry.pose import Array, Pose, unpack_poses
from mbd_sim.geometry.rotation import unit
from mbd_sim.integrators.methods import METHODS, Method
from mbd_sim.mechanism.records import Mechanism


class Energies(NamedTuple):
    """The energy audit, all in J.

    `residual = total - total at the start - work_applied - work_drives + dissipated` is the error of the
    integration: it is zero for an exact solution.
    """

    kinetic: float
    potential: float
    dissipated: float
    work_applied: float
    work_drives: float
    total: float
    residual: float


class Violation(NamedTuple):
    """How far the constraints are off at most: in position, m or 1, and in velocity, m/s or 1/s."""

    position: float
    velocity: float


class Drive(NamedTuple):
    """A driven coordinate: m or rad, and their rate; and the force or moment that its drive exerts, N or N·m."""

    position: float
    velocity: float
    force: float


class Reaction(NamedTuple):
    """What goes through a joint: `force` (3,) in N and `moment` (3,) in N·m on its second part, in ground's axes.

    The moment is about the joint's point on the second part. Springs, efforts and drives of the joint are part of it,
    and so is what a gear, rack or coupling exerts: those act on the coordinates of joints, as a couple or a force
    between the parts of each, and put no load of their own on the bearings. Redundant equations carry nothing.
    """

    force: Array
    moment: Array


class Model:
    """The compiled equations of a mechanism, for one method. Safe to use from several threads.

    The integrated state y is q (nq,), u (nv,) and the audit's three energies. `inputs` are what the equations take
    from outside where nothing is commanded, see `InputLayout`; they are meant where a method is given none.
    """

    def __init__(
        self, mechanism: Mechanism, method: Method, loaded: Sequence[str] = (), values: Values | None = None
    ) -> None:
        self.mechanism, self.method = mechanism, method
        equations = derive(mechanism, loaded, values)
        readers = {
            "energies": equations.energies,
            "poses": equations.poses,
            "drives": equations.drives,
            "violation": equations.violation,
        }
        self.equations = equations
        self.layout, self.start, self.part_names = equations.layout, equations.start_state, equations.part_names
        self.coordinate_names, self.driven_names = mechanism.coordinate_names, mechanism.driven_names
        self.q_range = slice(0, self.layout.nq)
        centers = [mechanism.parts[part].center for part in loaded]
        self.inputs = equations.inputs.at_rest(centers, equations.values.base)
        self.u_range = slice(self.layout.nq, self.layout.nq + self.layout.nv)
        self.kernel = compile_kernel(equations.rates, equations.settle, readers, method, self.u_range)
        self.quaternions = {
            name: self.layout.q[name].start + offset
            for name, joint in mechanism.joints.items()
            if (offset := joint.kind.quaternion) is not None and not joint.drive
        }

    @property
    def degrees_of_freedom(self) -> int:
        """How many of the speeds are independent."""
        return self.layout.nv - self.equations.start.rank

    def _read(self, name: str, time: float, y: Array, out: Array, inputs: Array | None) -> Array:
        moment, given = np.array([time]), self.inputs if inputs is None else inputs
        arrays = [moment, y, given, out] if self.kernel.reads_inputs[name] else [moment, y, out]
        self.kernel.readers[name](*(array.ctypes.data for array in arrays))
        return out

    def energies(self, time: float, y: Array, start_total: float = 0.0, inputs: Array | None = None) -> Energies:
        """The audit at a state; `start_total` is T + V at the start."""
        kinetic, potential = self._read("energies", time, y, np.empty(2), inputs).tolist()
        work_applied, work_drives, dissipated = y[-len(AUDIT) :].tolist()
        total = kinetic + potential
        residual = total - start_total - work_applied - work_drives + dissipated
        return Energies(kinetic, potential, dissipated, work_applied, work_drives, total, residual)

    def pose_array(self, time: float, y: Array, inputs: Array | None = None) -> Array:
        """The pose rows (parts, 12) of `part_names` in ground's frame: see `mbd_sim.geometry.pose.unpack_poses`."""
        return self._read("poses", time, y, np.empty((len(self.part_names), 12)), inputs)

    def poses(self, time: float, y: Array, inputs: Array | None = None) -> Mapping[str, Pose]:
        """The pose of each part in ground's frame."""
        positions, rotations = unpack_poses(self.pose_array(time, y, inputs))
        return {
            name: Pose(position.copy(), rotation.copy())
            for name, position, rotation in zip(self.part_names, positions, rotations, strict=True)
        }

    def drives(self, time: float, y: Array, inputs: Array) -> Array:
        """(3, n): the coordinates of `driven_names`, their speeds, and the forces that the drives exert, SI units."""
        return self._read("drives", time, y, np.empty((3, len(self.driven_names))), inputs)

    def violation(self, time: float, y: Array, inputs: Array | None = None) -> Violation:
        """How far the constraints are off."""
        out = self._read("violation", time, y, np.zeros((2, len(self.equations.rows))), inputs)
        return Violation(*np.max(np.abs(out), axis=1, initial=0.0).tolist())

    def multipliers(self, time: float, y: Array, inputs: Array) -> Mapping[str, Array]:
        """The multipliers λ of each loop and constraint by name, one a row: M u' + h = Q + Gᵀ λ. Redundant rows have 0.

        A distance constraint's is the force in N that pushes its ends apart; a rolling constraint's are the normal
        force and the two of friction.
        """
        values = np.array(self.equations.multipliers(time, y, inputs)).ravel()
        names = [str(row.owner[1]) for row in self.equations.rows]
        return {name: values[[other == name for other in names]] for name in dict.fromkeys(names)}

    def reactions(self, time: float, y: Array, inputs: Array) -> Mapping[str, Reaction]:
        """What goes through each joint, those of the tree first, then those that close loops."""
        found = np.array(self._reactions(time, y, inputs)).T
        names = [*self.mechanism.joints, *self.mechanism.closing]
        return {name: Reaction(row[:3], row[3:]) for name, row in zip(names, found, strict=True)}

    @cached_property
    def _reactions(self) -> ca.Function:
        return self.equations.reactions()

    def consistent(self, q: Array, u: Array, values: Array | None = None) -> tuple[Array, Array]:
        """The state at t = 0 that meets the constraints, near a given one; `values` are those among the inputs.

        :raises ValueError: no state near it does.
        """
        if not self.equations.rows:
            return q, u
        conditions = self.equations.conditions if values is None else self.equations.make_conditions(values)
        closing = close_loops(conditions, 0.0, q, np.ones(self.layout.nv, dtype=bool))
        if not closing.closed:
            raise ValueError(
                f"no position near these coordinates closes the loops: {np.max(np.abs(closing.gaps)):.3g} stay open"
            )
        return closing.q, nearest_speeds(conditions, 0.0, closing.q, u)

    def normalize(self, y: Array) -> None:
        """Give the quaternions of a state unit length.

        :raises ValueError: one of them is zero.
        """
        for joint, start in self.quaternions.items():
            if not np.any(y[start : start + 4]):
                raise ValueError(f"the quaternion of joint '{joint}' is zero")
            y[start : start + 4] = unit(y[start : start + 4])

    def coordinates(self, y: Array) -> Array:
        """(nv,): a position for each of `coordinate_names`; free joints give x, y, z and the rotation vector in rad."""
        if not self.quaternions:
            return y[self.q_range]
        values = np.empty(self.layout.nv)
        for name, into in self.layout.u.items():
            source = y[self.layout.q[name]]
            if name in self.quaternions:
                offset = self.quaternions[name] - self.layout.q[name].start
                source = np.concatenate([source[:offset], rotation_vector(source[offset:])])
            values[into] = source
        return values


def rotation_vector(quaternion: Array) -> Array:
    """Axis times angle (3,), at most π long, of a unit quaternion (w, x, y, z)."""
    w, v = (quaternion[0], quaternion[1:]) if quaternion[0] >= 0.0 else (-quaternion[0], -quaternion[1:])
    sine = float(np.linalg.norm(v))
    return v * (2.0 * np.arctan2(sine, w) / sine if sine > 1e-9 else 2.0)


def build_model(
    mechanism: Mechanism, method: str | None = None, loaded: Sequence[str] = (), values: Values | None = None
) -> Model:
    """Compile a mechanism, with its own method or the one named; see `derive` for the others.

    :raises MechanismError: the method is unknown, or the equations are singular at the start.
    """
    name = method or mechanism.method
    if name not in METHODS:
        message, remedy = f"there is no method '{name}'", nearest(name, METHODS)
        if method:
            raise MechanismError([Problem(message, remedy, key="method")])
        raise MechanismError([mechanism.source.problem(("integrator", "method"), message, remedy)])
    return Model(mechanism, METHODS[name], loaded, values)
