"""Intermediate code to object code, with LLVM: a function, and a program that compiles one long module.

The standard input of the program is the IR, its standard output the object code; its arguments are the processor, its
features, and the level of LLVM's code generator.
"""

from __future__ import annotations

import functools
import os
import signal
import sys
import threading
import time
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
# In long code, arrays stay in memory and no store is dead; finding that out takes a time that grows with its square.
SKIPPED_IN_LONG_CODE = ("dead_store_elimination",)
# LLVM's code generator compares each load and store of a block with all that may change places with it. These limits
# save nine tenths of its time for 300 rods. No operation on floating-point numbers changes: results are the same.
# Each option with its value for long code and LLVM's own, which holds for all other code.
LONG_CODE_OPTIONS = (
    ("-combiner-store-merging", "false", "true"),  # no search for stores to adjacent addresses
    ("-combiner-tokenfactor-inline-limit", "4", "2048"),  # how many sets of such loads and stores become one set
)
_COMPILING = threading.Lock()  # these options are variables of the whole process


def compiler_options(level: int) -> tuple[str, ...]:
    """All of these options at a level of optimization, of short and of long code; part of the cache key."""
    long = (
        *(f"long: no {name}" for name in SKIPPED_IN_LONG_CODE),
        *(f"{name}={value}" for name, value, _ in LONG_CODE_OPTIONS),
    )
    return *ADDRESSES.values(), *PASSES[level], f"O{level}", *long


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


@contextmanager
def _options(*, is_long: bool) -> Iterator[None]:
    """Compile with `LONG_CODE_OPTIONS` if the code is long, and with LLVM's own values if it is not."""
    with _COMPILING:
        if not is_long:
            yield
            return
        for name, value, _ in LONG_CODE_OPTIONS:
            llvm.set_option("mbd_sim", f"{name}={value}")
        try:
            yield
        finally:
            for name, _, default in LONG_CODE_OPTIONS:
                llvm.set_option("mbd_sim", f"{name}={default}")


def object_code(text: str, cpu: str, features: str, level: int, *, is_long: bool = False) -> bytes:
    """The object code of a module in LLVM's intermediate language, for a processor with its features.

    Where it `is_long`, LLVM searches less, so that its time does not grow with the square of the length. The results
    have the same bits.

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
    with _options(is_long=is_long):
        passes.run(parsed, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
        return bytes(machine.emit_object(parsed))


PERIOD = 0.5  # s between two looks at whether the caller still runs


def _end_with(caller: int) -> None:
    while os.getppid() == caller:
        time.sleep(PERIOD)
    os._exit(1)


def main() -> None:
    """The program."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the caller, which then ends this program
    _, caller, cpu, features, level = sys.argv
    threading.Thread(target=_end_with, args=(int(caller),), daemon=True).start()
    code = object_code(sys.stdin.buffer.read().decode(), cpu, features, int(level), is_long=True)
    sys.stdout.buffer.write(code)
    sys.stdout.buffer.flush()
    os._exit(0)  # without unloading LLVM


if __name__ == "__main__":
    main()
