"""Small motions about a state: the linearized equations, found exactly, and their natural modes.

Contacts stay in the modes that are among the inputs: closed gaps and sticking friction are constraints then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from mbd_sim.analysis.contact_motion import ContactMotion, has_contact
from mbd_sim.dynamics.assembly import null_space
from mbd_sim.dynamics.constraint_functions import ConstraintFunctions
from mbd_sim.dynamics.equations import Equations
from mbd_sim.geometry.pose import Array

ZERO_EIGENVALUE = 1e-4  # 1/s; smaller eigenvalues are zeros that round-off has split
UNDAMPED = 1e-12  # damping ratios of round-off
DIFFERENCE = 1e-6  # m or rad, the displacement of finite differences


@dataclass(frozen=True, eq=False)
class Linearization:
    """x' = A x + B e about a state, with x = (p, w): displacements and changes of speed along the free directions.

    `a` is (n, n) and `b` (n, nv), found by exact differentiation. A displacement p changes the coordinates by
    N `displacements` p, with q' = N u and `displacements` (nv, k); w changes the speeds by `speeds` w, with `speeds`
    (nv, l). Without constraints both matrices are the identity, so that x is the change of q (along the speeds) and
    of u. Where friction sticks, l < k: what sticks can be displaced, but does not move.
    """

    a: Array
    b: Array
    displacements: Array
    speeds: Array


class Mode(NamedTuple):
    """A natural mode: undamped `frequency` in Hz, `damping` ratio, and `eigenvalue` in 1/s.

    A real eigenvalue belongs to a motion that does not oscillate: its frequency is 0 and its damping ratio 1, or -1
    if the motion grows.
    """

    frequency: float
    damping: float
    eigenvalue: complex


def linearize(
    equations: Equations, q: Array, u: Array, efforts: Array, t: float = 0.0, inputs: Array | None = None
) -> Linearization:
    """Linearize about a state that satisfies the constraints.

    :param q: (nq,) coordinates.
    :param u: (nv,) speeds.
    :param efforts: (nv,) in N and N·m.
    :param t: time in s.
    :param inputs: all inputs of the equations, for wrenches, live values and the modes of contacts; `efforts` replace
        those in it. By default there are no wrenches, live values are those of the mechanism, and contacts are open.
    :raises MbdSimError: a contact is about to change, so that there is no linearization.
    """
    given = (equations.inputs_without_commands if inputs is None else inputs).copy()
    given[equations.inputs.efforts] = efforts
    nq, nv = equations.layout.nq, equations.layout.nv
    constraints = equations.constraints.with_values(given[equations.inputs.values])
    gradient, holonomic = constraints.gradient(t, q), constraints.holonomic
    if has_contact(equations, given):
        motion = ContactMotion(equations).at(t, q, u, given)
        by_state, by_efforts, n = motion.by_state, motion.by_efforts, motion.n
        gradient = np.vstack([gradient, motion.gradient])
        holonomic, slopes = np.concatenate([holonomic, motion.holonomic]).astype(bool), motion.slopes @ n
    else:
        by_state, by_efforts, n = (np.array(value) for value in acceleration_derivatives(equations)(t, q, u, given))
        slopes = np.zeros((0, nv))
    displacements = null_space(gradient[holonomic])
    speeds = null_space(gradient)
    if not len(gradient):
        displacements = speeds = np.eye(nv)
    by_displacements, by_speeds = by_state[:, :nq] @ n @ displacements, by_state[:, nq:]
    # The speeds that satisfy the displaced constraints are not only combinations of the free directions.
    required = _speed_changes(constraints, t, q, u, displacements, gradient, slopes)
    to_p, to_w = np.linalg.pinv(displacements), np.linalg.pinv(speeds)
    a = np.block(
        [
            [to_p @ required, to_p @ speeds],
            [to_w @ (by_displacements + by_speeds @ required), to_w @ by_speeds @ speeds],
        ]
    )
    b = np.vstack([np.zeros((displacements.shape[1], nv)), to_w @ by_efforts])
    return Linearization(a, b, displacements, speeds)


def acceleration_derivatives(equations: Equations) -> ca.Function:
    """(t, q, u, inputs) -> ∂u'/∂(q, u) (nv, nq + nv), ∂u'/∂e (nv, nv), and N (nq, nv) with q' = N u."""
    nq, nv = equations.layout.nq, equations.layout.nv
    t, q, u, inputs = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("u", nv), ca.SX.sym("e", equations.inputs.size)
    y = ca.vertcat(q, u, ca.SX.zeros(equations.start_state.size - nq - nv))
    rates = equations.rates.call([t, y, inputs])[0]
    accelerations = rates[nq : nq + nv]
    outputs = [
        ca.jacobian(accelerations, ca.vertcat(q, u)),
        ca.jacobian(accelerations, inputs)[:, equations.inputs.efforts],
        ca.jacobian(rates[:nq], u),
    ]
    return ca.Function("derivatives", [t, q, u, inputs], [ca.densify(output) for output in outputs])


def _speed_changes(
    constraints: ConstraintFunctions,
    t: float,
    q: Array,
    u: Array,
    displacements: Array,
    gradient: Array,
    contact_slopes: Array,
) -> Array:
    """The changes of the speeds (nv, k) for each displacement with which the constraints still hold.

    :param gradient: (m, nv) of the constraints, and of contacts after them.
    :param contact_slopes: the derivatives (contacts, nv) of the contacts' rates by displacements.
    """
    if not len(gradient) or not (u.any() or contact_slopes.any()):
        return np.zeros((len(u), displacements.shape[1]))
    columns = []
    for direction in displacements.T:
        ahead, behind = (constraints.displaced(q, sign * DIFFERENCE * direction) for sign in (1.0, -1.0))
        errors = [constraints.gradient(t, moved) @ u + constraints.drift(t, moved) for moved in (ahead, behind)]
        slope = (errors[0] - errors[1]) / (2.0 * DIFFERENCE)
        slope = np.concatenate([slope, contact_slopes @ direction])
        columns.append(-np.linalg.lstsq(gradient, slope, rcond=None)[0])
    return np.array(columns).T


def modes(linearization: Linearization) -> list[Mode]:
    """The natural modes in the order of their frequency; one for each pair of conjugate eigenvalues."""
    found = []
    for value in np.linalg.eigvals(linearization.a):
        if value.imag < -1e-9 * abs(value):
            continue
        size = float(abs(value))
        oscillates = abs(value.imag) > 1e-7 * max(size, 1e-9)
        if size < ZERO_EIGENVALUE:
            found.append(Mode(0.0, 0.0, 0j))
        elif oscillates:
            damping = float(-value.real / size)
            found.append(Mode(size / (2.0 * math.pi), damping if abs(damping) > UNDAMPED else 0.0, complex(value)))
        else:
            found.append(Mode(0.0, -math.copysign(1.0, value.real), complex(value.real)))
    return sorted(found, key=lambda mode: (mode.frequency, abs(mode.eigenvalue), mode.eigenvalue.real))
