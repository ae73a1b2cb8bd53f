"""The loads of the joints as functions, which are traced when they are first read."""

from __future__ import annotations

import casadi as ca

from mbd_sim.dynamics.accelerations import ConstrainedMotion, coupling_forces, drive_table
from mbd_sim.dynamics.constraint_equations import ConstraintEquations
from mbd_sim.dynamics.initial_conditions import Assembly
from mbd_sim.dynamics.reactions import joint_reactions, wrenches_of_multipliers
from mbd_sim.dynamics.tracing import TracedMechanism


def reactions_at(traced: TracedMechanism, assembly: Assembly, motion: ConstrainedMotion, multipliers: ca.SX) -> ca.SX:
    """The wrenches (6, joints) across the joints, see `joint_reactions`."""
    return joint_reactions(traced, motion.transmitted, assembly.equations, multipliers)


def reaction_function(
    traced: TracedMechanism, assembly: Assembly, motion: ConstrainedMotion, multipliers: ca.SX
) -> ca.Function:
    """(t, y, inputs) -> the wrenches across the joints."""
    wrenches = reactions_at(traced, assembly, motion, multipliers)
    inputs = [traced.state.t, traced.y, traced.inputs]
    return ca.Function("reactions", inputs, [ca.densify(wrenches)], {"cse": True})


def load_paths(traced: TracedMechanism, constraints: ConstraintEquations) -> ca.Function:
    """See `Equations.load_paths`."""
    multipliers = ca.SX.sym("multipliers", len(constraints.rows))
    transmitted = wrenches_of_multipliers(traced, constraints, multipliers)
    reactions = ca.vec(joint_reactions(traced, transmitted, constraints, multipliers))
    drives = drive_table(traced, transmitted, coupling_forces(constraints, multipliers))[:, 2]
    inputs = [traced.state.t, traced.y, traced.inputs]
    outputs = [ca.jacobian(reactions, multipliers), ca.jacobian(drives, multipliers), constraints.gradient]
    return ca.Function("load_paths", inputs, [ca.densify(output) for output in outputs], {"cse": True})
