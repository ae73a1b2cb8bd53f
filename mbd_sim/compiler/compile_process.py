"""LLVM in processes of its own: LLVM cannot be interrupted, and compiling a long mechanism takes a minute."""

from __future__ import annotations

import logging
import os
import pickle
import selectors
import signal
import socket
import subprocess
import tempfile
import time
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING

from mbd_sim.compiler.compile_server import COMPILE, DONE, EMIT, WAITING
from mbd_sim.own_interpreter import start_interpreter

if TYPE_CHECKING:
    from mbd_sim.compiler.module_order import ModuleOrder

REPORT_PERIOD = 5.0  # s
PROGRAM = Path(__file__).with_name("compile_server.py")
ENDING = 10.0  # s; it takes milliseconds

_log = logging.getLogger(__name__)


class CompileProcesses:
    """A `compile_server`, started when it is needed first. As a context manager it ends all of it at its end."""

    def __init__(self, cpu: str, features: str, level: int) -> None:
        """They compile for a processor with its features, with a level of optimization of LLVM's code generator."""
        self._arguments = cpu, features, str(level)
        self._server: subprocess.Popen[bytes] | None = None
        self._connection: socket.socket | None = None
        self._cannot_start = self._has_compiled = False

    def __enter__(self) -> CompileProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def start(self) -> None:
        """Begin to load LLVM, which takes 0.1 s of another processor; without that the first module does."""
        if self._server is not None or self._cannot_start:
            return
        try:
            self._connection, other = socket.socketpair()
            with other:
                # Ctrl-C interrupts only this process, which then ends the other.
                self._server = start_interpreter(
                    str(PROGRAM), *self._arguments, stdin=other.fileno(), stdout=subprocess.DEVNULL
                )
        except OSError:
            self._cannot_start = True

    @property
    def has_started(self) -> bool:
        """Whether the server has been started."""
        return self._server is not None

    def compile(self, text: str) -> CodeInProgress | None:
        """Begin to compile a module, after those before; None if no process, file or pipe can be had."""
        _log.info("compiling %.1f MB of intermediate code", len(text) / 1e6)
        return self._send(COMPILE, text.encode())

    def emit(self, order: ModuleOrder) -> CodeInProgress | None:
        """Begin to emit a module and to compile it, as `compile` does."""
        _log.info("compiling functions")
        return self._send(EMIT, pickle.dumps(order))

    def _send(self, message: bytes, content: bytes) -> CodeInProgress | None:
        self.start()
        if self._connection is None or self._cannot_start:
            return None
        with ExitStack() as on_failure:
            try:
                # Without a buffer: closing the file on a full disk would write it again, and fail again.
                module = on_failure.enter_context(tempfile.TemporaryFile(buffering=0))
                _write(module, content)
                reader, writer = os.pipe()
                on_failure.callback(os.close, reader)
                try:
                    socket.send_fds(self._connection, [message], [module.fileno(), writer])
                finally:
                    os.close(writer)
            except OSError:
                return None
            self._has_compiled = True
            on_failure.pop_all()
            return CodeInProgress(module, reader)

    def use_all_processors(self) -> None:
        """Say that this process only waits from now on."""
        if self._connection is not None:
            try:
                self._connection.send(WAITING)
            except OSError:
                return  # the server has failed; each `CodeInProgress` tells

    def end(self) -> None:
        """End all that still runs."""
        if self._connection is not None:
            with suppress(OSError):  # it has ended
                # Processes that the caller has forked since may hold the socket open.
                self._connection.shutdown(socket.SHUT_RDWR)
            self._connection.close()
        if self._server is None:
            return
        try:
            if not self._has_compiled:  # it may still be loading LLVM
                self._server.kill()
            self._server.wait(ENDING)
        except subprocess.TimeoutExpired:
            self._kill()
        except BaseException:
            self._kill()
            raise
        finally:
            self._server = None

    def _kill(self) -> None:
        """Kill the server with the processes that it has forked, unless an interrupted `wait` has seen its end."""
        if self._server is not None and self._server.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(self._server.pid, signal.SIGKILL)
            self._server.wait()


class CodeInProgress:
    """The object code of a module that is being compiled. Progress is logged."""

    def __init__(self, module: IO[bytes], done: int) -> None:
        """`module` is the file that the code replaces; `done` is a pipe, see `compile_server`."""
        self._module, self._done = module, done
        self._began = time.monotonic()

    def code(self) -> bytes | None:
        """The object code, when all of it is written; None if the process fails."""
        with selectors.DefaultSelector() as events:
            events.register(self._done, selectors.EVENT_READ)
            while not events.select(REPORT_PERIOD):
                _log.info("still compiling: %.0f s", time.monotonic() - self._began)
        if os.read(self._done, 1) != DONE:
            return None
        _log.info("compiled in %.0f s", time.monotonic() - self._began)
        self._module.seek(0)
        return self._module.read()

    def close(self) -> None:
        """Close the files; the code is not needed any more."""
        if not self._module.closed:
            self._module.close()
            os.close(self._done)


def _write(file: IO[bytes], content: bytes) -> None:
    """Write all to a file without a buffer, which may take a part at a time.

    :raises OSError: the disk is full, or the file too long.
    """
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) :]


def compile_apart(text: str, cpu: str, features: str, level: int) -> bytes | None:
    """The object code of a long module, see `CompileProcesses`; None if the process fails or cannot be started."""
    with CompileProcesses(cpu, features, level) as processes:
        if (begun := processes.compile(text)) is None:
            return None
        with closing(begun):
            return begun.code()
