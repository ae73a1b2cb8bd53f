"""The programs of the page on controllers, as processes beside a real `sim_node` that they run in lockstep."""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from test.docs.notebooks import snippets
from test.system.growing_recordings import recorded_states
from test.system.nodes import Listener, SimNodeProcess, nanoseconds, new_domain
from test.waiting import PATIENCE

PAGE = Path(__file__).resolve().parents[2] / "docs/how_to/controller.md"


def commands(program):
    """The arguments of the commands of the page that start a program."""
    lines = [
        line
        for language, code in snippets(PAGE.read_text(encoding="utf-8"))
        if language == "sh"
        for line in code.splitlines()
    ]
    return [words[len(program) :] for words in map(shlex.split, lines) if words[: len(program)] == program]


@pytest.fixture
def programs(tmp_path):
    """The programs of the page, written to files, with the patience of the tests."""
    for language, code in snippets(PAGE.read_text(encoding="utf-8")):
        if language == "python":
            patient = code.replace("timeout_sec=10.0", f"timeout_sec={PATIENCE}")
            (tmp_path / re.match(r"# (\w+\.py)\n", code)[1]).write_text(patient, encoding="utf-8")
    return tmp_path


def test_the_controller_holds_the_cart_while_another_program_resets_the_simulator(programs):
    domain = new_domain()
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    _, lockstep = commands(["sim_node"])
    assert lockstep[0] == "--ros-args" and lockstep[1::2] == ["-p"] * (len(lockstep) // 2)
    parameters = dict(value.split(":=") for value in lockstep[2::2])
    node = SimNodeProcess(domain, programs, parameters | {"record": True, "record_dir": "logs"})
    listener = Listener(domain)
    listener.process = node
    log = programs / "hold.log"
    with log.open("wb") as stream:
        # The signal may keep rclpy from starting a callback that it has taken, of which Python then warns.
        words = [
            sys.executable,
            "-W",
            "ignore:coroutine:RuntimeWarning",
            "hold.py",
            *commands(["python", "hold.py"])[1],
        ]
        hold = subprocess.Popen(words, cwd=programs, env=environment, stdout=stream, stderr=subprocess.STDOUT)
    try:
        listener.until(lambda: listener.states, "the first state")
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) > 1.5e9, "1.5 s in lockstep")
        told = subprocess.run(
            [sys.executable, "experiment.py"], cwd=programs, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=True
        )  # fmt: skip
        assert re.findall(r"^(\w+) (\w+)", told.stdout, re.MULTILINE) == [
            ("pause", "True"), ("reset", "True"), ("step", "True"), ("pause", "True"),
        ]  # fmt: skip
        hold.send_signal(signal.SIGINT)
        assert hold.wait(PATIENCE) == 0
        assert log.read_text(encoding="utf-8") == ""
        assert node.end(signal.SIGINT) == 0
        assert "rejected" not in node.text
        late = [state for tick, state in recorded_states(programs / "logs").items() if 1000 < tick <= 1500]
        rail, pin = late[-1].names.index("rail"), late[-1].names.index("pin")
        assert max(abs(state.position[rail] - 0.4) for state in late) < 0.05
        assert max(abs(state.position[pin]) for state in late) > 0.1
    finally:
        listener.close()
        for process in (hold, node.process):
            if process.poll() is None:
                process.kill()
                process.wait()
