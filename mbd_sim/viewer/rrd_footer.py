"""The list of all chunks at the end of a file of Rerun, by which other programs find data without reading it all.

Rerun itself keeps this list in memory while it writes a file. The viewer's process writes files without it, so that its
memory hardly grows, and has it added at the end.
"""

from __future__ import annotations

import contextlib
import subprocess
from pathlib import Path

from mbd_sim.viewer import rerun_process

LARGEST = 50_000_000  # bytes of a file: the list is added in 0.5 s, with 2.6 bytes of memory for each of them
TIMEOUT = 10.0  # s


def add_footer(path: Path) -> None:
    """Rewrite a file with its list of chunks; files beyond `LARGEST`, or that cannot be rewritten, stay as they are."""
    rewritten = path.with_name(f".{path.name}.partial")
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        if path.stat().st_size <= LARGEST:
            command = [rerun_process.executable(), "rrd", "merge", str(path), "-o", str(rewritten)]
            subprocess.run(command, capture_output=True, check=True, timeout=TIMEOUT)  # noqa: S603  (own arguments)
            rewritten.replace(path)
    with contextlib.suppress(OSError):
        rewritten.unlink(missing_ok=True)
