"""Long modules, whose finished functions are compiled by processes while others are still being traced."""

from __future__ import annotations

import math
from types import TracebackType

from mbd_sim import disk_cache
from mbd_sim.compiler import machine_code
from mbd_sim.compiler.compile_process import CompileProcesses
from mbd_sim.compiler.host_module import compile_module
from mbd_sim.compiler.ir import Module
from mbd_sim.compiler.machine_code import MachineCode, code_key, host, linked
from mbd_sim.compiler.module_parts import ModuleParts, shares
from mbd_sim.compiler.object_code import object_code

SHARE = 0.25  # of `machine_code.LONG`: characters of a part
MOST_AT_ONCE = 4  # parts of the functions that are finished at the same time
MANY_JOINTS = 25  # with which a kernel is likely to be compiled in parts


def is_likely_long(joints: int) -> bool:
    """Whether a kernel with so many joints is likely to be compiled in parts."""
    return joints >= MANY_JOINTS and math.isfinite(machine_code.LONG)


def compile_processes(level: int | None = None) -> CompileProcesses:
    """Those that compile for this machine, at a level of LLVM's code generator, by default `machine_code.LEVEL`."""
    return CompileProcesses(*host(), machine_code.LEVEL if level is None else level)


class ConcurrentBuild:
    """The compilation of a module in parts, if it is long. As a context manager it ends the processes at its end."""

    def __init__(self, module: Module, processes: CompileProcesses | None = None) -> None:
        """`processes` that have been started earlier, which it ends as well."""
        self._module, self._parts = module, ModuleParts(module)
        self._processes = processes or compile_processes(module.level)
        self._compiled: list[_Part] = []

    def __enter__(self) -> ConcurrentBuild:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._processes.end()
        finally:
            for part in self._compiled:
                part.close()

    def compile_finished(self) -> None:
        """Begin to compile the functions so far, if they are long; none of them may change from now on."""
        self._compile(least=0)

    def machine_code(self) -> MachineCode:
        """The code of the whole module, when all of it is compiled."""
        if not self._compiled:
            return compile_module(self._module)
        self._compile(least=1)
        self._processes.use_all_processors()
        return linked({part.key: part.code() for part in self._compiled})

    def _compile(self, least: int) -> None:
        """Begin to compile the functions that are in no part yet, in `least` parts if they are short."""
        sizes = self._parts.sizes()
        count = min(int(sum(sizes.values()) // (SHARE * machine_code.LONG)), MOST_AT_ONCE)
        if parts := max(count, least):
            for share in shares(sizes, parts):
                # One by one: an interrupt must not lose processes that run already.
                self._compiled.append(_Part(self._parts.take(share), self._module.level, self._processes))


class _Part:
    """A part that is in the cache, or is being compiled by a process."""

    def __init__(self, text: str, level: int, processes: CompileProcesses) -> None:
        self.key, self._text, self._level = code_key(text, level), text, level
        self._stored = disk_cache.load(self.key)
        self._begun = processes.compile(text) if self._stored is None else None

    def code(self) -> bytes:
        """The object code."""
        if self._stored is not None:
            return self._stored
        code = None if self._begun is None else self._begun.code()
        if code is None:  # no process can be started, or it failed
            code = object_code(self._text, *host(), self._level, is_long=True)
        disk_cache.store(self.key, code)
        return code

    def close(self) -> None:
        """Close its files."""
        if self._begun is not None:
            self._begun.close()
