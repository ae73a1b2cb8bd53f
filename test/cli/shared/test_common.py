"""What commands show while they are at work."""

import io
import sys

import pytest

from mbd_sim.cli.shared import progress
from mbd_sim.cli.shared.common import text_table
from mbd_sim.cli.shared.progress import ProgressBar, Waiting
from test.waiting import wait_until


class Terminal(io.StringIO):
    def isatty(self):
        return True


def terminal(monkeypatch, patience=0.0):
    """Not a fixture: pytest sets its own standard output before a test begins."""
    monkeypatch.setattr(progress, "PATIENCE", patience)
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


def test_a_table_is_aligned_and_has_at_most_so_many_rows():
    assert [*text_table({"run": [0, 1, 2], "length": [0.5, 1 / 3, 2.0]}, 2)] == [
        "run    length",
        "  0       0.5",
        "  1  0.333333",
    ]
