"""The laws of actuators as simplified SymPy expressions: their efforts, and the rates and samples of their states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import sympy as sp

from mbd_sim.base.errors import MbdSimError
from mbd_sim.dynamics.actuators.forces import actuator_forces
from mbd_sim.dynamics.actuators.functions import actuator_functions
from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism, trace
from mbd_sim.dynamics.layouts.actuators import ActuatorSlots
from mbd_sim.integrators.between_steps import Sampler
from mbd_sim.mechanism.elements.actuators import Actuator
from mbd_sim.mechanism.elements.joint_types import Channel
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.algebra.names import escaped
from mbd_sim.studies.algebra.polynomial import Algebra, Polynomial
from mbd_sim.studies.symbolic.expressions import simplified

LETTERS = {"current": "i", "integral": "I"}  # of states; others are x with their name


@dataclass(frozen=True, eq=False)
class SymbolicActuatorState:
    """A state of an actuator by its name: its `rate`, or what it becomes at each sample, every `period` in s."""

    name: str
    symbol: Any
    rate: Any | None
    sampled: Any | None
    period: float


@dataclass(frozen=True, eq=False)
class SymbolicActuator:
    """An actuator, whose `effort` adds `along` (nv,) times itself to the forces.

    The effort is the symbol of the `law`, an expression of coordinates, speeds, states and commands; None if the laws
    of the actuators are too long to be read, which then have no `states` either. `commands` are
    those in effect, by channel: they are given `delay` in s earlier. `rotation` tells N·m from N.
    """

    name: str
    effort: Any
    along: tuple[Any, ...]
    law: Any
    states: tuple[SymbolicActuatorState, ...]
    commands: Mapping[Channel, Any]
    delay: float
    rotation: bool

    @property
    def state_symbols(self) -> Mapping[str, Any]:
        """The symbol of each state by its name."""
        return {state.name: state.symbol for state in self.states}


@dataclass(frozen=True, eq=False)
class TracedActuators:
    """The traced equations of the actuators of a mechanism.

    `laws(t, y, inputs)` gives the efforts (n,) and the rates of all states of actuators, `slopes(t, y, inputs)` ∂v/∂u
    (n, nv) of the ports.
    """

    traced: TracedMechanism
    laws: ca.Function
    slopes: ca.Function
    samplers: tuple[Sampler, ...]


def traced_actuators(mechanism: Mechanism, numbers: SymbolicParameters | None) -> TracedActuators | None:
    """Trace the actuators; None if there are none."""
    if not mechanism.actuators:
        return None
    traced = trace(mechanism, parameters=numbers)
    forces = actuator_forces(traced)
    functions = actuator_functions(traced, forces)
    assert functions is not None
    efforts = ca.vertcat(*(motor.effort for motor in forces.motors))
    slopes = ca.jacobian(ca.vertcat(*(port.v for port in forces.ports)), traced.state.u)
    given = [traced.state.t, traced.y, traced.inputs]
    laws = ca.Function("laws", given, [ca.sparsify(output) for output in (efforts, forces.rates)])
    ports = ca.Function("slopes", given, [ca.sparsify(slopes)])
    return TracedActuators(traced, laws, ports, functions.between_steps.samplers)


def symbolic_actuators(
    found: TracedActuators, algebra: Algebra, inputs: Sequence[Sequence[Polynomial]], names: dict[Any, str]
) -> tuple[SymbolicActuator, ...]:
    """The actuators as expressions; `names` gets the LaTeX of their symbols.

    :param inputs: the polynomials of t, q, u, the efforts, and the parameters, if there are any.
    """
    traced, mechanism = found.traced, found.traced.numeric
    pairs = zip(mechanism.actuators, traced.actuators.slots, strict=True)
    symbols = [_Symbols(actuator, slots, names) for actuator, slots in pairs]
    time, y, given = state_and_inputs(traced, algebra, inputs, symbols)
    (slopes,) = simplified(mechanism, algebra, found.slopes, [time, y, given])
    samples: dict[int, Any] = {}
    try:
        efforts, rates = simplified(mechanism, algebra, found.laws, [time, y, given])
        for sampler in found.samplers:
            (values,) = simplified(mechanism, algebra, sampler.function, [time, y, given])
            samples |= {index: value for index, (value,) in zip(sampler.components, values, strict=True)}
    except MbdSimError:
        return tuple(
            own.actuator_with(None, tuple(along), None, {}, traced.step)
            for own, along in zip(symbols, slopes, strict=True)
        )
    first = traced.layout.nq + traced.layout.nv
    by_index = {index + first: rate for index, (rate,) in enumerate(rates)}
    return tuple(
        own.actuator_with(law, tuple(along), by_index, samples, traced.step)
        for own, (law,), along in zip(symbols, efforts, slopes, strict=True)
    )


def state_and_inputs(
    traced: TracedMechanism,
    algebra: Algebra,
    inputs: Sequence[Sequence[Polynomial]],
    actuators: Sequence[_Symbols | SymbolicActuator],
) -> tuple[Sequence[Polynomial], list[Polynomial], list[Polynomial]]:
    """The polynomials of t, of the state y, and of the inputs; delayed commands are those in effect.

    :param inputs: the polynomials of t, q, u, the efforts, and the parameters, if there are any.
    """
    time, q, u, _, *parameters = inputs
    y: list[Polynomial] = [*q, *u, *({} for _ in range(traced.y.shape[0] - len(q) - len(u)))]
    given: list[Polynomial] = [{} for _ in range(traced.inputs.shape[0])]
    for own, slots in zip(actuators, traced.actuators.slots, strict=True):
        for channel, symbol in own.commands.items():
            if channel in slots.states:
                y[slots.states[channel]] = algebra.symbol(symbol)
            else:
                given[slots.commands[channel]] = algebra.symbol(symbol)
        for state, symbol in own.state_symbols.items():
            y[slots.states[state]] = algebra.symbol(symbol)
    if parameters:
        given[traced.input_layout.values] = parameters[0]
    return time, y, given


class _Symbols:
    """The symbols of an actuator."""

    def __init__(self, actuator: Actuator, slots: ActuatorSlots, names: dict[Any, str]) -> None:
        name = escaped(actuator.name)
        self.actuator, self.slots = actuator, slots
        self.effort = sp.Symbol(f"f_{actuator.name}", real=True)
        names[self.effort] = rf"f_{{\mathrm{{{name}}}}}"
        self.commands: dict[Channel, Any] = {}
        for channel in slots.commands:
            self.commands[channel] = sp.Symbol(f"w_{actuator.name}_{channel}", real=True)
            names[self.commands[channel]] = rf"w_{{\mathrm{{{name},{channel}}}}}"
        self.state_symbols: dict[str, Any] = {}
        for state in slots.states:
            if state in slots.energies or state in self.commands:
                continue
            self.state_symbols[state] = sp.Symbol(f"{LETTERS.get(state, 'x')}_{actuator.name}_{state}", real=True)
            further = "" if state in LETTERS else f",{escaped(state)}"
            names[self.state_symbols[state]] = rf"{LETTERS.get(state, 'x')}_{{\mathrm{{{name}{further}}}}}"

    def actuator_with(
        self, law: Any, along: tuple[Any, ...], rates: Mapping[int, Any] | None, samples: Mapping[int, Any], step: float
    ) -> SymbolicActuator:
        """The actuator with its law, and the rates and samples of states by their indices in y, if these are short."""
        states = []
        for name, symbol in self.state_symbols.items() if rates is not None else ():
            index = self.slots.states[name]
            sampled = samples.get(index)
            rate = rates[index] if rates is not None and sampled is None else None
            states.append(SymbolicActuatorState(name, symbol, rate, sampled, self.slots.every * step))
        own = self.actuator
        return SymbolicActuator(
            own.name, self.effort, along, law, tuple(states), self.commands, own.delay, own.port.rotation
        )
