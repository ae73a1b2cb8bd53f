"""Ctrl-C at any moment: programs end at once, quietly, and without a traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
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
    monkeypatch.setenv("MBD_SIM_CACHE", "off")
    file = tmp_path / "chain.yaml"
    file.write_text(chain(40))
    return file


def children(pid: int) -> list[str]:
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            if path.read_text().rpartition(")")[2].split()[1] == str(pid):
                found.append(path.parent.name)
        except OSError:
            continue
    return found


def interrupted(process: ForkedProcess | subprocess.Popen[bytes]) -> int:
    """The exit code after Ctrl-C; the compiling process must end as well."""
    compilers = children(process.pid)
    process.send_signal(signal.SIGINT)
    code = process.wait(PATIENCE)
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in compilers), "the end of the compiler")
    return code


def test_a_node_that_compiles_says_so_and_ends_at_once(tmp_path: Path, long_chain: Path) -> None:
    domain = new_domain()
    listener = Listener(domain)
    node = SimNodeProcess(domain, tmp_path, {"mechanism": str(long_chain)})
    listener.process = node
    try:
        listener.until(lambda: "compiling" in node.text, "the compiler")
        listener.until(lambda: any("compiling" in text for text in listener.events), "~/events")
        wait_until(lambda: children(node.process.pid), "the compiler's process")
        assert interrupted(node.process) == 0
        assert "Traceback" not in node.text
    finally:
        listener.close()
        node.kill()


def test_a_command_that_compiles_ends_at_once(long_chain: Path) -> None:
    command = [sys.executable, "-m", "mbd_sim", "run", str(long_chain), "--time", "1e6"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True) as process:
        wait_until(lambda: children(process.pid), "the compiler's process")
        assert interrupted(process) == 130
        assert process.stderr is not None and b"Traceback" not in process.stderr.read()


ENTRY = "import sys; from mbd_sim.programs import {0}; print('ready', flush=True); sys.exit({0}.{1}())"


@pytest.mark.parametrize(
    ("program", "expected"), [("node.ros.sim_node.main", 0), ("command.cli.main.main", 130)], ids=["node", "command"]
)
def test_an_interrupt_while_a_program_imports_prints_nothing(tmp_path: Path, program: str, expected: int) -> None:
    kind, _, path = program.partition(".")
    environment = os.environ | {"ROS_DOMAIN_ID": str(new_domain()), "MBD_SIM_CACHE": "off"}
    arguments = ["run", "stewart", "--time", "1e6", "--quiet"] if kind == "command" else []
    for delay in (0.0, 0.3):
        with subprocess.Popen(
            [sys.executable, "-c", ENTRY.format(kind, path), *arguments],
            cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        ) as process:  # fmt: skip
            assert process.stdout is not None and process.stdout.readline() == b"ready\n"
            time.sleep(0.02 + delay)
            process.send_signal(signal.SIGINT)
            output = process.stdout.read()
            assert process.wait(PATIENCE) == expected, output
            assert b"Traceback" not in output


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
    done = subprocess.run([sys.executable, "-c", LATE_IMPORT], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
    failing = LATE_IMPORT.replace("signal.raise_signal(signal.SIGINT)", "raise KeyboardInterrupt")
    done = subprocess.run([sys.executable, "-c", failing], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "ImportError: no module named datetime" in done.stderr


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
    done = subprocess.run([sys.executable, "-c", LOST], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
