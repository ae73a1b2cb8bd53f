"""The kinds of values in functions that are compiled from Python: numbers, arrays, records, and code elsewhere."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Protocol, TypeAlias, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from mbd_sim.compiler.ir.builder import DOUBLE, INT
from mbd_sim.compiler.ir.module import BOOL, VOID, Type

Number = TypeVar("Number", int, float)


class _Elements(Protocol[Number]):
    """What compiled functions do with an array, as that of NumPy that they are given when they run as Python."""

    @overload
    def __getitem__(self, index: int, /) -> Number: ...
    @overload
    def __getitem__(self, rest: slice, /) -> _Elements[Number]: ...
    def __setitem__(self, index: int, value: Number, /) -> None: ...


Array: TypeAlias = _Elements[float]
Integers: TypeAlias = _Elements[int]

TYPES: dict[str, Type] = {"float": DOUBLE, "int": INT, "bool": BOOL, "None": VOID}
_C_TYPES: dict[str, Any] = {"float": ctypes.c_double, "int": ctypes.c_int64, "bool": ctypes.c_bool, "None": None}
ELEMENTS = {"Array": "float", "Integers": "int"}


def zeros(n: int) -> Array:
    """An array of zeros."""
    return np.zeros(n)


def integers(n: int) -> Integers:
    """An array of zeros that are integers."""
    return np.zeros(n, dtype=np.int64)


@dataclass(frozen=True)
class External:
    """Machine code elsewhere, by the kinds of its result and of its arguments; called with its address first."""

    result: str
    arguments: tuple[str, ...]

    def __call__(self, address: int, *arguments: Any) -> int:
        """Call it; the result is an integer, if there is one."""
        function = prototype(self.result, self.arguments)(address)
        found: int = function(*(one.ctypes.data if isinstance(one, np.ndarray) else one for one in arguments))
        return found


def prototype(result: str, arguments: Sequence[str]) -> Any:
    """The type of a C function with these kinds of result and arguments."""
    returned = ctypes.c_int64 if result == "bool" else _C_TYPES[result]
    return ctypes.CFUNCTYPE(returned, *(_C_TYPES.get(kind, ctypes.c_void_p) for kind in arguments))


def address_of(function: Any) -> int:
    """The address of a C function."""
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def signature_of(function: Callable[..., Any]) -> tuple[str, list[str]]:
    """The kinds of the result and of the parameters of a function."""
    kinds = dict(function.__annotations__)
    return kinds.pop("return"), list(kinds.values())


def name_of(function: Callable[..., Any]) -> str:
    """The name of an emitted function."""
    return f"{function.__module__}.{function.__name__}"


def packed(record: Any) -> NDArray[np.int64]:
    """The fields of a record as compiled functions read them; what they point to lives as long as the record."""
    slots = np.zeros(len(fields(record)), dtype=np.int64)
    for slot, field in enumerate(fields(record)):
        value = getattr(record, field.name)
        if field.type == "float":
            slots.view(np.float64)[slot] = value
        elif is_dataclass(value):
            slots[slot] = packed(value).ctypes.data
        else:
            slots[slot] = value.ctypes.data if field.type in ELEMENTS else int(value)
    object.__setattr__(record, "_packed", slots)
    return slots
