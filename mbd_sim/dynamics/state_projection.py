"""The projection of a state onto unit quaternions and onto the constraints."""

from __future__ import annotations

import casadi as ca

from mbd_sim.dynamics.kinematics import normalized_quaternions
from mbd_sim.dynamics.multipliers import ConstraintSolver
from mbd_sim.dynamics.tracing import TracedMechanism


def projected_state(traced: TracedMechanism, solver: ConstraintSolver | None) -> ca.SX | None:
    """The state y after projection: first the coordinates, then the speeds at the new position.

    Returns None where there are neither quaternions nor constraints.
    """
    state = traced.state
    q, u = state.q, state.u
    if solver is not None:
        displacement, u_change = solver.corrections(state)
        q, u = q + ca.jacobian(state.q_rates, state.u) @ displacement, u + u_change
    projected = ca.vertcat(normalized_quaternions(traced.links, q), u, traced.actuator_states, traced.audit)
    return None if ca.is_equal(projected, traced.y) else projected
