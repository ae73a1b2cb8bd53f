"""Modules of IR for this machine, and their machine code."""

from __future__ import annotations

import llvmlite.binding as llvm

from mbd_sim.compiler.code import machine_code
from mbd_sim.compiler.code.machine_code import MachineCode, compile_units
from mbd_sim.compiler.ir.builder import IRBuilder
from mbd_sim.compiler.ir.module import Module


def new_module() -> Module:
    """An empty module for this machine."""
    return Module(llvm.get_default_triple(), IRBuilder, is_fast=machine_code.LEVEL > 0)


def compile_module(module: Module) -> MachineCode:
    """Optimize and compile a module, or load the object code of those of its units that were compiled before."""
    return compile_units(module.units())
