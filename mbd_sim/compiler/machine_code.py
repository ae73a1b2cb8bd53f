"""IR to machine code in memory, with llvmlite."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from mbd_sim import disk_cache
from mbd_sim.compiler.ir import Module
from mbd_sim.compiler.object_code import PASSES, object_code, target_machine

# Of LLVM's code generator. At level 0, which also has loops and calls in place of unrolled and inlined code, small
# mechanisms compile in a tenth of the time, to slower code with the same results.
LEVEL = 1
LONG = 1_000_000  # characters of IR from which on a process of its own pays: it starts in 0.1 s, LLVM needs 1 s


@dataclass(frozen=True)
class MachineCode:
    """Compiled functions, which live as long as this object."""

    engine: Any

    def address(self, name: str) -> int:
        """The address of a function."""
        return int(self.engine.get_function_address(name))


def new_module() -> Module:
    """An empty module for this machine."""
    return Module(llvm.get_default_triple(), fast=LEVEL > 0)


def compile_module(module: Module) -> MachineCode:
    """Optimize and compile, or load the object code if the same code was compiled before."""
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    text = str(module)
    compiler = ".".join(map(str, llvm.llvm_version_info)), llvmlite.__version__, f"{' '.join(PASSES[LEVEL])}, O{LEVEL}"
    name = disk_cache.key(text, cpu, features, *compiler)
    code = disk_cache.load(name)
    if code is None:
        code = _compiled(text, cpu, features)
        disk_cache.store(name, code)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target_machine(cpu, features, LEVEL))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return MachineCode(engine)


def _compiled(text: str, cpu: str, features: str) -> bytes:
    if len(text) >= LONG:
        from mbd_sim.compiler.compile_process import compile_apart

        if (code := compile_apart(text, cpu, features, LEVEL)) is not None:
            return code
    return object_code(text, cpu, features, LEVEL)
