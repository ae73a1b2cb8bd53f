"""Small motions about a state: the linearized equations, found exactly, and their natural modes.

Contacts stay in the modes that are among the inputs: closed gaps and sticking friction are constraints then.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.analysis.linear.small_motion import small_motion
from mbd_sim.base.errors import MbdSimError, quoted
from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.dynamics.equations import Equations, require_equations
from mbd_sim.dynamics.layouts.coordinate_names import names_of_q
from mbd_sim.mechanism.contents import channel_names
from mbd_sim.mechanism.natural_units import natural_units

ZERO_EIGENVALUE = 1e-4  # of the natural rate; smaller ones are zeros that round-off has split, unless all are small:
LEAST_EIGENVALUE, SPLIT = (
    1e-6,
    1e-5,
)  # the same, at rates of 1/s √(ε g/r) of a balanced r = 1 mm, and relative to the largest
BRIEF, VARIES = 1e-4, 1e-3  # of the time scale of A, after which A is computed again, and its relative change by then
BALANCED = 1e-9  # relative rate of a state that counts as constant
UNDAMPED = 1e-12  # damping ratios of round-off


@record
class Linearization:
    """x' = A x + B e + C c about a state, with x = (p, w, s), efforts e and commands of actuators c.

    x holds displacements p and changes of speed w along the free directions, and changes s of the states of actuators.
    `a` is (n, n), `b` (n, nv) and `by_commands` (n, m), found by exact differentiation. A displacement p changes the
    coordinates by N `displacements` p, with q' = N u and `displacements` (nv, k); w changes the speeds by `speeds` w,
    with `speeds` (nv, l). Without constraints both matrices are the identity, so that p is the change of q (along the
    speeds) and w that of u. About a moving state these directions are those of the moment. Small rotations of
    spherical and free joints that turn are about axes that turn with the part or, if the derivatives are steadier
    there, about those before the joint: see `mbd_sim.analysis.linear.small_motion`. Where friction sticks, l < k: what
    sticks can be displaced, but does not move.

    `states` are the names of s, such as `drive.current`, and `commands` those of c, such as `drive.voltage`, in their
    order and in SI units. Drives that follow commands move on as they do at the state: neither their states nor their
    commands are among these. A `remark` says that A changes along the motion, if it does. Eigenvalues that are tiny
    beside the natural `rate` in 1/s are zeros.
    """

    a: Array
    b: Array
    displacements: Array
    speeds: Array
    by_commands: Array
    states: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    remark: str = ""
    rate: float = 1.0


@dataclass(frozen=True)
class Mode:
    """A natural mode: undamped `frequency` in Hz, `damping` ratio, and `eigenvalue` in 1/s.

    A real eigenvalue belongs to a motion that does not oscillate: its frequency is 0 and its damping ratio 1, or -1
    if the motion grows.
    """

    frequency: float
    damping: float
    eigenvalue: complex

    __repr__ = short_repr


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
    :raises TypeError: `equations` are none, for example a simulation.
    :raises ValueError: an array has another shape or is not finite.
    :raises MechanismError: an actuator changes only between steps: it is sampled, delayed, or has a rate limit.
    :raises MbdSimError: a contact is about to change, so that there is no linearization.
    """
    require_equations(equations)
    nq, nv = equations.layout.nq, equations.layout.nv
    own = equations.inputs_without_commands
    given = own.copy() if inputs is None else equations.inputs.checked(inputs)
    given[equations.inputs.efforts] = finite_vector(efforts, nv, "efforts")
    y = equations.start_state.copy()
    y[:nq] = finite_vector(q, nq, "q", lambda: names_of_q(equations.mechanism, equations.layout))
    y[nq : nq + nv] = finite_vector(u, nv, "u", lambda: equations.mechanism.coordinate_names)
    if states is not None:
        y[nq + nv : equations.core.stop] = finite_vector(states, equations.core.stop - nq - nv, "states")
    return linearize_at(equations, t, y, given)


def linearize_at(
    equations: Equations, t: float, y: Array, inputs: Array, derivatives: Callable[[], Array] | None = None
) -> Linearization:
    """Linearize about a state y that satisfies the constraints, see `linearize`.

    :param derivatives: `Equations.derivatives` in this state, by default evaluated by CasADi.
    """
    small, nv = small_motion(equations, t, y, inputs, derivatives), equations.layout.nv
    actuators = equations.mechanism.actuators
    states, commands = equations.actuator_layout.core_names(actuators), channel_names(actuators)
    b, by_commands = small.b[:, :nv], small.b[:, nv : nv + len(commands)]
    rate = natural_units(equations.mechanism, equations.step).rate
    return Linearization(small.a, b, small.displacements, small.speeds, by_commands, states, commands, rate=rate)


def variation_remark(equations: Equations, t: float, y: Array, inputs: Array, a: Array) -> str:
    """Why eigenvalues do not describe the motion from a state on: its A (n, n) changes; empty if it is constant.

    Motions with closed contacts are not examined.
    """
    nq, nv = equations.layout.nq, equations.layout.nv
    moving = slice(nq + nv)
    if np.any(inputs[equations.inputs.one_sided]):
        return ""
    rates = np.array(equations.rates.call([t, y, inputs])[0], dtype=float).ravel()[moving]
    depends_on_time = bool(equations.rates.jac_sparsity(0, 0).nnz())
    size = float(np.max(np.abs(a), initial=0.0))
    if not size or not (depends_on_time or np.max(np.abs(rates), initial=0.0) > BALANCED * size):
        return ""
    brief = BRIEF / math.sqrt(max(size, float(np.max(np.abs(rates), initial=0.0))))
    later = y.copy()
    later[moving] += brief * rates
    try:
        change = np.max(np.abs(linearize_at(equations, t + brief, later, inputs).a - a))
    except MbdSimError:
        return ""
    if change <= VARIES * BRIEF * size:
        return ""
    return (
        f"A changes along the motion at {t:.6g} s: eigenvalues say nothing of its stability, and small motions follow "
        "this A for a short time only. Linearize about an equilibrium or a steady motion for that."
    )


def modes(linearization: Linearization) -> list[Mode]:
    """The natural modes in the order of their frequency; one for each pair of conjugate eigenvalues.

    :raises TypeError: that is no linearization, such as a simulation.
    """
    if not isinstance(linearization, Linearization):
        raise TypeError(f"{quoted(linearization)} is not a Linearization. Give simulation.linearize().")
    values = np.linalg.eigvals(linearization.a)
    zero = float(size_of_zeros(values, linearization.rate))
    return sorted((mode_of(value, zero) for value in values.tolist() if not is_second_of_pair(value)), key=mode_order)


def size_of_zeros(values: NDArray[Any], rate: float) -> Array:
    """The sizes (…) in 1/s below which eigenvalues (…, n) of matrices are zeros that round-off has split.

    :param rate: the natural rate in 1/s.
    """
    largest = np.max(np.abs(values), axis=-1, initial=0.0)
    return np.asarray(np.clip(SPLIT * largest, LEAST_EIGENVALUE * rate, ZERO_EIGENVALUE * rate))


def is_second_of_pair(value: complex) -> bool:
    """Whether an eigenvalue is the conjugate of another one, which stands for both."""
    return complex(value).imag < -1e-9 * abs(value)


def mode_of(value: complex, zero: float) -> Mode:
    """The mode of an eigenvalue in 1/s; `zero` is the size below which it counts as zero."""
    value = complex(value)
    size = abs(value)
    if size < zero:
        return Mode(0.0, 0.0, 0j)
    if abs(value.imag) > 1e-7 * size:
        damping = -value.real / size
        return Mode(size / (2.0 * math.pi), damping if abs(damping) > UNDAMPED else 0.0, value)
    return Mode(0.0, -math.copysign(1.0, value.real), complex(value.real))


def mode_order(mode: Mode) -> tuple[float, float, float]:
    """The order of modes."""
    return mode.frequency, abs(mode.eigenvalue), mode.eigenvalue.real
