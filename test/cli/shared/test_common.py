"""What commands show while they are at work."""

import io
import logging
import sys

import pytest

from mbd_sim.cli.main import main
from mbd_sim.cli.shared import command
from mbd_sim.cli.shared.command import ProgressBar, Waiting
from mbd_sim.cli.shared.common import text_table
from test.waiting import wait_until


class Terminal(io.StringIO):
    def isatty(self):
        return True


def terminal(monkeypatch, patience=0.0):
    """Not a fixture: pytest sets its own standard output before a test begins."""
    monkeypatch.setattr(command, "PATIENCE", patience)
    monkeypatch.setattr(sys, "stdout", Terminal())
    return sys.stdout


def test_a_long_command_shows_that_it_is_at_work_and_makes_room_for_a_bar(monkeypatch):
    terminal(monkeypatch)
    with Waiting("optimize", quiet=False) as waiting:
        wait_until(lambda: waiting._display is not None, "the line")
        assert [task.description for task in waiting._display.tasks] == ["optimize"]
        with ProgressBar("runs", quiet=False):
            assert waiting._display is None
    assert Waiting._active is None


def test_the_line_says_the_stage_and_returns_after_a_bar(monkeypatch):
    terminal(monkeypatch)

    def titles():
        return [task.description for task in waiting._display.tasks] if waiting._display else []

    with Waiting("bode", quiet=False) as waiting:
        Waiting.stage("read the mechanism")
        wait_until(lambda: titles() == ["bode: read the mechanism"], "the first stage")
        with ProgressBar("pendulum", quiet=False):
            assert titles() == []
        Waiting.stage("linearize")
        wait_until(lambda: titles() == ["bode: linearize"], "the stage after the bar")


@pytest.mark.parametrize(
    ("command", "stages"),
    [
        (
            "bode rod_pendulum",
            ["read the mechanism", "derive and compile the equations", "search the equilibrium", "linearize"],
        ),
        ("linearize rod_pendulum --at 0.1", ["read the mechanism", "derive and compile the equations", "linearize"]),
        ("fmu rod_pendulum --sources-only --out {}", ["read the mechanism", "derive the equations", "write the code"]),
    ],
)
def test_commands_that_compute_for_long_name_their_stages(monkeypatch, tmp_path, command, stages):
    named = []
    monkeypatch.setattr(Waiting, "stage", named.append)
    assert main(command.format(tmp_path / "pendulum.fmu").split()) == 0
    assert named == stages


@pytest.mark.parametrize("quiet", [True, False])
def test_nothing_is_shown_without_a_terminal_or_when_it_shall_be_quiet(monkeypatch, quiet):
    terminal(monkeypatch)
    if not quiet:
        monkeypatch.setattr(sys, "stdout", io.StringIO())
    with Waiting("optimize", quiet) as waiting:
        assert waiting._timer is None


def test_a_short_command_shows_nothing(monkeypatch):
    shown = terminal(monkeypatch, patience=1000.0)
    with Waiting("check", quiet=False) as waiting:
        timer = waiting._timer
    timer.join()
    assert waiting._display is None and shown.getvalue() == ""


@pytest.mark.parametrize("quiet", [True, False])
@pytest.mark.parametrize("seen", [True, False])
def test_what_the_compiler_says_of_long_work_is_a_note_once_and_on_no_terminal_too(monkeypatch, capsys, quiet, seen):
    if seen:
        terminal(monkeypatch)
    logger = logging.getLogger("mbd_sim.compiler.kernel")
    with Waiting("run", quiet) as waiting:
        if seen and not quiet:
            wait_until(lambda: waiting._display is not None, "the line")
        logger.info("compiling may take %d s", 30)
        logger.debug("no news")
        if seen and not quiet:
            wait_until(lambda: waiting._display is not None, "the line again")
    logger.info("compiling may take %d s", 40)
    assert capsys.readouterr().err == ("" if quiet else "note: compiling may take 30 s\n")
    assert not logger.handlers


def test_a_table_is_aligned_and_has_at_most_so_many_rows():
    assert [*text_table({"run": [0, 1, 2], "length": [0.5, 1 / 3, 2.0]}, 2)] == [
        "run    length",
        "  0       0.5",
        "  1  0.333333",
    ]
