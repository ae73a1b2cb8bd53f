"""Functions of a state, compiled apart from the kernel, which they therefore do not change."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import casadi as ca
import llvmlite.ir as ir
import numpy as np
from numpy.typing import NDArray

from mbd_sim.compiler.ir_types import POINTER
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.machine_code import compile_module, new_module


class CompiledReaders:
    """Compiled functions of (t, y, inputs) with one output each; they release the interpreter's lock."""

    def __init__(self, functions: Mapping[str, ca.Function]) -> None:
        """Compile functions, by name."""
        module = new_module()
        for name, function in functions.items():
            export(module, f"read_{name}", lower(module, function, inline=True))
        self._code = compile_module(module)
        self._functions = {
            name: reader(self._code.address(f"read_{name}"), function) for name, function in functions.items()
        }
        self._sizes = {name: function.nnz_out(0) for name, function in functions.items()}

    def read(self, name: str, time: float, y: NDArray[np.float64], inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """The output (n,) of a function, column by column."""
        moment, out = np.array([time]), np.empty(self._sizes[name])
        self._functions[name](moment.ctypes.data, y.ctypes.data, inputs.ctypes.data, out.ctypes.data)
        return out


def export(module: ir.Module, name: str, function: ir.Function) -> None:
    """Export a function of the module under a name."""
    exported = ir.Function(module, ir.FunctionType(ir.VoidType(), [POINTER] * len(function.args)), name)
    builder = ir.IRBuilder(exported.append_basic_block("entry"))
    builder.call(function, exported.args)
    builder.ret_void()


def reader(address: int, function: ca.Function) -> Any:
    """The compiled code of a function at an address as a Python callable, which takes addresses."""
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * (function.n_in() + function.n_out()))(address)
