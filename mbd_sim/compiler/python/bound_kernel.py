"""The machine code of a system of differential equations as Python functions: its steps, and functions of its state.

Functions with CPython's calling signature read the fields of NumPy's arrays. See
https://numpy.org/doc/stable/reference/c-api/types-and-structures.html for `PyArrayObject` and `PyArray_Descr`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.code.machine_code import MachineCode

LARGEST = 2**53  # steps; beyond, time in steps is no longer exact
MOVING = 1  # in the reserved cell of a `call`: the state is being moved
HEAD = object.__basicsize__  # bytes of the head of every object, `PyObject`
TYPE = HEAD - ctypes.sizeof(ctypes.c_void_p)  # offset of the address of its type
_FASTCALL_WITH_KEYWORDS = 0x0080 | 0x0002


class _MethodDefinition(ctypes.Structure):
    """CPython's `PyMethodDef`."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("method", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def function_of_addresses(address: int, count: int) -> Any:
    """The machine code at an address as a Python function of `count` addresses, without a result."""
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * count)(address)


def callable_of(
    address: int,
    partner: object,
    addresses: Sequence[int],
    keep_alive: object,
    signature: str,
    doc: str | None = None,
) -> Any:
    """The Python callable of machine code at an address, see `emit_call`, `CompiledFunction` and `bounded_writer`.

    :param partner: what the code calls, if anything: with the same arguments where a `call` cannot advance.
    :param addresses: what the code finds in the first entry of its `self`.
    :param keep_alive: an object that lives as long as the callable: it refers to the machine code and the arrays.
    :param signature: of the callable, as `inspect` and `help` show it: `step(n=1)`, with its docstring.
    """
    table = b"".join(value.to_bytes(8, "little") for value in addresses)
    name, text = signature.partition("(")[0].encode(), f"{signature}\n--\n\n{doc or ''}".encode()
    definition = _MethodDefinition(name, address, _FASTCALL_WITH_KEYWORDS, text)
    create = ctypes.pythonapi.PyCFunction_NewEx
    create.restype, create.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    return create(ctypes.addressof(definition), (table, partner, definition, keep_alive), None)


# Offsets of `PyArrayObject` and `PyArray_Descr` in bytes.
DATA, DIMENSIONS, LENGTHS, STRIDES, DTYPE, FLAGS = (HEAD + offset for offset in (0, 8, 16, 24, 40, 48))
BYTE_ORDER, TYPE_NUMBER = HEAD + 10, HEAD + 12

ALIGNED = 0x0100  # of the flags
NATIVE = ord("=")  # of the byte order
SINGLE, DOUBLE = 11, 12  # of the type number


Result = TypeVar("Result")

_ADDRESS, _INT, _DOUBLE = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
_ADVANCE = (_ADDRESS, _ADDRESS, _INT, _DOUBLE, _INT)
_WITH_INPUTS = 3  # arguments of a reader that takes t, y and the inputs


@dataclass(frozen=True, slots=True)
class KernelSignature:
    """What is known of a kernel besides its machine code: the number of arguments of each of its `readers`.

    `instructions` is the number of scalar instructions of one evaluation of the rates; `one_sided` says whether the
    system has one-sided rows.
    """

    readers: Mapping[str, int]
    instructions: int
    one_sided: bool = False


class OneSidedKernel:
    """`part_step` as in `emit_one_sided_advance` or `emit_time_stepping`, and `readings(t, y, inputs, out)`.

    See `mbd_sim.dynamics.one_sided_functions.OneSidedFunctions`.
    """

    def __init__(self, code: MachineCode) -> None:
        part_step = ctypes.CFUNCTYPE(_INT, _ADDRESS, _ADDRESS, _DOUBLE, _DOUBLE)(code.address("part_step"))
        self.part_step: Callable[..., int] = part_step
        self.readings: Callable[..., None] = function_of_addresses(code.address("read_contacts"), 4)
        self._code = code

    def project(self, y: int, inputs: int, time: float) -> int:
        """See `emit_time_stepping`."""
        found: int = ctypes.CFUNCTYPE(_INT, _ADDRESS, _ADDRESS, _DOUBLE)(self._code.address("project"))(y, inputs, time)
        return found


class Kernel:
    """The compiled functions of a system.

    `advance(y, inputs, first_step, h, steps)` returns 1, or 0 if the state would not stay finite; `estimating_advance`
    has a sixth argument, see `emit_advance`. Methods that use earlier steps keep a history behind the inputs, see
    `history_size`. `readers` take addresses of doubles: those of their inputs, then that of their output;
    `reads_inputs` says which of them take the inputs of the system. All of them release the interpreter's lock.
    `instructions` is the number of scalar instructions of one evaluation of the rates. `one_sided` are the functions of
    a system with one-sided rows.
    """

    __repr__ = short_repr

    def __init__(self, code: MachineCode, signature: KernelSignature) -> None:
        self.code, self.signature, self.instructions = code, signature, signature.instructions
        self.advance: Callable[..., int] = ctypes.CFUNCTYPE(_INT, *_ADVANCE)(code.address("advance"))
        estimating = ctypes.CFUNCTYPE(_INT, *_ADVANCE, _ADDRESS)(code.address("estimating_advance"))
        self.estimating_advance: Callable[..., int] = estimating
        self.readers: Mapping[str, Callable[..., None]] = {
            name: function_of_addresses(code.address(f"read_{name}"), count + 1)
            for name, count in signature.readers.items()
        }
        self.reads_inputs = {name: count >= _WITH_INPUTS for name, count in signature.readers.items()}
        self.one_sided = OneSidedKernel(code) if signature.one_sided else None

    def reader_address(self, name: str) -> int:
        """The address of the code of a reader."""
        return self.code.address(f"read_{name}")

    def stepper(
        self, fallback: Callable[..., Result], addresses: Sequence[int], keep_alive: object
    ) -> Callable[..., Result | None]:
        """`step(n=1)` as a Python callable with a cheap call: see `emit_call` and `callable_of`."""
        return cast(
            Callable[..., Result | None],
            callable_of(
                self.code.address("call"), fallback, addresses, (self, keep_alive), "step(n=1)", fallback.__doc__
            ),
        )
