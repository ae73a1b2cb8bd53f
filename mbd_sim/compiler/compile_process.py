"""LLVM in a process of its own: LLVM cannot be interrupted, and compiling a long mechanism takes a minute."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mbd_sim.compiler import object_code

REPORT_PERIOD = 5.0  # s

_log = logging.getLogger(__name__)


class CompileProcess:
    """A process that compiles a long module, from its construction on; see `object_code`. Progress is logged.

    It runs `object_code.py` as a program, without `site` and most of this package, so it starts soon.
    """

    def __init__(self, text: str, cpu: str, features: str, level: int) -> None:
        """Start compiling.

        :raises OSError: the process cannot be started.
        """
        _log.info("compiling %.1f MB of intermediate code", len(text) / 1e6)
        paths = [*filter(None, sys.path), str(Path(object_code.__file__).parents[2])]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
        command = [sys.executable, "-P", "-S", object_code.__file__, str(os.getpid()), cpu, features, str(level)]
        self._began = time.monotonic()
        with tempfile.TemporaryFile() as source:
            source.write(text.encode())
            source.seek(0)
            # In a session of its own: Ctrl-C in a terminal interrupts only this process, which then ends the other.
            self._child = subprocess.Popen(  # noqa: S603  (own arguments)
                command, stdin=source, stdout=subprocess.PIPE, env=environment, start_new_session=True
            )

    def code(self) -> bytes | None:
        """The object code, when the process has written all of it; None if it fails.

        An exception in the caller's thread, such as that of Ctrl-C, ends the process at once.
        """
        try:
            code = self._output()
        except BaseException:
            self.end()
            raise
        if self._child.returncode != 0:
            return None
        _log.info("compiled in %.0f s", time.monotonic() - self._began)
        return code

    def end(self) -> None:
        """End the process at once, if it still runs."""
        with self._child:
            self._child.kill()

    def _output(self) -> bytes:
        """All that the process writes; reports now and then that it still works."""
        while True:
            try:
                return self._child.communicate(timeout=REPORT_PERIOD)[0]
            except subprocess.TimeoutExpired:
                _log.info("still compiling: %.0f s", time.monotonic() - self._began)


def compile_apart(text: str, cpu: str, features: str, level: int) -> bytes | None:
    """The object code of a long module, see `CompileProcess`; None if the process fails or cannot be started."""
    try:
        return CompileProcess(text, cpu, features, level).code()
    except OSError:
        return None
