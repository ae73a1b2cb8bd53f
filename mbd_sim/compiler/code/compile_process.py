"""LLVM in a process of its own: it cannot be interrupted, and compiling a long mechanism takes seconds."""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO

REPORT_PERIOD = 5.0  # s
PROGRAM = Path(__file__).with_name("object_code.py")
_PACKAGES = str(Path(__file__).parents[3])  # the folder with this package

_log = logging.getLogger(__name__)


def compile_apart(text: str, cpu: str, features: str, level: int) -> bytes | None:
    """The object code of a long module, see `object_code`; None if the process fails or cannot be started.

    Progress is logged. An exception that is raised here, such as that of Ctrl-C, ends the process.
    """
    _log.info("compiling %.1f MB of intermediate code", len(text) / 1e6)
    began = time.monotonic()
    try:
        process = _started(cpu, features, str(level))
    except OSError:
        return None
    with process:
        try:
            code = _output(process, text, began)
        finally:
            process.kill()
    if process.returncode or not code:
        return None
    _log.info("compiled in %.0f s", time.monotonic() - began)
    return code


def _started(*arguments: str) -> subprocess.Popen[bytes]:
    """The program with these arguments, in the same interpreter with the modules of this process.

    It has a session of its own: Ctrl-C in a terminal does not interrupt it. Without `site` it starts sooner.
    """
    paths = [*(path for path in sys.path if isinstance(path, str) and path), _PACKAGES]
    return subprocess.Popen(  # noqa: S603  (own arguments)
        [sys.executable or "", "-P", "-S", str(PROGRAM), str(os.getpid()), *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        start_new_session=True,
    )


def _output(process: subprocess.Popen[bytes], text: str, began: float) -> bytes:
    """What the process writes until it ends."""
    # `communicate` that is called again after a timeout writes no more of its input.
    given, process.stdin = process.stdin, None
    threading.Thread(target=_write, args=(given, text), daemon=True).start()
    while True:
        try:
            return process.communicate(timeout=REPORT_PERIOD)[0]
        except subprocess.TimeoutExpired:
            _log.info("still compiling: %.0f s", time.monotonic() - began)


def _write(pipe: IO[bytes], text: str) -> None:
    with contextlib.suppress(BrokenPipeError), pipe:  # the process may have ended
        pipe.write(text.encode())
