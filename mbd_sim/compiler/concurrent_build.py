"""Long modules, whose finished functions are compiled by processes while others are still being traced."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType

from mbd_sim import disk_cache
from mbd_sim.compiler import machine_code
from mbd_sim.compiler.compile_process import CodeInProgress, CompileProcesses
from mbd_sim.compiler.host_module import compile_module
from mbd_sim.compiler.ir import Module
from mbd_sim.compiler.machine_code import MachineCode, code_key, host, linked
from mbd_sim.compiler.module_order import ModuleOrder
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

    @property
    def has_started(self) -> bool:
        """Whether processes have been started earlier, and are ready to emit functions."""
        return self._processes.has_started

    def emit_apart(self, emit: Callable[[Module], object]) -> None:
        """Begin to compile functions that a process emits as well, to a module of their own.

        :param emit: adds them to the module, and can be pickled.
        """
        order = ModuleOrder(self._module.triple, self._module.level, emit)
        self._compiled.append(_OrderedPart(order, self._processes))

    def machine_code(self) -> MachineCode:
        """The code of the whole module, when all of it is compiled."""
        if not self._compiled:
            return compile_module(self._module)
        self._compile(least=1)
        self._processes.use_all_processors()
        return linked(dict([part.keyed_code() for part in self._compiled]))

    def _compile(self, least: int) -> None:
        """Begin to compile the functions that are in no part yet, in `least` parts if they are short."""
        sizes = self._parts.sizes()
        count = min(int(sum(sizes.values()) // (SHARE * machine_code.LONG)), MOST_AT_ONCE)
        if parts := max(count, least):
            for share in shares(sizes, parts):
                # One by one: an interrupt must not lose processes that run already.
                self._compiled.append(_WrittenPart(self._parts.take(share), self._module.level, self._processes))


class _Part(ABC):
    """A part that is in the cache, or is being compiled by a process."""

    _begun: CodeInProgress | None

    @abstractmethod
    def keyed_code(self) -> tuple[str, bytes]:
        """The object code and its key in the cache."""

    def close(self) -> None:
        """Close its files."""
        if self._begun is not None:
            self._begun.close()

    def _compiled(self, text: Callable[[], str], level: int) -> bytes:
        """The object code, compiled here if no process can be started, or if it failed."""
        code = None if self._begun is None else self._begun.code()
        return object_code(text(), *host(), level, is_long=True) if code is None else code


class _WrittenPart(_Part):
    """A part whose IR is written."""

    def __init__(self, text: str, level: int, processes: CompileProcesses) -> None:
        self._key, self._text, self._level = code_key(text, level), text, level
        self._stored = disk_cache.load(self._key)
        self._begun = processes.compile(text) if self._stored is None else None

    def keyed_code(self) -> tuple[str, bytes]:
        if self._stored is not None:
            return self._key, self._stored
        code = self._compiled(lambda: self._text, self._level)
        disk_cache.store(self._key, code)
        return self._key, code


class _OrderedPart(_Part):
    """A part whose IR the process writes. Its key is made from the object code, as nobody else knows the IR."""

    def __init__(self, order: ModuleOrder, processes: CompileProcesses) -> None:
        self._order = order
        self._begun = processes.emit(order)

    def keyed_code(self) -> tuple[str, bytes]:
        code = self._compiled(self._order.text, self._order.level)
        key = disk_cache.key("object code", code.hex())
        disk_cache.store(key, code)
        return key, code
