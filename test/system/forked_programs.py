"""Programs as processes of their own that are forked from a process in which the package is imported already.

A node takes half a second of a processor to import its libraries, and the tests start more than a hundred. The forked process
has its own session, folder, environment, output and signals, and runs the program's `main` with its arguments, as
`python -m` does; it finds modules on its own PYTHONPATH first. There is one such process for each library in LD_PRELOAD, which
the linker reads. Ctrl-C while importing is tested with programs that are started by themselves.

Forked programs compile at level 0, as most tests do, unless MBD_SIM_TEST_LEVEL is "user".
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import importlib
import inspect
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

ROOT = Path(__file__).parents[2]
PR_SET_PDEATHSIG = 1
PROGRAMS = ("mbd_sim.ros.node.sim_node", "mbd_sim.ros.replay.replay_node")
LATER = (  # what they import
    "mbd_sim.files.builders.mechanism",
    "mbd_sim.files.checks.validation",
    "mbd_sim.simulation.contact.readings",
    "mbd_sim.simulation.contact.stepper",
    "mbd_sim.simulation.model.builder",
    "mbd_sim.simulation.run.remarks",
    "rosidl_generator_py",
    "type_description_interfaces.msg",
)


class ForkedProcess:
    """A forked program, with those methods of `subprocess.Popen` that tests use."""

    def __init__(
        self, program: str, arguments: Sequence[str], folder: Path, environment: Mapping[str, str], log: Path
    ) -> None:
        log.touch()
        self._server = _server(environment.get("LD_PRELOAD", ""))
        self.pid: int = self._server.start([program, list(arguments), str(folder), dict(environment), str(log)])

    @property
    def returncode(self) -> int | None:
        """The exit code, or the negative number of the signal that ended it; None as long as it runs."""
        return self._server.ended.get(self.pid)

    def poll(self) -> int | None:
        self._server.read(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.returncode) is None:
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left < 0.0:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
            self._server.read(left)
        return code

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class _Server:
    """The process that forks programs, as seen from the tests; `ended` holds exit codes by process id."""

    def __init__(self, library: str) -> None:
        command, environment = [sys.executable, "-m", __name__], os.environ | {"LD_PRELOAD": library}
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        atexit.register(self._process.communicate)
        self.ended: dict[int, int] = {}
        self._started: list[int] = []
        self._unread = b""

    def start(self, request: list[Any]) -> int:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(request).encode() + b"\n")
        self._process.stdin.flush()
        while not self._started:
            self.read(None)
        return self._started.pop()

    def read(self, timeout: float | None) -> None:
        """Take what the server reports, waiting for it at most for some time in s."""
        assert self._process.stdout is not None
        if not select.select([self._process.stdout], [], [], timeout)[0]:
            return
        received = os.read(self._process.stdout.fileno(), 65536)
        assert received, "the process that forks programs has ended"
        *lines, self._unread = (self._unread + received).split(b"\n")
        for line in lines:
            pid, *code = map(int, line.split())
            if code:
                self.ended[pid] = code[0]
            else:
                self._started.append(pid)


@cache
def _server(library: str) -> _Server:
    return _Server(library)


def _report(*numbers: int) -> None:
    os.write(1, " ".join(map(str, numbers)).encode() + b"\n")


def _reap(*_: object) -> None:
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not pid:
            return
        _report(pid, os.waitstatus_to_exitcode(status))


def _become(program: str, arguments: Sequence[str], folder: str, environment: Mapping[str, str], log: str) -> int:
    """Run a program in this process, which has just been forked; returns its exit code."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # no node outlives tests that were killed
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a script runs the tests in the background
    os.setsid()
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.close(output)
    folders = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path and path not in sys.path]
    sys.path[1:1] = folders  # after the folder of the program, as the interpreter does at its start
    if os.environ.get("MBD_SIM_TEST_LEVEL") != "user":
        from mbd_sim.compiler.code import machine_code

        machine_code.LEVEL = 0
    module = importlib.import_module(program)
    sys.argv = [str(module.__file__), *arguments]
    return int(module.main())


def _prepare() -> None:
    """Import and compute what each node would: modules, their versions, the schema of files, the support of messages."""
    for module in (*PROGRAMS, *LATER):
        importlib.import_module(module)
    from mbd_sim.base import disk_cache
    from mbd_sim.files.load import load_mechanism

    disk_cache.versions()
    disk_cache.casadi_version()
    with mock.patch.dict(os.environ, {"MBD_SIM_CACHE": "off"}):
        load_mechanism("four_bar")
    for name, module in list(sys.modules.items()):
        if name.endswith((".msg", ".srv")):
            for kind in vars(module).values():
                getattr(kind, "__import_type_support__", lambda: None)()


def main() -> int:
    """Fork a program for each line on standard input; report its process id, and its exit code when it has ended."""
    _prepare()
    inspect.getmodule(sys._getframe())  # a node that logs would search the files of all modules first
    gc.collect()
    gc.freeze()
    signal.signal(signal.SIGCHLD, _reap)
    while line := os.read(0, 1 << 20):
        while not line.endswith(b"\n"):
            line += os.read(0, 1 << 20)
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
        pid = os.fork()
        if pid == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})
            return _become(*json.loads(line))
        _report(pid)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})
    return 0


if __name__ == "__main__":
    sys.exit(main())
