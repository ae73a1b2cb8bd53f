"""Intermediate code to object code, with LLVM."""

from __future__ import annotations

import functools

import llvmlite.binding as llvm

# Instructions contain the distances of constants, which are therefore operands of other instructions.
ADDRESSES = {"reloc": "pic", "codemodel": "small"}
# What LLVM does before it generates code, by the level of its code generator; part of the cache key.
PASSES = {
    0: ("always_inliner", "sroa", "simplify_cfg"),
    1: ("always_inliner", "sroa", "new_gvn", "simplify_cfg", "dead_store_elimination"),
}


@functools.cache
def _prepare() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()


def target_machine(cpu: str, features: str, level: int) -> llvm.TargetMachine:
    """LLVM's target for a processor of this machine's kind, with a level of optimization of its code generator."""
    _prepare()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(opt=level, cpu=cpu, features=features, **ADDRESSES)


def object_code(text: str, cpu: str, features: str, level: int) -> bytes:
    """The object code of a module in LLVM's intermediate language, for a processor with its features.

    The instruction order is already good. LLVM's instruction combining makes values live longer and costs 20 % in
    spilled registers on long chains, and its full pipelines take three times as long. So only those passes run that the
    stepping loop needs: inlining, promotion of arrays to registers, value numbering, elimination of dead stores.
    """
    machine = target_machine(cpu, features, level)
    parsed = llvm.parse_assembly(text)
    parsed.verify()
    passes = llvm.create_new_module_pass_manager()
    for name in PASSES[level]:
        getattr(passes, f"add_{name}_pass")()
    passes.run(parsed, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    return bytes(machine.emit_object(parsed))
