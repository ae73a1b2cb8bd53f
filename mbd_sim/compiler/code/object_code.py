"""Intermediate code to object code, with LLVM."""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import llvmlite.binding as llvm

# Instructions contain the distances of constants, which are therefore operands of other instructions.
ADDRESSES = {"reloc": "pic", "codemodel": "small"}
# What LLVM does before it generates code, by the level of its code generator. At level 0, which is for tests, passes
# would take a fifth of the compilation, and steps are as fast without them.
PASSES = {
    0: (),
    1: ("always_inliner", "sroa", "new_gvn", "simplify_cfg", "dead_store_elimination"),
}
# LLVM's code generator compares each load and store of a block with all that may change places with it. These limits
# save nine tenths of its time for 300 rods, and a quarter for contacts of robots, and steps are as fast. No operation
# on floating-point numbers changes.
# Each option with its value and LLVM's own, which other programs in this process may use.
OPTIONS = (
    ("-combiner-store-merging", "false", "true"),  # no search for stores to adjacent addresses
    ("-combiner-tokenfactor-inline-limit", "4", "2048"),  # how many sets of such loads and stores become one set
    ("-enable-misched", "false", "true"),  # no scheduling of machine instructions, which are in a good order
)
_COMPILING = threading.Lock()  # these options are variables of the whole process


def compiler_options(level: int) -> tuple[str, ...]:
    """All of these options at a level of optimization; part of the cache key."""
    return *ADDRESSES.values(), *PASSES[level], f"O{level}", *(f"{name}={value}" for name, value, _ in OPTIONS)


@functools.cache
def _prepare() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.initialize_native_asmparser()


def target_machine(cpu: str, features: str, level: int) -> llvm.TargetMachine:
    """LLVM's target for a processor of this machine's kind, with a level of optimization of its code generator."""
    _prepare()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(opt=level, cpu=cpu, features=features, **ADDRESSES)


@functools.cache
def _compiling_machine(cpu: str, features: str, level: int) -> llvm.TargetMachine:
    """The one that compiles all units, one after the other: with a new one, a small unit takes half as long again."""
    return target_machine(cpu, features, level)


@contextmanager
def _options() -> Iterator[None]:
    """Compile with the `OPTIONS`."""
    with _COMPILING:
        for name, value, _ in OPTIONS:
            llvm.set_option("mbd_sim", f"{name}={value}")
        try:
            yield
        finally:
            for name, _, default in OPTIONS:
                llvm.set_option("mbd_sim", f"{name}={default}")


def object_code(text: str, cpu: str, features: str, level: int) -> bytes:
    """The object code of a module in LLVM's intermediate language, for a processor with its features.

    The instruction order is already good. LLVM's instruction combining makes values live longer and costs 20 % in
    spilled registers on long chains, and its full pipelines take three times as long. So only those passes run that the
    stepping loop needs: inlining, promotion of arrays to registers, value numbering, elimination of dead stores.
    """
    parsed = llvm.parse_assembly(text)
    parsed.verify()
    passes = llvm.create_new_module_pass_manager()
    for name in PASSES[level]:
        getattr(passes, f"add_{name}_pass")()
    with _options():
        machine = _compiling_machine(cpu, features, level)
        passes.run(parsed, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
        return bytes(machine.emit_object(parsed))
