"""A system of differential equations compiled: stepping, and the functions that read its state."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import llvmlite.ir as ir

from mbd_sim.compiler.jit import MachineCode, compile_module, new_module
from mbd_sim.compiler.lower import instruction_count, lower
from mbd_sim.compiler.runge_kutta import System, emit_advance
from mbd_sim.compiler.types import POINTER
from mbd_sim.integrators.tableau import Tableau

INLINED = 2500  # instructions of all stages together up to which the rates are inlined into the loop

_ADDRESS, _INT, _DOUBLE = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double


@dataclass(frozen=True, eq=False)
class Kernel:
    """`advance(y, inputs, first_step, h, steps)` returns 1, or 0 where the state would not stay finite.

    `readers` take addresses of doubles: those of their inputs, then that of their output. None of them holds the
    interpreter's lock. `instructions` counts the scalar instructions of one evaluation of the rates.
    """

    advance: Callable[..., int]
    readers: Mapping[str, Callable[..., None]]
    instructions: int
    code: MachineCode


def compile_kernel(
    rates: ca.Function, settle: ca.Function | None, readers: Mapping[str, ca.Function], method: Tableau
) -> Kernel:
    """Compile y' = rates(t, y, inputs) with a method, and functions of one output each: see `System`."""
    module = new_module()
    instructions = instruction_count(rates)
    judging = rates.n_out() > 1
    system = System(
        size=rates.nnz_out(0),
        rates=lower(module, rates, inline=instructions * method.stages <= INLINED),
        settle=lower(module, settle, inline=not judging) if settle is not None else None,
        judging=judging,
    )
    emit_advance(module, system, method)
    for name, function in readers.items():
        _export(module, f"read_{name}", lower(module, function, inline=True))
    code = compile_module(module)
    return Kernel(
        advance=ctypes.CFUNCTYPE(_INT, _ADDRESS, _ADDRESS, _INT, _DOUBLE, _INT)(code.address("advance")),
        readers={name: _reader(code.address(f"read_{name}"), function) for name, function in readers.items()},
        instructions=instructions,
        code=code,
    )


def _export(module: ir.Module, name: str, function: ir.Function) -> None:
    exported = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER] * len(function.args)), name)
    builder = ir.IRBuilder(exported.append_basic_block("entry"))
    builder.call(function, exported.args)
    builder.ret_void()


def _reader(address: int, function: ca.Function) -> Any:
    return ctypes.CFUNCTYPE(None, *[_ADDRESS] * (function.n_in() + function.n_out()))(address)
