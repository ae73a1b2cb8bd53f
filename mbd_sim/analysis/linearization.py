"""Small motions about a state: the linearized equations, found exactly, and their natural modes.

Contacts stay in the modes that are among the inputs: closed gaps and sticking friction are constraints then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from mbd_sim.analysis.contact_motion import ContactMotion
from mbd_sim.dynamics.assembly import null_space
from mbd_sim.dynamics.constraint_functions import ConstraintFunctions
from mbd_sim.dynamics.equations import Equations
from mbd_sim.errors import MechanismError, Problem, listed
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.actuators import channel_names

ZERO_EIGENVALUE = 1e-4  # 1/s; smaller eigenvalues are zeros that round-off has split
UNDAMPED = 1e-12  # damping ratios of round-off
DIFFERENCE = 1e-6  # m or rad, the displacement of finite differences


@dataclass(frozen=True, eq=False)
class Linearization:
    """x' = A x + B e + C c about a state, with x = (p, w, s), efforts e and commands of actuators c.

    x holds displacements p and changes of speed w along the free directions, and changes s of the states of actuators.
    `a` is (n, n), `b` (n, nv) and `by_commands` (n, m), found by exact differentiation. A displacement p changes the
    coordinates by N `displacements` p, with q' = N u and `displacements` (nv, k); w changes the speeds by `speeds` w,
    with `speeds` (nv, l). Without constraints both matrices are the identity, so that p is the change of q (along the
    speeds) and w that of u. Where friction sticks, l < k: what sticks can be displaced, but does not move.

    `states` are the names of s, such as `drive.current`, and `commands` those of c, such as `drive.voltage`, in their
    order and in SI units. Drives that follow commands move on as they do at the state: neither their states nor their
    commands are among these.
    """

    a: Array
    b: Array
    displacements: Array
    speeds: Array
    by_commands: Array
    states: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()


class Mode(NamedTuple):
    """A natural mode: undamped `frequency` in Hz, `damping` ratio, and `eigenvalue` in 1/s.

    A real eigenvalue belongs to a motion that does not oscillate: its frequency is 0 and its damping ratio 1, or -1
    if the motion grows.
    """

    frequency: float
    damping: float
    eigenvalue: complex


def linearize(
    equations: Equations,
    q: Array,
    u: Array,
    efforts: Array,
    t: float = 0.0,
    inputs: Array | None = None,
    states: Array | None = None,
) -> Linearization:
    """Linearize about a state that satisfies the constraints.

    :param q: (nq,) coordinates.
    :param u: (nv,) speeds.
    :param efforts: (nv,) in N and N·m.
    :param t: time in s.
    :param inputs: all inputs of the equations, for wrenches, commands, live values and the modes of contacts; `efforts`
        replace those in it. By default there are no wrenches, commands are those at the start, live values are those
        of the mechanism, and contacts are open.
    :param states: (s,) states of actuators, see `Equations.core`; by default those at the start.
    :raises MechanismError: an actuator changes only between steps: it is sampled, delayed, or has a rate limit.
    :raises MbdSimError: a contact is about to change, so that there is no linearization.
    """
    _require_continuous(equations)
    given = (equations.inputs_without_commands if inputs is None else inputs).copy()
    given[equations.inputs.efforts] = efforts
    nq, nv = equations.layout.nq, equations.layout.nv
    s = equations.start_state[nq + nv : equations.core.stop] if states is None else states
    constraints = equations.constraints.with_values(given[equations.inputs.values])
    gradient, holonomic = constraints.gradient(t, q), constraints.holonomic
    if equations.has_contact(given):
        motion = ContactMotion(equations).at(t, q, u, s, given)
        by_state, by_inputs, n = motion.by_state, motion.by_inputs, motion.n
        gradient = np.vstack([gradient, motion.gradient])
        holonomic, slopes = np.concatenate([holonomic, motion.holonomic]).astype(bool), motion.slopes @ n
    else:
        by_state, by_inputs, n = (np.array(value) for value in rate_derivatives(equations)(t, q, u, s, given))
        slopes = np.zeros((0, nv))
    displacements = null_space(gradient[holonomic])
    speeds = null_space(gradient)
    if not len(gradient):
        displacements = speeds = np.eye(nv)
    # The speeds that satisfy the displaced constraints are not only combinations of the free directions.
    required = _speed_changes(constraints, t, q, u, displacements, gradient, slopes)
    to_p, to_w = np.linalg.pinv(displacements), np.linalg.pinv(speeds)
    by_q, by_u, by_s = np.split(by_state, [nq, nq + nv], axis=1)
    rates = np.hstack([by_q @ n @ displacements + by_u @ required, by_u @ speeds, by_s])  # of (u, s) by (p, w, s)
    kinematic = np.hstack([to_p @ required, to_p @ speeds, np.zeros((len(to_p), len(s)))])
    a = np.vstack([kinematic, to_w @ rates[:nv], rates[nv:]])
    b = np.vstack([np.zeros((len(to_p), by_inputs.shape[1])), to_w @ by_inputs[:nv], by_inputs[nv:]])
    actuators = equations.mechanism.actuators
    names = equations.actuator_layout.core_names(actuators), channel_names(actuators)
    by_commands = b[:, nv : nv + len(names[1])]  # those of drives follow, and change only the drives' accelerations
    return Linearization(a, b[:, :nv], displacements, speeds, by_commands, *names)


def rate_derivatives(equations: Equations) -> ca.Function:
    """(t, q, u, s, inputs) -> derivatives of (u', s') by (q, u, s) and by efforts and commands, and N with q' = N u.

    s are the states of actuators on which rates depend; commands follow the efforts.
    """
    nq, nv, core = equations.layout.nq, equations.layout.nv, equations.core
    t, q, u, inputs = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("u", nv), ca.SX.sym("e", equations.inputs.size)
    s = ca.SX.sym("s", core.stop - nq - nv)
    y = ca.vertcat(q, u, s, ca.SX.zeros(equations.start_state.size - core.stop))
    all_rates = equations.rates.call([t, y, inputs])[0]
    rates = all_rates[core]
    by_inputs = ca.jacobian(rates, inputs)[:, equations.inputs.acting]
    outputs = [ca.jacobian(rates, ca.vertcat(q, u, s)), by_inputs, ca.jacobian(all_rates[:nq], u)]
    return ca.Function("derivatives", [t, q, u, s, inputs], [ca.densify(output) for output in outputs])


def _require_continuous(equations: Equations) -> None:
    """Refuse actuators that change between steps only.

    :raises MechanismError: they are named.
    """
    layout = equations.actuator_layout
    actuators = zip(equations.mechanism.actuators, layout.slots, strict=True)
    names = [actuator.name for actuator, slots in actuators if slots.changes_between_steps]
    if names:
        message = f"{equations.mechanism.name} cannot be linearized, because actuators change only between steps"
        remedy = "Leave out 'sample_rate', 'delay' and 'rate_limit' for a linearization."
        raise MechanismError([Problem(f"{message}: {listed(names)}", remedy)])


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
