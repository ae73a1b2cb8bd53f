"""The machine code of a system of differential equations as Python functions: its steps, and functions of its state."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar, cast

from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.code.machine_code import MachineCode
from mbd_sim.compiler.python.callable import callable_of, function_of_addresses

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
    """`advance_to_event` and `part_step` as in `emit_one_sided_advance`, and `readings(t, y, inputs, out)`.

    See `mbd_sim.dynamics.one_sided_functions.OneSidedFunctions`.
    """

    def __init__(self, code: MachineCode) -> None:
        advance_to_event = ctypes.CFUNCTYPE(_INT, *_ADVANCE, _ADDRESS)(code.address("advance_to_event"))
        self.advance_to_event: Callable[..., int] = advance_to_event
        part_step = ctypes.CFUNCTYPE(_INT, _ADDRESS, _ADDRESS, _DOUBLE, _DOUBLE)(code.address("part_step"))
        self.part_step: Callable[..., int] = part_step
        self.readings: Callable[..., None] = function_of_addresses(code.address("read_contacts"), 4)


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
