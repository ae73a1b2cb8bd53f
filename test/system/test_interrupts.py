"""Ctrl-C at any moment: programs end at once, quietly, and without a traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from test.system.forked_programs import ForkedProcess
from test.system.nodes import Listener, SimNodeProcess, new_domain
from test.waiting import PATIENCE, wait_until


def chain(joints: int) -> str:
    """A chain that takes LLVM some seconds, if there are many joints."""
    parts = [
        f"  l{k}: {{mass: 1.0, inertia: [0.01, 0.02, 0.03], points: {{tip: [0.1, 0.05, 0.02]}}}}" for k in range(joints)
    ]
    axes = ("[1, 0, 0]", "[0, 1, 0]", "[0, 0, 1]")
    ends = ["ground", *(f"l{k}.tip" for k in range(joints))]
    hinges = [f"  j{k}: {{type: revolute, between: [{ends[k]}, l{k}], axis: {axes[k % 3]}}}" for k in range(joints)]
    return "\n".join(["mechanism: chain", "parts:", *parts, "joints:", *hinges, ""])


@pytest.fixture
def long_chain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "kernels"))
    monkeypatch.setenv("MBD_SIM_TEST_LEVEL", "user")
    file = tmp_path / "chain.yaml"
    file.write_text(chain(30))
    return file


def interrupted(process: ForkedProcess | subprocess.Popen[bytes]) -> int:
    """The exit code after Ctrl-C."""
    process.send_signal(signal.SIGINT)
    return process.wait(PATIENCE)


def test_a_node_that_compiles_says_so_and_ends_at_once(tmp_path: Path, long_chain: Path) -> None:
    domain = new_domain()
    listener = Listener(domain)
    node = SimNodeProcess(domain, tmp_path, {"mechanism": str(long_chain)})
    listener.process = node
    try:
        listener.until(lambda: "compiling" in node.text, "the compiler")
        listener.until(lambda: any("compiling" in text for text in listener.events), "~/events")
        assert interrupted(node.process) == 0
        assert "Traceback" not in node.text
    finally:
        listener.close()
        node.kill()


def test_a_command_that_compiles_ends_after_the_present_unit(tmp_path: Path, long_chain: Path) -> None:
    command = [sys.executable, "-m", "mbd_sim", "run", str(long_chain), "--time", "1e6"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True) as process:
        stored = partial(os.listdir, tmp_path / "kernels")
        wait_until(lambda: (tmp_path / "kernels").exists() and len(stored()) > 1, "the file that was read, and a unit")
        assert interrupted(process) == 130
        assert process.stderr is not None and b"Traceback" not in process.stderr.read()


ENTRY = "import sys; from mbd_sim.programs import {0}; print('ready', flush=True); sys.exit({0}.{1}())"


@pytest.mark.parametrize(
    ("program", "expected", "delay"),
    [("node.ros.node.sim_node.main", 0, 0.32), ("command.cli.main.main", 130, 0.02)],
    ids=["node", "command"],
)
def test_an_interrupt_while_a_program_imports_prints_nothing(
    tmp_path: Path, program: str, expected: int, delay: float
) -> None:
    kind, _, path = program.partition(".")
    environment = os.environ | {"ROS_DOMAIN_ID": str(new_domain()), "MBD_SIM_CACHE": "off"}
    arguments = ["run", "stewart", "--time", "1e6", "--quiet"] if kind == "command" else []
    with subprocess.Popen(
        [sys.executable, "-c", ENTRY.format(kind, path), *arguments],
        cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        output = process.stdout.read()
        assert process.wait(PATIENCE) == expected, output
        assert b"Traceback" not in output


def ended(program: str) -> tuple[int, str, str]:
    """The exit code of a program, and what it prints to its output and to its errors."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


LATE_IMPORT = """
import signal, sys, types
from mbd_sim.programs import command

def main():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise ImportError("no module named datetime") from None  # as numpy's C extension does

sys.modules["mbd_sim.late"] = types.SimpleNamespace(main=main)
sys.exit(command.late.main())
"""


def test_an_interrupt_that_a_library_replaces_by_an_import_error_prints_nothing() -> None:
    assert ended(LATE_IMPORT) == (130, "", "")
    failing = LATE_IMPORT.replace("signal.raise_signal(signal.SIGINT)", "raise KeyboardInterrupt")
    code, _, errors = ended(failing)
    assert code == 1 and "ImportError: no module named datetime" in errors


LOST = """
import signal, sys, types
from mbd_sim.programs import command

class Interrupted:
    def __SX__(self):  # CasADi replaces exceptions of this method
        signal.raise_signal(signal.SIGINT)

def main():
    import casadi
    casadi.sin(Interrupted())
    print("went on")

sys.modules["mbd_sim.tracing"] = types.SimpleNamespace(main=main)
sys.exit(command.tracing.main())
"""


def test_an_interrupt_while_casadi_traces_ends_a_command_quietly() -> None:
    assert ended(LOST) == (130, "", "")


DESTROYED = """
import signal, sys, types
from mbd_sim.programs import command

class Object:
    def __del__(self):
        signal.raise_signal(signal.SIGTERM)  # Python reports exceptions of destructors, and drops them

def drop():
    made = Object()

def main():
    drop()
    print("goes on")
    for number in range(10):
        pass
    print("ends")

sys.modules["mbd_sim.dropping"] = types.SimpleNamespace(main=main)
sys.exit(command.dropping.main())
"""


def test_a_signal_within_a_destructor_ends_a_command_quietly() -> None:
    assert ended(DESTROYED) == (143, "", "")


AGAIN = """
import signal, sys, types
from mbd_sim.programs import {kind}

def main():
    try:
        signal.raise_signal(signal.SIGINT)
    finally:
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            print("finished")

sys.modules["mbd_sim.ending"] = types.SimpleNamespace(main=main)
code = {kind}.ending.main()
signal.raise_signal(signal.{late})
sys.exit(code)
"""


@pytest.mark.parametrize("late", ["SIGINT", "SIGTERM"])
def test_further_signals_while_and_after_a_program_ends_change_nothing_but_the_number(late: str) -> None:
    for kind, expected in (("node", 0), ("command", 128 + signal.Signals[late])):
        text = AGAIN.format(kind=kind, late=late)
        assert ended(text) == (expected, "finished\n", "")


AT_EXIT = """
import atexit, signal, sys, types
from mbd_sim.programs import node

class Late:
    def __del__(self, raise_signal=signal.raise_signal):
        raise_signal(15)  # when the interpreter clears the modules
        raise_signal(2)

late = Late()
sys.modules["mbd_sim.ending"] = types.SimpleNamespace(main=lambda: 0)
sys.exit(node.ending.main())
"""


def test_signals_at_the_end_of_the_interpreter_change_nothing() -> None:
    assert ended(AT_EXIT) == (0, "", "")


PROGRAMS = {
    "node": ("node.ros.node.sim_node.main", ["--ros-args", "-p", "record:=false", "--log-level", "ERROR"]),
    "replay": ("node.ros.replay.replay_node.main", ["--ros-args", "-p", "bag:=none.mcap"]),
    "run": ("command.cli.main.main", ["run", "double_rod", "--time", "5"]),
}


def handles(process: subprocess.Popen[bytes]) -> bool:
    """Whether the program has a handler of SIGTERM, which Python alone has not, or has ended."""
    try:
        masks = dict(line.split(":", 1) for line in Path(f"/proc/{process.pid}/status").read_text().splitlines())
    except OSError:
        return True
    return "SigCgt" not in masks or bool(int(masks["SigCgt"], 16) >> signal.SIGTERM - 1 & 1)


@pytest.mark.parametrize("program", PROGRAMS)
def test_signals_at_any_moment_end_programs_with_the_documented_exit_code_and_nothing_else(
    tmp_path: Path, program: str
) -> None:
    path, arguments = PROGRAMS[program]
    kind = path.partition(".")[0]
    entry = f"import sys; from mbd_sim.programs import {kind}; sys.exit({path}())"
    command = [sys.executable, "-c", entry, *arguments]
    environment = os.environ | {"ROS_DOMAIN_ID": str(new_domain())}
    span, finished = 1.2 if kind == "node" else 0.8, 1 if program == "replay" else 0
    moments = ((0, signal.SIGINT), (2, signal.SIGTERM))
    for number, sent in moments if program == "node" else moments[program == "run" :][:1]:
        with subprocess.Popen(
            command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as process:  # fmt: skip
            wait_until(partial(handles, process), "the handlers", meanwhile=lambda: time.sleep(0.001))
            time.sleep(span * number / 3)
            process.send_signal(sent)
            if number == 2:
                process.send_signal(sent)  # as a launch file may do
            assert process.stdout is not None
            output = process.stdout.read().decode()
            code = process.wait(PATIENCE)
        assert code in (finished, 0 if kind == "node" else 128 + sent), (number, output)
        assert "Traceback" not in output and "Exception ignored" not in output, (number, output)
