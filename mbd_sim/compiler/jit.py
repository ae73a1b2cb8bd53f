"""IR to machine code, in memory, through llvmlite."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import llvmlite.binding as llvm
import llvmlite.ir as ir


@dataclass(frozen=True)
class MachineCode:
    """Compiled functions; they live as long as this object."""

    engine: Any

    def address(self, name: str) -> int:
        """Where a function starts."""
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
    """Optimise and compile.

    CasADi's instruction order is already good: LLVM's instruction combining makes values live longer and costs 20 %
    in spilled registers on long chains, and its full pipelines take three times as long. So only what the stepping
    loop needs is run: inlining, arrays into registers, value numbering, dead stores.
    """
    _prepare()
    parsed = llvm.parse_assembly(str(module))
    parsed.verify()
    machine = llvm.Target.from_default_triple().create_target_machine(
        opt=1,
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
    )
    passes = llvm.create_new_module_pass_manager()
    passes.add_always_inliner_pass()
    passes.add_sroa_pass()
    passes.add_new_gvn_pass()
    passes.add_simplify_cfg_pass()
    passes.add_dead_store_elimination_pass()
    passes.run(parsed, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    engine = llvm.create_mcjit_compiler(parsed, machine)
    engine.finalize_object()
    return MachineCode(engine)
