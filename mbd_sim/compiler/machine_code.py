"""IR to machine code in memory, with llvmlite."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import llvmlite.ir as ir

from mbd_sim.compiler import kernel_cache

PASSES = "always-inline sroa new-gvn simplify-cfg dse, O1"  # what `_compiled` does, as part of the cache key


@dataclass(frozen=True)
class MachineCode:
    """Compiled functions, which live as long as this object."""

    engine: Any

    def address(self, name: str) -> int:
        """The address of a function."""
        return int(self.engine.get_function_address(name))


@functools.cache
def _prepare() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()


def new_module() -> ir.Module:
    """An empty module for this machine."""
    module = ir.Module("mbd_sim")
    module.triple = llvm.get_default_triple()
    return module


def compile_module(module: ir.Module) -> MachineCode:
    """Optimize and compile, or load the object code if the same code was compiled before."""
    _prepare()
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    machine = llvm.Target.from_default_triple().create_target_machine(opt=1, cpu=cpu, features=features)
    text = str(module)
    name = kernel_cache.key(
        text, cpu, features, ".".join(map(str, llvm.llvm_version_info)), llvmlite.__version__, PASSES
    )
    code = kernel_cache.load(name)
    if code is None:
        code = _compiled(text, machine)
        kernel_cache.store(name, code)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return MachineCode(engine)


def _compiled(text: str, machine: llvm.TargetMachine) -> bytes:
    """The object code of a module.

    The instruction order is already good. LLVM's instruction combining makes values live longer and costs 20 % in
    spilled registers on long chains, and its full pipelines take three times as long. So only those passes run that the
    stepping loop needs: inlining, promotion of arrays to registers, value numbering, elimination of dead stores.
    """
    parsed = llvm.parse_assembly(text)
    parsed.verify()
    passes = llvm.create_new_module_pass_manager()
    passes.add_always_inliner_pass()
    passes.add_sroa_pass()
    passes.add_new_gvn_pass()
    passes.add_simplify_cfg_pass()
    passes.add_dead_store_elimination_pass()
    passes.run(parsed, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    return bytes(machine.emit_object(parsed))
