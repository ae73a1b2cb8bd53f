"""A program of the package beside a running `sim_node`, in a process of its own."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from test.system.forked_programs import ForkedProcess
from test.system.nodes import Listener, SimNodeProcess, new_domain
from test.waiting import PATIENCE


@dataclasses.dataclass
class Experiment:
    """A simulator, a program beside it, and a listener to both."""

    node: SimNodeProcess
    program: ForkedProcess | subprocess.Popen
    listener: Listener
    log: Path


@contextlib.contextmanager
def beside(
    folder: Path, parameters: dict[str, object], name: str, *arguments: str, keyboard: bool = False
) -> Iterator[Experiment]:
    """The module `mbd_sim.examples.NAME` and `sim_node` on a domain of their own, started together.

    A program that reads a `keyboard` is started by itself, with a pipe. Where the program has not ended by itself it is ended by SIGINT, which must succeed.
    """
    domain = new_domain()
    node = SimNodeProcess(domain, folder, parameters)
    log = folder / f"{name}.log"
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    words = ["--ros-args", *(word for argument in arguments for word in ("-p", argument))] if arguments else []
    program = _started(f"mbd_sim.examples.{name}", words, folder, environment, log, keyboard)
    listener = Listener(domain)
    listener.process = node
    try:
        listener.until(lambda: listener.states, "the first joint state")
        yield Experiment(node, program, listener, log)
        if program.poll() is None:
            program.send_signal(signal.SIGINT)
        assert program.wait(PATIENCE) == 0, log.read_text()
    finally:
        listener.close()
        for process in (program, node.process):
            if process.poll() is None:
                process.kill()
                process.wait()
        if keyboard:
            program.stdin.close()


def _started(
    module: str, words: list[str], folder: Path, environment: dict[str, str], log: Path, keyboard: bool
) -> ForkedProcess | subprocess.Popen:
    if not keyboard:
        return ForkedProcess(module, words, folder, environment, log)
    command = [sys.executable, "-u", "-m", module, *words]
    with log.open("wb") as stream:
        return subprocess.Popen(
            command, cwd=folder, env=environment, stdin=subprocess.PIPE, stdout=stream, stderr=subprocess.STDOUT
        )


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
