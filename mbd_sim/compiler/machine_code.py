"""IR to machine code in memory, with llvmlite."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from mbd_sim import disk_cache
from mbd_sim.compiler.object_code import PASSES, object_code, target_machine
from mbd_sim.compiler.python_callable import link_interpreter

# Of LLVM's code generator. At level 0, which also has loops and calls in place of unrolled and inlined code, small
# mechanisms compile in a tenth of the time, to slower code with the same results.
LEVEL = 1
LONG = 1_000_000  # characters of IR from which on a process of its own pays: it starts in 0.1 s, LLVM needs 1 s


@dataclass(frozen=True)
class MachineCode:
    """Compiled functions, which live as long as this object; `key` is that of their object code in the cache."""

    engine: Any
    key: str

    def address(self, name: str) -> int:
        """The address of a function."""
        return int(self.engine.get_function_address(name))


def compiler_identity() -> tuple[str, ...]:
    """What object code depends on besides the IR: the processor and its features, LLVM, and how it is used."""
    cpu, features = _host()
    version = ".".join(map(str, llvm.llvm_version_info))
    return cpu, features, version, llvmlite.__version__, f"{' '.join(PASSES[LEVEL])}, O{LEVEL}"


def compile_text(text: str) -> MachineCode:
    """Optimize and compile IR, or load the object code if the same code was compiled before."""
    key = disk_cache.key(text, *compiler_identity())
    code = disk_cache.load(key)
    if code is None:
        code = _compiled(text, *_host())
        disk_cache.store(key, code)
    return _in_memory(code, key)


def load_code(key: str) -> MachineCode | None:
    """The machine code of a key, if it is in the cache."""
    code = disk_cache.load(key)
    return None if code is None else _in_memory(code, key)


def _host() -> tuple[str, str]:
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _in_memory(code: bytes, key: str) -> MachineCode:
    link_interpreter()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target_machine(*_host(), LEVEL))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return MachineCode(engine, key)


def _compiled(text: str, cpu: str, features: str) -> bytes:
    if len(text) >= LONG:
        from mbd_sim.compiler.compile_process import compile_apart

        if (code := compile_apart(text, cpu, features, LEVEL)) is not None:
            return code
    return object_code(text, cpu, features, LEVEL)
