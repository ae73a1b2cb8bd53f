"""The loads of the joints as functions, which are traced when they are first read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.accelerations import ConstrainedMotion, coupling_forces, drive_table
from mbd_sim.dynamics.constraints.start import Assembly
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.recursion.reactions import joint_reactions, joint_springs, wrenches_of_multipliers


def reactions_at(traced: TracedMechanism, assembly: Assembly, motion: ConstrainedMotion, multipliers: ca.SX) -> ca.SX:
    """The wrenches (6, joints) across the joints, see `joint_reactions`, with the springs of all joints."""
    return joint_reactions(traced, motion.transmitted(), assembly.equations, multipliers) + joint_springs(traced)


def reaction_function(
    traced: TracedMechanism, assembly: Assembly, motion: ConstrainedMotion, multipliers: ca.SX
) -> ca.Function:
    """(t, y, inputs) -> the wrenches across the joints."""
    wrenches = reactions_at(traced, assembly, motion, multipliers)
    inputs = [traced.state.t, traced.y, traced.inputs]
    return ca.Function("reactions", inputs, [ca.densify(wrenches)], {"cse": True})


@dataclass(frozen=True, slots=True)
class Loads:
    """Loads of a state, and their derivatives by the multipliers λ (m,) at fixed u'.

    `reactions` (6 joints,) joint by joint and `multipliers` (m,) are those that the equations of motion give;
    `of_reactions` (6 joints, m) and `of_drives` (n, m) are the derivatives of the reactions and of the drives' forces;
    `gradient` (m, nv) is G.
    """

    reactions: Array
    multipliers: Array
    of_reactions: Array
    of_drives: Array
    gradient: Array


@dataclass(frozen=True, eq=False)
class LoadPaths:
    """How multipliers become loads.

    `function(t, y, inputs)` is one vector of all `Loads`, matrices column by column, so that it is compiled as one
    function; `loads` takes it apart. `idle` are the rows of constraints whose gradient is zero in all states and for
    all parameters, by the structure of the expressions, as those across the plane of a plane linkage. `idle_unloaded`
    says that, likewise, their multipliers are zero, and that each component of a reaction that they affect is zero.
    """

    function: ca.Function
    shapes: Sequence[tuple[int, int]]
    idle: Sequence[int]
    idle_unloaded: bool

    def values(self, t: float, y: Array, inputs: Array) -> Array:
        """The output (size,) of the function, evaluated by CasADi."""
        return np.array(self.function(t, y, inputs), dtype=float).ravel()

    def loads(self, values: Array) -> Loads:
        """The loads (views) in the output (size,) of the function."""
        first, found = 0, []
        for rows, columns in self.shapes:
            found.append(values[first : first + rows * columns].reshape(columns, rows).T)
            first += rows * columns
        reactions, multipliers, *matrices = found
        return Loads(reactions[:, 0], multipliers[:, 0], *matrices)


def load_paths(traced: TracedMechanism, assembly: Assembly, motion: ConstrainedMotion, multipliers: ca.SX) -> LoadPaths:
    """See `LoadPaths`."""
    constraints = assembly.equations
    units = ca.SX.sym("multipliers", len(constraints.rows))
    transmitted = wrenches_of_multipliers(traced, constraints, units)
    by_units = ca.vec(joint_reactions(traced, transmitted, constraints, units))
    drives = drive_table(traced, lambda: transmitted, coupling_forces(constraints, units))[:, 2]
    reactions = ca.sparsify(ca.vec(reactions_at(traced, assembly, motion, multipliers)))
    of_reactions, gradient = ca.sparsify(ca.jacobian(by_units, units)), ca.sparsify(constraints.gradient)
    outputs = [reactions, ca.sparsify(multipliers), of_reactions, ca.jacobian(drives, units), gradient]
    idle = [row for row in range(gradient.size1()) if not gradient[row, :].nnz()]
    of_idle = of_reactions[:, idle].T @ reactions
    function = ca.Function(
        "load_paths",
        [traced.state.t, traced.y, traced.inputs],
        [ca.densify(ca.vertcat(*(ca.vec(output) for output in outputs)))],
        {"cse": True},
    )
    return LoadPaths(
        function,
        shapes=[output.shape for output in outputs],
        idle=idle,
        idle_unloaded=not of_idle.nnz() and not outputs[1][idle].nnz(),
    )
