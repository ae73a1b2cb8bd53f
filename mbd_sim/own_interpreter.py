"""Processes that run the same interpreter with the modules of this one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import IO

QUICK_START = "MBD_SIM_QUICK_START"  # the environment variable that says whether models start quickly
_PACKAGES = str(Path(__file__).parents[1])  # the folder with this package


def start_interpreter(
    *arguments: str, stdin: IO[bytes] | int, stdout: IO[bytes] | int, stderr: IO[bytes] | int | None = None
) -> subprocess.Popen[bytes]:
    """Start Python with arguments. It imports what this process can, and starts sooner, without `site`.

    It has a session of its own: Ctrl-C in a terminal does not interrupt it. What it builds does not start quickly, so
    that a program that takes the place of Python does not start itself again and again.

    :raises OSError: it cannot be started.
    """
    paths = [*(path for path in sys.path if isinstance(path, str) and path), _PACKAGES]
    return subprocess.Popen(  # noqa: S603  (own arguments)
        [sys.executable or "", "-P", "-S", *arguments],
        stdin=stdin,
        stdout=stdout,
        stderr=stderr,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), QUICK_START: "off"},
        start_new_session=True,
    )
