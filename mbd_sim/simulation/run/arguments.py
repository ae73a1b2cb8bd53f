"""The arguments and attributes of a simulation or an ensemble: their types, checks and refusals.

The numbers that a caller gives are checked. The keyword arguments of `Simulation` and `Ensemble` are described by these
classes, also for the functions that pass them on. Assignments that a kernel would not see are refused, with the name of
the method that has the intended effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from operator import index
from typing import Any, ClassVar, TypedDict

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError, MechanismError, counted, nearest, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.python.bound_kernel import LARGEST
from mbd_sim.mechanism.mechanism import Mechanism


def step_size(given: float | None, default: float) -> float:
    """The step size in s: the given one, else the `default` of the mechanism.

    :raises ValueError: it is not positive and finite.
    """
    size = default if given is None else float(given)
    if not (math.isfinite(size) and size > 0.0):
        raise ValueError(f"the step must be a positive number of seconds, not {given!r}.")
    return size


def step_count(n: int) -> int:
    """A number of steps.

    :raises TypeError: `n` is not an integer.
    :raises ValueError: it is negative, or so large that time in steps would not be exact.
    """
    count = index(n)
    if not 0 <= count <= LARGEST:
        raise ValueError(f"the number of steps must lie between 0 and {LARGEST}, not {count}.")
    return count


def positive_count(value: object, name: str) -> int:
    """A number of something, of which there must be one or more.

    :param name: of the argument, for the error.
    :raises InputError: it is not a whole number, or less than 1.
    """
    count = value if isinstance(value, int | np.integer) and not isinstance(value, bool) else 0
    if count < 1:
        raise InputError(f"{name} must be a whole number of 1 or more, not {quoted(value)}")
    return int(count)


def rows_of(values: Sequence[float] | Array, shape: tuple[int, int], name: str) -> Array:
    """An array of a `shape` (k, n) from n values for all rows, or from all (k, n).

    :param name: of the values, for the error.
    :raises ValueError: they have another shape.
    """
    array = np.asarray(values, dtype=float)
    if array.shape not in (shape, shape[1:], (1, shape[1]), ()):
        remedy = f"Give {counted(shape[1], 'value')} for all members, or {shape}."
        raise ValueError(f"{name} has the shape {array.shape}. {remedy}")
    return np.broadcast_to(array, shape)


def member_numbers(members: Sequence[int] | NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """The indices (n,) of some of `count` members.

    :raises InputError: they are not whole numbers, for example a mask.
    :raises IndexError: there is no such member.
    """
    given = np.asarray(members)
    if given.size and given.dtype.kind not in "iu":
        remedy = "Give the indices of members; for a mask use np.flatnonzero(mask)."
        raise InputError(f"members are chosen by {quoted(members)}", remedy)
    return np.arange(count)[given.astype(np.intp)]


def step_at(time: float, size: float, steps: int = 0) -> int:
    """The number of the step nearest to a time in s.

    :param steps: the steps taken so far.
    :raises ValueError: the time is not finite, is before that step, or needs too many steps to count them.
    """
    if not math.isfinite(time):
        raise ValueError(f"cannot run until t = {time} s: the time must be finite.")
    if time / size > LARGEST:
        raise ValueError(f"cannot run until t = {time:g} s: the number of steps cannot be larger than {LARGEST}.")
    if (last := round(time / size)) < steps:
        raise InputError(
            f"cannot run until t = {time:g} s: the time is already {steps * size:g} s",
            "Give a later time, or call reset() first.",
        )
    return last


def steps_in(duration: float, size: float) -> int:
    """The number of steps of a size in s that a run for a duration in s takes: those up to the nearest to its end.

    :raises InputError: there is none, so that nothing would move.
    """
    if (steps := step_at(duration, size)) < 1:
        remedy = f"Give a time of {size:g} s or more, or a smaller step."
        raise InputError(f"a run of {duration:g} s has no step: one takes {size:g} s", remedy)
    return steps


Value = float | str | Sequence[float]  # of a key of a mechanism file: in SI units, or a text such as "30 deg"


class SimulationOptions(TypedDict, total=False):
    """The keyword arguments of `Simulation`."""

    method: str | None
    step: float | None
    wrenches: Sequence[str]
    live: Sequence[str]
    set: Mapping[str, Value]
    parameters: Mapping[str, Value]


class RecordingOptions(TypedDict, total=False):
    """The keyword arguments of `RunRecorder`."""

    rate: float | None
    reactions: bool
    contact_forces: bool
    violation: bool
    poses: Sequence[str]
    accelerations: Sequence[str]


class EnsembleOptions(TypedDict, total=False):
    """The keyword arguments of `Ensemble`."""

    method: str | None
    step: float | None
    threads: int | None
    progress: Callable[[float], None] | None


def changed_values(
    mechanism: Mechanism, values: Mapping[str, Value], parameters: Mapping[str, Value]
) -> dict[str, Value]:
    """Values by key with parameters by name.

    :raises MechanismError: the mechanism has no such parameter.
    :raises ValueError: a parameter is among the values, too.
    """
    for name in parameters:
        if name not in mechanism.parameters:
            message, remedy = f"there is no parameter '{name}'", nearest(name, mechanism.parameters)
            raise MechanismError([mechanism.source.problem(("parameters",), message, remedy)])
        if name in values or f"parameters.{name}" in values:
            raise InputError(f"the parameter '{name}' is given in `set` and in `parameters`", "Give it once.")
    return {**values, **{f"parameters.{name}": value for name, value in parameters.items()}}


class ReadOnlyView(np.ndarray[Any, np.dtype[np.float64]]):
    """A view of an array that cannot be written through; copies and results of operations are ordinary arrays."""

    def __setitem__(self, key: Any, value: Any) -> None:
        self._require_writable()
        super().__setitem__(key, value)

    def __array_ufunc__(self, ufunc: np.ufunc, method: Any, *inputs: Any, **options: Any) -> Any:
        if targets := options.get("out"):
            for target in targets:
                if isinstance(target, ReadOnlyView):
                    target._require_writable()
            options["out"] = tuple(map(_plain, targets))
        return getattr(ufunc, method)(*map(_plain, inputs), **options)

    def copy(self, order: Any = "C") -> Array:  # type: ignore[override]
        """A copy, which can be written."""
        return np.array(self, order=order)

    def __reduce__(self) -> Any:
        return self.copy().__reduce__()

    def _require_writable(self) -> None:
        if not self.flags.writeable:
            raise InputError(
                "this array is read-only: it shows numbers of a running simulation",
                "Call reset(q=…, u=…) to start from other coordinates or speeds, restore(…) to continue from a "
                "snapshot, set_efforts(…), set_wrench(…) or set_live(…) to change the inputs, or copy() to compute "
                "with the numbers.",
            )


def _plain(value: Any) -> Any:
    return value.view(np.ndarray) if isinstance(value, ReadOnlyView) else value


def read_only(array: Array) -> Array:
    """A view of an array that refuses to be written through."""
    view = array.view(ReadOnlyView)
    view.flags.writeable = False
    return view


class ReadOnlyAttributes:
    """Refuses to replace the attributes in `REMEDIES`, each with its remedy, after `_seal` has been called."""

    REMEDIES: ClassVar[Mapping[str, str]] = {}
    _sealed = False

    def _seal(self) -> None:
        self._sealed = True

    def __setattr__(self, name: str, value: object) -> None:
        if self._sealed and name in self.REMEDIES:
            raise AttributeError(f"'{name}' of a {type(self).__name__} cannot be assigned. {self.REMEDIES[name]}")
        super().__setattr__(name, value)
