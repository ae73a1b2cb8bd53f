"""IR to machine code in memory, with llvmlite."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import llvmlite
import llvmlite.binding as llvm

from mbd_sim import disk_cache
from mbd_sim.compiler.external_symbols import external_symbols
from mbd_sim.compiler.object_code import compiler_options, object_code, target_machine

# Of LLVM's code generator. At level 0, which also has loops and calls in place of unrolled and inlined code, small
# mechanisms compile in a tenth of the time, to slower code with the same results.
LEVEL = 1
LONG = 1_000_000  # characters of IR from which on a process of its own pays: it starts in 0.1 s, LLVM needs 1 s


class MachineCode:
    """Compiled functions, which live as long as this object; `keys` are those of their object code in the cache."""

    def __init__(self, library: llvm.ResourceTracker, linker: llvm.LLJIT, keys: tuple[str, ...]) -> None:
        self.keys, self._name = keys, library.name
        self._linker, self._in_use = linker, [library]

    def address(self, name: str) -> int:
        """The address of a function."""
        found = self._linker.lookup(self._name, name)
        self._in_use.append(found)  # without it, all functions of the library would be unloaded
        return int(found[name])


def compiler_identity(level: int | None = None) -> tuple[str, ...]:
    """What object code depends on besides the IR: the processor and its features, LLVM, and how it is used."""
    cpu, features = host()
    version = ".".join(map(str, llvm.llvm_version_info))
    return cpu, features, version, llvmlite.__version__, " ".join(compiler_options(LEVEL if level is None else level))


def code_key(text: str, level: int) -> str:
    """The key in the cache of the object code of IR at a level of LLVM's code generator."""
    return disk_cache.key(text, *compiler_identity(level))


def compile_text(text: str, level: int) -> MachineCode:
    """Optimize and compile IR, or load the object code if the same code was compiled before."""
    key = code_key(text, level)
    code = disk_cache.load(key)
    if code is None:
        code = _compiled(text, *host(), level)
        disk_cache.store(key, code)
    return linked({key: code})


def load_code(keys: Iterable[str]) -> MachineCode | None:
    """The machine code of the parts with these keys, if all of them are in the cache."""
    codes = {}
    for key in keys:
        if (code := disk_cache.load(key)) is None:
            return None
        codes[key] = code
    return linked(codes)


def host() -> tuple[str, str]:
    """The processor and its features, in the words of LLVM."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def linked(codes: Mapping[str, bytes]) -> MachineCode:
    """The machine code of object code, by its keys, whose parts may call each other's functions."""
    linker = llvm.create_lljit_compiler(target_machine(*host(), LEVEL), use_jit_link=True)
    builder = llvm.JITLibraryBuilder().add_current_process()
    for code in codes.values():
        builder.add_object_img(code)
    for name, address in external_symbols().items():
        builder.import_symbol(name, address)
    return MachineCode(builder.link(linker, next(iter(codes))), linker, tuple(codes))


def _compiled(text: str, cpu: str, features: str, level: int) -> bytes:
    is_long = len(text) >= LONG
    if is_long:
        from mbd_sim.compiler.compile_process import compile_apart

        if (code := compile_apart(text, cpu, features, level)) is not None:
            return code
    return object_code(text, cpu, features, level, is_long=is_long)
