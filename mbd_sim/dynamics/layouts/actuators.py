"""Where the states and commands of actuators are: the states between the speeds and the energies of the audit.

First come the states that others depend on and that have rates (`core`): currents, pressures, and integrals of
continuous servos. Then follow the energies of each actuator, the numbers that are `held` between samples, and the
`lines` of commands that wait for their delay. Held numbers and lines change only between steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, assert_never

from mbd_sim.base.errors import MechanismError, Problem, listed
from mbd_sim.dynamics.math.spatial import is_absent, is_finite, is_symbolic
from mbd_sim.mechanism.elements.joint_types import Channel
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.source import Location

if TYPE_CHECKING:
    from mbd_sim.mechanism.elements.actuators import Actuator, DcMotor, Machine

ENERGIES = ("electrical_work", "mechanical_work", "copper_loss", "friction_loss")  # J, of a DC motor
MECHANICAL = ("mechanical_work",)  # J, of an effort motor
# J, of a cylinder. `compression_work` is the integral of V p', from V (p - pₐ) at the start. The last one has the rate
# zero: it changes only where a run starts, or its state is set.
FLUID = ("fluid_work", "mechanical_work", "compression_work", "stored_at_start")
ROUNDING = 1e-9  # of a number of steps
LONGEST_DELAY = 1000  # steps


@dataclass(frozen=True)
class ActuatorSlots:
    """The states of an actuator by name and index in y, and its commands by channel and index among the inputs.

    `every` is the number of steps between two samples of its servo, and `delay` the number of steps by which commands
    are late. `lines` are the first indices of the waiting commands.
    """

    states: Mapping[str, int]
    commands: Mapping[Channel, int]
    every: int
    delay: int
    lines: Mapping[Channel, int]

    @property
    def energies(self) -> dict[str, int]:
        """The index of each of its energies."""
        return {name: self.states[name] for name in dict.fromkeys([*ENERGIES, *FLUID]) if name in self.states}

    @property
    def changes_between_steps(self) -> bool:
        """Whether it has states without rates, because it is sampled, delayed, or has a rate limit."""
        return bool(self.lines) or any(name in self.states for name in ("output", "reference"))


@dataclass(frozen=True)
class ActuatorLayout:
    """The slots of each actuator, and the ranges of their states in y, all of them in order after the speeds."""

    slots: tuple[ActuatorSlots, ...] = ()
    core: range = field(default_factory=lambda: range(0))
    energies: range = field(default_factory=lambda: range(0))
    held: range = field(default_factory=lambda: range(0))
    lines: range = field(default_factory=lambda: range(0))
    command_count: int = 0

    def core_names(self, actuators: Sequence[Actuator]) -> tuple[str, ...]:
        """The names `actuator.state` of the states with rates on which others depend, in their order."""
        names = {
            index: f"{actuator.name}.{state}"
            for actuator, slots in zip(actuators, self.slots, strict=True)
            for state, index in slots.states.items()
        }
        return tuple(names[index] for index in self.core)

    @property
    def size(self) -> int:
        """The number of states."""
        return len(self.core) + len(self.energies) + len(self.held) + len(self.lines)


def require_continuous(mechanism: Mechanism, layout: ActuatorLayout, what: str) -> None:
    """Refuse actuators with states that change only between steps.

    :param layout: of the actuators of the mechanism.
    :param what: that something is not possible, such as "cannot be linearized".
    :raises MechanismError: the actuators are named.
    """
    actuators = zip(mechanism.actuators, layout.slots, strict=True)
    if names := [actuator.name for actuator, slots in actuators if slots.changes_between_steps]:
        message = f"{mechanism.name} {what}, because actuators change only between steps: {listed(names)}"
        raise MechanismError([Problem(message, "Leave out 'sample_rate', 'delay' and 'rate_limit'.")])


def actuator_layout(mechanism: Mechanism, first_state: int, first_command: int, step: float) -> ActuatorLayout:
    """Assign states and commands.

    :param first_state: the index in y of the first state.
    :param first_command: the index among the inputs of the first command.
    :param step: in s.
    :raises MechanismError: a sample rate or a delay is not a whole number of steps; all of them are named.
    """
    actuators, problems = mechanism.actuators, list[Problem]()
    whole = [_whole_steps(mechanism, actuator, step, problems) for actuator in actuators]
    if problems:
        raise MechanismError(problems)
    next_state = first_state
    found: list[dict[str, int]] = [{} for _ in actuators]
    ranges = []
    kinds: tuple[Callable[[Actuator], Iterable[str]], ...] = (_core_states, _energy_states, _held_states)
    for names_of in kinds:
        start = next_state
        for actuator, states in zip(actuators, found, strict=True):
            for name in names_of(actuator):
                states[name], next_state = next_state, next_state + 1
        ranges.append(range(start, next_state))
    slots, start, next_command = [], next_state, first_command
    for actuator, states, (every, delay) in zip(actuators, found, whole, strict=True):
        commands = {channel: next_command + index for index, channel in enumerate(actuator.channels)}
        lines = {channel: next_state + delay * index for index, channel in enumerate(actuator.channels) if delay}
        next_command, next_state = next_command + len(commands), next_state + delay * len(lines)
        slots.append(ActuatorSlots(states, commands, every, delay, lines))
    core, energies, held = ranges
    return ActuatorLayout(tuple(slots), core, energies, held, range(start, next_state), next_command - first_command)


def _core_states(actuator: Actuator) -> Iterator[str]:
    from mbd_sim.mechanism.elements.actuators import PRESSURES, DcMotor, EffortMotor, FluidCylinder

    match actuator.motor:
        case DcMotor(inductance=inductance):
            yield from () if is_absent(inductance) else ("current",)
        case FluidCylinder():
            yield from PRESSURES
        case EffortMotor():
            pass
        case _:
            assert_never(actuator.motor)
    if actuator.servo is not None and actuator.servo.period is None and not is_absent(actuator.servo.ki):
        yield "integral"


def _energy_states(actuator: Actuator) -> Sequence[str]:
    return _energies(actuator.motor)


def _energies(motor: Machine) -> Sequence[str]:
    from mbd_sim.mechanism.elements.actuators import DcMotor, EffortMotor, FluidCylinder

    match motor:
        case FluidCylinder():
            return FLUID
        case EffortMotor():
            return MECHANICAL
        case DcMotor():
            return ENERGIES if has_losses(motor) else ENERGIES[:-1]
        case _:
            assert_never(motor)


def has_losses(motor: DcMotor) -> bool:
    """Whether a motor loses more than the heat of its winding: by friction, or in its gear."""
    exact = not is_symbolic(motor.efficiency) and motor.efficiency == 1.0
    return not (exact and is_absent(motor.coulomb) and is_absent(motor.viscous))


def _held_states(actuator: Actuator) -> Iterator[str]:
    servo = actuator.servo
    if actuator.delay:
        yield from actuator.channels
    if servo is None:
        return
    if is_finite(servo.rate_limit):
        yield "reference"
    if servo.period is not None:
        yield from () if is_absent(servo.ki) else ("integral",)
        yield from () if is_absent(servo.kd) or servo.controls == "position" else ("error",)
        yield "output"


def _whole_steps(mechanism: Mechanism, actuator: Actuator, step: float, problems: list[Problem]) -> tuple[int, int]:
    """The steps between samples, and those of the delay."""
    period = None if actuator.servo is None else actuator.servo.period
    every = 1 if period is None else round(period / step)
    if period is not None and not (every >= 1 and abs(every * step / period - 1.0) <= ROUNDING):
        near = sorted({max(1, int(period / step)), int(period / step) + 1})
        rates = " or ".join(f"{1.0 / (count * step):.12g} Hz" for count in near)
        message = f"the step of {step:g} s does not divide the sample period of {period:g} s"
        where = ("actuators", actuator.name, "servo", "sample_rate")
        problems.append(mechanism.source.problem(where, message, f"Give {rates}, or another step."))
    delay = round(actuator.delay / step)
    late: Location = ("actuators", actuator.name, "delay")
    if abs(delay * step - actuator.delay) > ROUNDING * max(actuator.delay, step):
        near = sorted({int(actuator.delay / step), int(actuator.delay / step) + 1})
        times = " or ".join(f"{count * step:.6g} s" for count in near)
        message = f"{actuator.delay:g} s is not a whole number of steps of {step:g} s"
        problems.append(mechanism.source.problem(late, message, f"Give {times}, or another step."))
    elif delay > LONGEST_DELAY:
        message = f"{actuator.delay:g} s are {delay} steps of {step:g} s, more than {LONGEST_DELAY}"
        problems.append(mechanism.source.problem(late, message, "Give a shorter delay, or longer steps."))
    return every, delay
