"""LLVM in a process of its own: LLVM cannot be interrupted, and compiling a long mechanism takes a minute."""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import subprocess
import sys
import tempfile
import time

from mbd_sim.compiler.object_code import object_code

REPORT_PERIOD = 5.0  # s
_PROGRAM = "from mbd_sim.compiler.compile_process import main; main()"
_PARENT_DEATH = 1  # PR_SET_PDEATHSIG of Linux

_log = logging.getLogger(__name__)


def compile_apart(text: str, cpu: str, features: str, level: int) -> bytes | None:
    """The object code of a long module, see `object_code`; None if the process fails.

    An exception in the caller's thread, such as that of Ctrl-C, ends the process at once. Progress is logged.
    """
    _log.info("compiling %.1f MB of intermediate code", len(text) / 1e6)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-P", "-c", _PROGRAM, str(os.getpid()), cpu, features, str(level)]
    began = time.monotonic()
    with tempfile.TemporaryFile() as source:
        source.write(text.encode())
        source.seek(0)
        try:
            # In a session of its own: Ctrl-C in a terminal interrupts only this process, which then ends the other.
            child = subprocess.Popen(  # noqa: S603  (own arguments)
                command, stdin=source, stdout=subprocess.PIPE, env=environment, start_new_session=True
            )
        except OSError:
            return None
    with child:
        try:
            code = _output(child, began)
        except BaseException:
            child.kill()
            raise
    if child.returncode != 0:
        return None
    _log.info("compiled in %.0f s", time.monotonic() - began)
    return code


def _output(child: subprocess.Popen[bytes], began: float) -> bytes:
    """All that the process writes; reports now and then that it still works."""
    while True:
        try:
            return child.communicate(timeout=REPORT_PERIOD)[0]
        except subprocess.TimeoutExpired:
            _log.info("still compiling: %.0f s", time.monotonic() - began)


def main() -> None:
    """The process: intermediate code on standard input, object code on standard output."""
    parent, cpu, features, level = sys.argv[1:]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PARENT_DEATH, signal.SIGKILL)
    if os.getppid() != int(parent):  # it ended before its death was asked for
        os._exit(1)
    text = sys.stdin.buffer.read().decode()
    code = object_code(text, cpu, features, int(level), is_long=True)
    try:
        sys.stdout.buffer.write(code)
        sys.stdout.buffer.flush()
    except BrokenPipeError:  # the caller was interrupted; another attempt to write at the exit would say so
        os._exit(1)
