"""A program of the package beside a running `sim_node`, in a process of its own."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from test.system.nodes import PATIENCE, Listener


@contextlib.contextmanager
def program(name: str, listener: Listener, folder: Path, arguments: Sequence[str] = ()) -> Iterator[subprocess.Popen]:
    """`mbd_sim.examples.NAME` on the listener's domain, its output in `folder`/NAME.log; ended by SIGINT."""
    domain = str(listener.context.get_domain_id())
    environment = os.environ | {"ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [sys.executable, "-u", "-m", f"mbd_sim.examples.{name}", *arguments]
    with (folder / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=subprocess.PIPE, stdout=log, stderr=subprocess.STDOUT
        )
    try:
        yield process
        if process.poll() is None:
            process.send_signal(subprocess.signal.SIGINT)
        assert process.wait(PATIENCE) == 0, (folder / f"{name}.log").read_text()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        process.stdin.close()


def lockstep(mechanism: str, rate: float) -> dict[str, object]:
    """Parameters with which the simulator waits for a command after each state: as fast as possible, and the same
    motion every time."""
    return {
        "mechanism": mechanism,
        "start_paused": True,
        "step_on_command": True,
        "step_count": round(1000 / rate),
        "publish_rate": rate,
    }
