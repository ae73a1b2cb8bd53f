"""The integration method of a model: the one that was asked for, or one that is stable at the mechanism's rates.

The fastest motion near a state is the eigenvalue of the equations that is largest in size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.errors import MechanismError, Problem, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.kernel import unfit
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.equations import Equations
from mbd_sim.integrators.method import Method
from mbd_sim.integrators.methods import METHODS
from mbd_sim.mechanism.contents import one_sided_names
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.prepared import AUTO

if TYPE_CHECKING:
    from mbd_sim.dynamics.equations import Equations

DEFAULT, ONE_STEP, STIFF, STIFF_JOINTS = "adams11", "tsitouras8", "rosenbrock", "rosenbrock_w"
TRIVIAL = 2  # instructions of the rates, which cost less than the history of a method that uses earlier steps
EXPLICIT_SHARE = 0.5  # the largest step times rate of what the method for stiff joints treats explicitly
CANCELLATION = 1e-4  # relative error of the difference of two rates
# The fraction of a method's stability limit up to which it is chosen: inertias vary with the configuration.
MARGIN = 0.5


@dataclass(frozen=True)
class MethodChoice:
    """A method, and a sentence that says why it was chosen or that it is unstable; empty if neither is worth saying."""

    method: Method
    remark: str = ""


def require_one_sided_method(mechanism: Mechanism, name: str) -> None:
    """Refuse a method that cannot treat one-sided elements.

    :raises MechanismError: the elements are named.
    """
    names = one_sided_names(mechanism)
    if names and name != AUTO and not METHODS[name].treats_events:
        able = ", ".join(other for other, method in METHODS.items() if method.treats_events)
        message = f"method {name} cannot treat one-sided elements ({listed(names)})"
        raise MechanismError([Problem(message, f"Use one of {able}.", key="integrator.method")])


def choose_method(mechanism: Mechanism, equations: Equations, inputs: Array, name: str, step: float) -> MethodChoice:
    """The named method; for `auto` the default one, or the implicit one where the default would be unstable.

    The default is `DEFAULT`, or `ONE_STEP` if there are samples: a method that uses earlier steps would restart after
    each of them. It is also `ONE_STEP` if the rates are `TRIVIAL`.

    The rates are those at the start, and at rest in the start configuration, where regularized friction is stiffest.

    :param inputs: of the equations, without any command.
    :param step: in s.
    :raises MechanismError: the named method cannot treat samples and delays of actuators, or what is not smooth.
    """
    sampled = _is_sampled(equations)
    default = ONE_STEP if sampled or _is_trivial(equations.rates) else DEFAULT
    method = METHODS[default if name == AUTO else name]
    if sampled and method.keeps_history:
        message = f"method {name} cannot treat actuators with a sample_rate or a delay, which act between steps"
        raise MechanismError([Problem(message, f"Use {AUTO} or {ONE_STEP}.", key="integrator.method")])
    if cannot := unfit(method, equations.rates, lambda row: _component(mechanism, equations, row)):
        raise MechanismError([Problem(f"method {name} {cannot}", f"Use {AUTO} or {DEFAULT}.", key="integrator.method")])
    if _is_slow(equations, inputs, MARGIN * method.stability_limit / step):
        return MethodChoice(method)
    mode = _fastest_at_start(equations, inputs)
    if step * mode.rate <= MARGIN * method.stability_limit:
        return MethodChoice(method)
    rates = f"{mechanism.coordinate_names[mode.speed]} has rates of {mode.rate:.1g}/s"
    if one_sided_names(mechanism) and (name == AUTO or step * mode.rate > method.stability_limit):
        remark = (
            f"{rates}, too fast for steps of {step:g} s with method {method.name}; methods for stiff mechanisms do not "
            f"treat one-sided elements. Use steps of {MARGIN * method.stability_limit / mode.rate:.2g} s, less damping "
            "or stiffness, or more inertia, such as that of a rotor."
        )
        return MethodChoice(method, remark)
    if name == AUTO:
        chosen = _implicit(equations, inputs, step, mode.rate)
        remark = (
            f"method {chosen} is used: {rates}, and with steps of {step:g} s {default}, the default, is used only up "
            f"to {MARGIN * method.stability_limit / step:.2g}/s. Select another one with 'method'."
        )
        return MethodChoice(METHODS[chosen], remark)
    if step * mode.rate <= method.stability_limit:
        return MethodChoice(method)
    remark = (
        f"{rates}, and with steps of {step:g} s method {name} is stable up to {method.stability_limit / step:.2g}/s. "
        f"Use method {STIFF} or {AUTO}."
    )
    return MethodChoice(method, remark)


def _component(mechanism: Mechanism, equations: Equations, row: int) -> str:
    """What a row of the rates is about."""
    layout = equations.layout
    if row < layout.nq + layout.nv:
        return f"the motion of {mechanism.coordinate_names[max(row - layout.nq, 0)]}"
    return "the energy account or the state of an actuator"


def _is_trivial(rates: ca.Function) -> bool:
    """Whether an evaluation of the rates takes so little time that it does not pay to avoid some."""
    transfers = rates.nnz_in() + rates.nnz_out()  # each is an instruction of CasADi, and not of the kernel
    if rates.n_instructions() - transfers > 2 * TRIVIAL:  # those of CasADi are not arranged yet
        return False
    return instruction_count(arranged(rates)) <= TRIVIAL


def _is_sampled(equations: Equations) -> bool:
    """Whether something changes in the state between steps."""
    between = None if equations.actuators is None else equations.actuators.between_steps
    return between is not None and bool(between.delays or between.samplers)


def _implicit(equations: Equations, inputs: Array, step: float, fastest: float) -> str:
    """The method for a stiff mechanism: the cheap one, if only the forces within its joints are stiff.

    Equal finite differences cancel up to their error, a small fraction of the fastest rate; so the rest counts as slow
    if it is that much slower.
    """
    others = max(fastest_without_joints(equations, 0.0, state, inputs).rate for state in _starts(equations))
    others = max([others, *(mode.rate for mode in _drive_modes(equations, inputs))])
    return STIFF_JOINTS if step * others <= EXPLICIT_SHARE or others <= CANCELLATION * fastest else STIFF


def _is_slow(equations: Equations, inputs: Array, rate: float) -> bool:
    """Whether the rates at the start surely do not exceed one in 1/s."""
    if any(mode.rate > rate for mode in _drive_modes(equations, inputs)):
        return False
    return all(is_slower(equations, 0.0, state, inputs, rate) for state in _starts(equations))


def _fastest_at_start(equations: Equations, inputs: Array) -> FastestMode:
    modes = [fastest_mode(equations, 0.0, state, inputs) for state in _starts(equations)]
    return max([*modes, *_drive_modes(equations, inputs)], key=lambda mode: mode.rate)


def _drive_modes(equations: Equations, inputs: Array) -> Iterator[FastestMode]:
    """The rates of drives that do not show at the start: of current limits, and of open valves."""
    if equations.actuators is None:
        return
    from mbd_sim.dynamics.actuators.cylinders import fastest_rate
    from mbd_sim.mechanism.elements.actuators import CoordinatePort, DcMotor, EffortMotor, FluidCylinder

    names = equations.mechanism.coordinate_names
    positions = np.array(equations.actuators.readings(0.0, equations.start_state, inputs))[0]
    for actuator, position in zip(equations.mechanism.actuators, positions.tolist(), strict=True):
        motor, at, rate = actuator.motor, actuator.port, 0.0
        match motor:
            case FluidCylinder():
                rate = fastest_rate(motor, position)
            case DcMotor():
                rate = motor.bandwidth if motor.inductance and motor.current_limit < math.inf else 0.0
            case EffortMotor():
                pass
            case _:
                assert_never(motor)
        if rate and names:
            yield FastestMode(rate, names.index(at.coordinate) if isinstance(at, CoordinatePort) else 0)


def _starts(equations: Equations) -> list[Array]:
    """The start state, and the same at rest."""
    start = equations.start_state
    at_rest = start.copy()
    at_rest[equations.layout.nq : equations.layout.nq + equations.layout.nv] = 0.0
    return [start] if np.array_equal(start, at_rest) else [start, at_rest]


DIFFERENCE = 1e-7  # of the components of a state, relative to their scales and to themselves
SQUARINGS = 6  # of a matrix, to estimate its eigenvalues: ‖A⁶⁴‖^(1/64) is within some percent of the largest


@dataclass(frozen=True, slots=True)
class FastestMode:
    """The largest |λ| of ∂f/∂y in 1/s, or -Re λ, and the index of the speed u that takes the largest part in it."""

    rate: float
    speed: int


def fastest_mode(equations: Equations, time: float, y: Array, inputs: Array) -> FastestMode:
    """The fastest mode at a state, from finite differences; the rate is 0 if it cannot be found."""
    if equations.layout.nv == 0:
        return FastestMode(0.0, 0)
    return _largest(equations, _jacobian(equations, time, y, inputs))


def fastest_decay(equations: Equations, time: float, y: Array, inputs: Array) -> FastestMode:
    """The mode that decays fastest at a state, with everything open; the rate is 0 if none does."""
    if equations.layout.nv == 0:
        return FastestMode(0.0, 0)
    return _largest(equations, _jacobian(equations, time, y, inputs), decay=True)


def is_slower(equations: Equations, time: float, y: Array, inputs: Array, rate: float) -> bool:
    """Whether the fastest mode at a state is surely not faster than a rate in 1/s; False if that remains unknown.

    It takes a tenth of the time of the eigenvalues: the largest |λ| of A is at most ‖Aᵏ‖^(1/k), and close to it for
    large k.
    """
    if equations.layout.nv == 0:
        return True
    power = _scaled(equations, _jacobian(equations, time, y, inputs)) / rate
    if not np.all(np.isfinite(power)):
        return True  # as in `fastest_mode`
    with np.errstate(all="ignore"):
        for _ in range(SQUARINGS):
            power = power @ power
            if np.linalg.norm(power) <= 1.0:
                return True
    return False


def fastest_without_joints(equations: Equations, time: float, y: Array, inputs: Array) -> FastestMode:
    """The fastest mode without what the forces within joints contribute to the derivatives."""
    nq, nv = equations.layout.nq, equations.layout.nv
    pushed = np.tile(inputs[:, None], nv + 1)  # the last column are the inputs themselves
    pushed[:nv, :nv] += np.eye(nv)  # one effort each: the equations are linear in them
    rates = np.array(equations.rates.call([time, y, pushed])[0])[nq : nq + nv]
    inverse_mass = rates[:, :-1] - rates[:, -1:]
    damping, stiffness = (np.array(value) for value in equations.joint_linearization.slopes(time, y, inputs))
    jacobian = _jacobian(equations, time, y, inputs)
    with np.errstate(all="ignore"):
        jacobian[nq : nq + nv, nq : nq + nv] += inverse_mass * damping.ravel()
        jacobian[nq : nq + nv, :nq] += inverse_mass @ stiffness
    return _largest(equations, jacobian)


def _speeds(equations: Equations) -> slice:
    return slice(equations.layout.nq, equations.layout.nq + equations.layout.nv)


def _jacobian(equations: Equations, time: float, y: Array, inputs: Array) -> Array:
    size = equations.core.stop
    states = np.tile(y[:, None], size + 1)  # the last one is the state itself
    steps = np.arange(size)
    with np.errstate(all="ignore"):  # the state or the efforts may be close to infinity
        states[steps, steps] += DIFFERENCE * (np.array(equations.scales[:size]) + np.abs(y[:size]))
        rates = np.array(equations.rates.call([time, states, inputs])[0])[:size]
        jacobian: Array = (rates[:, :-1] - rates[:, -1:]) / (states[steps, steps] - y[:size])
    return jacobian


def _scaled(equations: Equations, jacobian: Array) -> Array:
    """The derivatives of the components divided by their scales: it has the same eigenvalues."""
    scales = np.array(equations.scales[: len(jacobian)])
    scaled: Array = jacobian * scales / scales[:, None]
    return scaled


def _largest(equations: Equations, jacobian: Array, *, decay: bool = False) -> FastestMode:
    if not np.all(np.isfinite(jacobian)):
        return FastestMode(0.0, 0)
    values, vectors = np.linalg.eig(_scaled(equations, jacobian))
    rates = np.maximum(-values.real, 0.0) if decay else np.abs(values)
    fastest = int(np.argmax(rates))
    return FastestMode(float(rates[fastest]), int(np.argmax(np.abs(vectors[_speeds(equations), fastest]))))
