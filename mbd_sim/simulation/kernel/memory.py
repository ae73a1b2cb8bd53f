"""The arrays of one running simulation, which its compiled kernel reads and writes in place."""

from __future__ import annotations

import math
from collections.abc import Callable
from threading import get_ident
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import CommandError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.python.bound_kernel import LARGEST, MOVING
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.model import Model

if TYPE_CHECKING:
    from mbd_sim.compiler.python.bound_call import CompiledFunction
    from mbd_sim.simulation.contact.stepper import OneSidedStepper

Result = TypeVar("Result")

STEPPING, LISTENED = 2, 4  # besides `MOVING`: in a call of `step`, and there is a listener
BUSY = MOVING | STEPPING
AT_ONCE = 20_000  # steps in one call of compiled code, which Ctrl-C does not interrupt
_TOGETHER = "Let one thread step the simulation and change it, or take a lock around each call."
_BETWEEN = "Note what was seen, and act on that when step() has returned; take fewer steps a call to act sooner."


class KernelMemory:
    """State, inputs and step counter of a simulation, and the `history` of methods that use earlier steps.

    Compiled code keeps the addresses of these arrays. They are written in place and never replaced. A history follows
    the inputs in memory. `reserved` (1,), of which `marks` is a view, holds the bits `MOVING`, `STEPPING` and
    `LISTENED`; while it is not 0, compiled code that users call leaves each call to Python. `owner` is the thread that
    is `STEPPING`.
    """

    def __init__(self, model: Model, step_size: float, mechanism: Mechanism | None = None) -> None:
        """Allocate the arrays: the start state of the `model`, its inputs without commands, and a step size in s.

        :param mechanism: a variant of that of the model with the same equations, see `one_sided_stepper`.
        """
        self._kernel, self._model = model.kernel, model
        self.stepper: OneSidedStepper | None = None
        if model.one_sided is not None:
            self.stepper = one_sided_stepper(model, mechanism or model.mechanism)
        self.y, size = model.start.copy(), len(model.inputs)
        memory = model.kernel_inputs()
        self.inputs, self.history = memory[:size], memory[size:]
        self._counter, self._step_size = np.zeros(1, dtype=np.int64), np.array([step_size])
        self._error_estimate = np.zeros(1)
        self.reserved, self._inner = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
        self.marks, self._moving, self.owner = self.reserved.data, self._inner.data, 0
        self._readers: dict[str, Callable[[], Array]] = {}
        self._accelerations: Callable[[], Array] | None = None
        self._step: Callable[..., bool | None] | None = None

    def read(self, name: str, *shape: int) -> Array:
        """The output of a reader of the kernel at the present state, row by row; in the thread that takes the steps."""
        try:
            return self._readers[name]()
        except KeyError:
            self._readers[name] = self.reader(name, math.prod(shape)).bound(self.clock, self.arguments(name), shape)
            return self._readers[name]()

    def reader(self, name: str, size: int) -> CompiledFunction:
        """A reader of the kernel, of which the output has some size."""
        from mbd_sim.compiler.python.bound_call import CompiledFunction

        return CompiledFunction(self._kernel.reader_address(name), self._kernel, size)

    def arguments(self, name: str) -> tuple[Array, ...]:
        """The arguments of a reader besides the time."""
        return (self.y, self.inputs) if self._kernel.reads_inputs[name] else (self.y,)

    def accelerations(self) -> Array:
        """u' (nv,) in the present state: see `Model.accelerations`."""
        if self._accelerations is not None:
            return self._accelerations()
        if self._model.one_sided is not None:
            return self._model.accelerations(*self.now)[: self._model.layout.nv]
        self._accelerations = self._model.bound_accelerations(self.clock, self.y, self.inputs)
        return self._accelerations()

    @property
    def steps(self) -> int:
        """Steps since time zero."""
        return int(self._counter.item())

    @property
    def time(self) -> float:
        """Simulated time in s: the number of steps times the step size, so that it cannot drift."""
        return self.steps * self.step_size

    @property
    def now(self) -> tuple[float, Array, Array]:
        """The time in s, the state and the inputs: arguments of the functions of a `Model`."""
        return self.time, self.y, self.inputs

    @property
    def clock(self) -> tuple[NDArray[np.int64], Array]:
        """The arrays of the step counter (1,) and of the step size (1,) in s."""
        return self._counter, self._step_size

    @property
    def step_size(self) -> float:
        """In s."""
        return float(self._step_size.item())

    @property
    def error_estimate(self) -> float:
        """The largest estimated error of a step since time zero: see `Simulation.error_estimate`."""
        return float(self._error_estimate.item())

    def advance(self, n: int) -> bool:
        """Advance by n steps; False where the new state would not be finite, and then nothing is changed.

        Only the error estimate is then that of all n steps. Ctrl-C, which Python notices between calls of compiled
        code, leaves state and step counter together, as this code counts its steps.
        """
        if self.stepper is not None:
            arrays = self.y, self.inputs, self.history, self._counter
            self._moving[0] = MOVING
            try:
                return self.stepper.advance(*arrays, self.step_size, n, self._error_estimate)
            finally:
                self._moving[0] = 0
        if self._step is None:
            self._step = self._compiled_step(lambda n: False, self._inner, LARGEST)
        return self._step(n) is None

    def compiled_step(self, fallback: Callable[..., Result]) -> Callable[..., Result | None]:
        """`step(n=1)` as compiled code, which returns None.

        It returns `fallback` of its arguments if a step fails, for more than `AT_ONCE` steps, and while `reserved`.
        """
        return self._compiled_step(fallback, self.reserved, AT_ONCE)

    def _compiled_step(
        self, fallback: Callable[..., Result], reserved: NDArray[np.int64], limit: int
    ) -> Callable[..., Result | None]:
        arrays = (self._counter, reserved, self._step_size, self.y, self.inputs, self._error_estimate)
        return self._kernel.stepper(fallback, [limit, *(array.ctypes.data for array in arrays)], arrays)

    def require_rest(self) -> None:
        """Refuse a change, or a copy of the state, while it is being moved.

        :raises CommandError: it is, in another thread or by the caller of an observer.
        """
        if self.marks[0] & MOVING or self._moving[0]:
            raise self.disturbed()

    def leave_to_python(self, listened: bool) -> None:
        """Say whether there is a listener, whom compiled code would not tell of steps and efforts."""
        self.marks[0] = (self.marks[0] & ~LISTENED) | (LISTENED if listened else 0)

    def disturbed(self) -> CommandError:
        """The error of a step or a change while steps are being taken."""
        return steps_under_way(self.owner if self.marks[0] & STEPPING else 0)

    @property
    def contact_count(self) -> int:
        """The number of changes of contacts since the arrays were allocated."""
        return 0 if self.stepper is None else self.stepper.count

    def find_modes(self) -> None:
        """Determine the modes of one-sided rows, for a state that was set from outside.

        :raises DivergedError: contacts without a solution, or with more points than slots.
        """
        if self.stepper is not None:
            marks, before = self.marks, self.marks[0]
            marks[0] |= BUSY
            try:
                self.owner = get_ident()
                self.stepper.find_modes(*self.now)
            finally:
                marks[0] = before

    def restore(
        self, y: Array, inputs: Array, steps: int, error_estimate: float = 0.0, history: Array | None = None
    ) -> None:
        """Replace the state (n,), the inputs (m,), the step counter, the error estimate and the history.

        Without a history of this model's size, the method starts again.
        """
        self.y[:], self.inputs[:], self._counter[0], self._error_estimate[0] = y, inputs, steps, error_estimate
        self.history[:] = history if history is not None and len(history) == len(self.history) else 0.0


def steps_under_way(owner: int) -> CommandError:
    """The error of a step or a change while a thread is taking steps: `owner`, or 0 for one that is not this one."""
    if owner == get_ident():
        return CommandError("an observer or listener asks for this while its simulation takes steps", _BETWEEN)
    return CommandError("another thread is taking steps of this simulation", _TOGETHER)


def one_sided_stepper(model: Model, mechanism: Mechanism) -> OneSidedStepper:
    """The stepper of a model with one-sided rows; contacts come to rest below the `rest_speed` of the mechanism."""
    from mbd_sim.dynamics.constraints.start import rheonomic
    from mbd_sim.simulation.contact.compiled_contacts import CompiledContacts
    from mbd_sim.simulation.contact.one_sided_model import guard_tolerance
    from mbd_sim.simulation.contact.stepper import OneSidedStepper

    assert model.one_sided is not None

    def energy(time: float, y: Array, inputs: Array) -> float:
        return model.energies(time, y, 0.0, inputs).total

    def moving_drives(time: float, y: Array, inputs: Array) -> list[str]:
        speeds = model.drives(time, y, inputs)[1].tolist()
        return [name for name, speed in zip(model.driven_names, speeds, strict=True) if speed]

    tolerance, driven = guard_tolerance(model.equations), rheonomic(mechanism)
    inputs, kept = len(model.inputs), model.method.inputs_in_history(len(model.start))
    contacts = CompiledContacts(
        model.one_sided,
        model.kernel,
        len(model.start),
        model.layout,
        model.loss_range.start,
        mechanism.rest_speed,
        tolerance,
        driven,
        sorted(model.between_steps.held) if model.between_steps is not None else (),
        (inputs, model.history_size, 0 if kept is None else inputs + kept),
        model.method.time_stepping,
    )
    arguments = (
        model.one_sided,
        contacts,
        energy,
        model.u_range,
        model.loss_range,
        mechanism.rest_speed,
        tolerance,
        driven,
        moving_drives,
    )
    if not model.method.time_stepping:
        return OneSidedStepper(*arguments)
    from mbd_sim.simulation.contact.time_stepping.stepper import TimeStepper

    return TimeStepper(model.equations, model.kernel, *arguments)
