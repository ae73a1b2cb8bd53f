"""A program that compiles modules of long code, each in a process of its own, which it forks when LLVM is loaded.

Its standard input is a socket of the caller. Each message is one byte. `COMPILE` comes with two files, that of the
module's IR and that to which `DONE` is written when the object code has replaced the IR there. So does `EMIT`, with a
pickled `ModuleOrder` in place of the IR. `WAITING` says that the caller only waits from now on. Until then one
processor is left to it. The program ends, with all that it has started, when the caller closes the socket or ends.
"""

from __future__ import annotations

import importlib
import os
import pickle
import selectors
import signal
import socket
import sys
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from mbd_sim.compiler import object_code

COMPILE, EMIT, WAITING, DONE = b"c", b"e", b"w", b"d"
_FILES = 2  # that come with COMPILE and EMIT
EMITTERS = "mbd_sim.compiler.kernel"  # the functions that are ordered


class _Order(NamedTuple):
    """A message with its files."""

    message: bytes
    module: int  # descriptors
    done: int


class Server:
    """The modules that wait, in order, and the processes that compile."""

    def __init__(self, connection: socket.socket, compiled: Callable[[str], bytes]) -> None:
        self._connection, self._compiled = connection, compiled
        self._waiting: deque[_Order] = deque()
        self._running: dict[int, int] = {}  # processes, by a pipe that is closed when they end
        self._events = selectors.DefaultSelector()
        self._events.register(connection, selectors.EVENT_READ)
        self._processors = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
        self._most = max(1, self._processors - 1)

    def is_idle(self) -> bool:
        """Whether no message has come that waits."""
        return not self._events.select(timeout=0)

    def run(self) -> None:
        """Serve until the caller closes the connection."""
        try:
            while True:
                for event, _ in self._events.select():
                    if event.fileobj is not self._connection:
                        self._reap(event.fd)
                    elif not self._receive():
                        return
                while self._waiting and len(self._running) < self._most:
                    self._start(self._waiting.popleft())
        finally:
            for process in self._running.values():
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)

    def _receive(self) -> bool:
        """Take a message; False if the connection is closed."""
        message, files, _, _ = socket.recv_fds(self._connection, 1, _FILES)
        if message in (COMPILE, EMIT):
            self._waiting.append(_Order(message, *files))
        elif message == WAITING:
            self._most = self._processors
        return bool(message)

    def _reap(self, ended: int) -> None:
        self._events.unregister(ended)
        os.close(ended)
        os.waitpid(self._running.pop(ended), 0)

    def _start(self, order: _Order) -> None:
        """Compile a module in a new process; if none can be had, close its files, which tells the caller."""
        files = [order.module, order.done]
        try:
            files += os.pipe()
            process = os.fork()
        except OSError:
            for file in files:
                os.close(file)
            return
        if process == 0:
            status = 1
            try:
                self._compile(order)
                status = 0
            finally:
                os._exit(status)
        ended = files.pop(2)
        for file in files:
            os.close(file)
        self._running[ended] = process
        self._events.register(ended, selectors.EVENT_READ)

    def _compile(self, order: _Order) -> None:
        self._connection.close()
        for other in self._waiting:
            os.close(other.done)  # it must close when the process of that module ends, and not with this one
        with os.fdopen(order.module, "r+b") as file:
            file.seek(0)
            content = file.read()
            # What is executed comes from the caller, which has the rights of this process.
            text = pickle.loads(content).text() if order.message == EMIT else content.decode()  # noqa: S301
            code = self._compiled(text)
            file.seek(0)
            file.truncate()
            file.write(code)
        os.write(order.done, DONE)


def _compiled(text: str, cpu: str, features: str, level: int) -> bytes:
    """The object code of a module, in a process that compiles nothing else."""
    object_code.select_in_blocks(text, level)
    return object_code.object_code(text, cpu, features, level, is_long=True)


def main() -> None:
    """The program; its arguments are the processor, its features, and the level of the code generator."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the caller
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # nobody waits for the code any more
    cpu, features, level = sys.argv[1], sys.argv[2], int(sys.argv[3])
    object_code.target_machine(cpu, features, level)  # LLVM is ready before the first fork, and so are the passes
    if level:
        importlib.import_module("mbd_sim.compiler.near_addresses")
    with socket.socket(fileno=0) as connection:
        server = Server(connection, lambda text: _compiled(text, cpu, features, level))
        if server.is_idle():
            importlib.import_module(EMITTERS)
        server.run()
    os._exit(0)  # without unloading LLVM


if __name__ == "__main__":
    main()
