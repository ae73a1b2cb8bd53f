"""Long modules, whose finished functions are compiled by processes while others are still being traced."""

from __future__ import annotations

from types import TracebackType

from mbd_sim import disk_cache
from mbd_sim.compiler import machine_code
from mbd_sim.compiler.compile_process import CompileProcess
from mbd_sim.compiler.host_module import compile_module
from mbd_sim.compiler.ir import Module
from mbd_sim.compiler.machine_code import MachineCode, code_key, host, linked
from mbd_sim.compiler.module_parts import ModuleParts, shares
from mbd_sim.compiler.object_code import object_code

SHARE = 0.25  # of `machine_code.LONG`: characters of a part
MOST_AT_ONCE = 4  # parts of the functions that are finished at the same time


class ConcurrentBuild:
    """The compilation of a module in parts, if it is long. As a context manager it ends the processes at its end."""

    def __init__(self, module: Module) -> None:
        self._module, self._parts = module, ModuleParts(module)
        self._compiled: list[_Part] = []

    def __enter__(self) -> ConcurrentBuild:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for part in self._compiled:
            part.end()

    def compile_finished(self) -> None:
        """Begin to compile the functions so far, if they are long; none of them may change from now on."""
        self._compile(least=0)

    def machine_code(self) -> MachineCode:
        """The code of the whole module, when all of it is compiled."""
        if not self._compiled:
            return compile_module(self._module)
        self._compile(least=1)
        return linked({part.key: part.code() for part in self._compiled})

    def _compile(self, least: int) -> None:
        """Begin to compile the functions that are in no part yet, in `least` parts if they are short."""
        sizes = self._parts.sizes()
        count = min(int(sum(sizes.values()) // (SHARE * machine_code.LONG)), MOST_AT_ONCE)
        if parts := max(count, least):
            for share in shares(sizes, parts):
                # One by one: an interrupt must not lose processes that run already.
                self._compiled.append(_Part(self._parts.take(share)))


class _Part:
    """A part that is in the cache, or is being compiled by a process."""

    def __init__(self, text: str) -> None:
        self.key, self._text = code_key(text), text
        self._stored, self._process = disk_cache.load(self.key), None
        if self._stored is None:
            self._process = _started(text)

    def code(self) -> bytes:
        """The object code."""
        if self._stored is not None:
            return self._stored
        code = None if self._process is None else self._process.code()
        if code is None:  # no process can be started, or it failed
            code = object_code(self._text, *host(), machine_code.LEVEL, is_long=True)
        disk_cache.store(self.key, code)
        return code

    def end(self) -> None:
        """End the process, if it still runs."""
        if self._process is not None:
            self._process.end()


def _started(text: str) -> CompileProcess | None:
    try:
        return CompileProcess(text, *host(), machine_code.LEVEL)
    except OSError:
        return None
