"""Intermediate code to object code, with LLVM."""

from __future__ import annotations

import functools

import llvmlite.binding as llvm

# Instructions contain the distances of constants, which are therefore operands of other instructions.
ADDRESSES = {"reloc": "pic", "codemodel": "small"}
# What LLVM does before it generates code, by the level of its code generator.
PASSES = {
    0: ("always_inliner", "sroa", "simplify_cfg"),
    1: ("always_inliner", "sroa", "new_gvn", "simplify_cfg", "dead_store_elimination"),
}
# In long code, arrays stay in memory and no store is dead; finding that out takes a time that grows with its square.
SKIPPED_IN_LONG_CODE = ("dead_store_elimination",)
# LLVM's code generator compares each load and store of a block with all that may change places with it. These limits
# save nine tenths of its time for 300 rods. No operation on floating-point numbers changes: results are the same.
LONG_CODE_OPTIONS = (
    "-combiner-store-merging=false",  # no search for stores to adjacent addresses
    "-combiner-tokenfactor-inline-limit=4",  # how many sets of such loads and stores become one set; instead of 2048
)


def compiler_options(level: int) -> tuple[str, ...]:
    """All of these options at a level of optimization, of short and of long code; part of the cache key."""
    long = *(f"long: no {name}" for name in SKIPPED_IN_LONG_CODE), *LONG_CODE_OPTIONS
    return *ADDRESSES.values(), *PASSES[level], f"O{level}", *long


@functools.cache
def _prepare() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()


def target_machine(cpu: str, features: str, level: int) -> llvm.TargetMachine:
    """LLVM's target for a processor of this machine's kind, with a level of optimization of its code generator."""
    _prepare()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(opt=level, cpu=cpu, features=features, **ADDRESSES)


def prepare_for_long_code() -> None:
    """Set `LONG_CODE_OPTIONS`, which hold for all that LLVM compiles in this process from now on."""
    for option in LONG_CODE_OPTIONS:
        llvm.set_option("mbd_sim", option)


def object_code(text: str, cpu: str, features: str, level: int, *, is_long: bool = False) -> bytes:
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
        if is_long and name in SKIPPED_IN_LONG_CODE:
            continue
        getattr(passes, f"add_{name}_pass")()
    passes.run(parsed, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    return bytes(machine.emit_object(parsed))
