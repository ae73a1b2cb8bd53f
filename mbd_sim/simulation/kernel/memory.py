"""The arrays of one running simulation, which its compiled kernel reads and writes in place."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.model import Model

if TYPE_CHECKING:
    from mbd_sim.compiler.python.bound_call import CompiledFunction
    from mbd_sim.simulation.contact.stepper import OneSidedStepper

Result = TypeVar("Result")


class KernelMemory:
    """State, inputs and step counter of a simulation, and the `history` of methods that use earlier steps.

    Compiled code keeps the addresses of these arrays. They are written in place and never replaced. A history follows
    the inputs in memory.
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
            return self.stepper.advance(*arrays, self.step_size, n, self._error_estimate)
        if self._step is None:
            self._step = self.compiled_step(lambda n: False)
        return self._step(n) is None

    def compiled_step(self, fallback: Callable[..., Result]) -> Callable[..., Result | None]:
        """`step(n=1)` as compiled code, which returns None; it returns `fallback` of its arguments if a step fails."""
        arrays = (self._counter, self._step_size, self.y, self.inputs, self._error_estimate)
        return self._kernel.stepper(fallback, [array.ctypes.data for array in arrays], arrays)

    @property
    def contact_count(self) -> int:
        """The number of changes of contacts since the arrays were allocated."""
        return 0 if self.stepper is None else self.stepper.count

    def find_modes(self) -> None:
        """Determine the modes of one-sided rows, for a state that was set from outside.

        :raises EventError: contacts without a solution.
        """
        if self.stepper is not None:
            self.stepper.find_modes(*self.now)

    def restore(
        self, y: Array, inputs: Array, steps: int, error_estimate: float = 0.0, history: Array | None = None
    ) -> None:
        """Replace the state (n,), the inputs (m,), the step counter, the error estimate and the history.

        Without a history of this model's size, the method starts again.
        """
        self.y[:], self.inputs[:], self._counter[0], self._error_estimate[0] = y, inputs, steps, error_estimate
        self.history[:] = history if history is not None and len(history) == len(self.history) else 0.0


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
