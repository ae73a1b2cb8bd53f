"""`make bench` runs programs one after another, and keeps what they print."""

import importlib.util
import sys

import pytest

from benchmarks import everything
from benchmarks.everything import PROGRAMS, Program, file_of, run


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(everything, "FOLDER", tmp_path)
    return tmp_path


def test_every_program_exists():
    assert all(importlib.util.find_spec(program.module) for program in PROGRAMS.values())


def test_what_a_program_prints_is_shown_and_kept(capsys):
    assert run("python", Program("platform"), sys.executable, ("--terse",)) == ""
    printed = file_of("python").read_text(encoding="utf-8")
    assert len(printed.splitlines()) == 1 and printed in capsys.readouterr().out


def test_a_program_that_fails_or_hangs_is_named_and_nothing_is_kept(folder, monkeypatch):
    assert run("a", Program("platform.none"), sys.executable, ()) == "a: exit status 1"
    monkeypatch.setattr(everything, "LIMIT", 0.2)
    endless = ("-n", "1", "-r", "1", "while True: pass")
    assert run("b", Program("timeit"), sys.executable, endless) == "b: not finished after 0.2 s"
    assert not list(folder.iterdir())


def test_options_that_are_not_its_own_are_those_of_the_comparison(monkeypatch, capsys):
    called = []
    monkeypatch.setattr(everything, "run", lambda *arguments: called.append(arguments) or "it failed")
    monkeypatch.setattr(sys, "argv", ["everything", "--quick", "--only", "comparison", "commands", "--rounds", "5"])
    assert everything.main() == 1 and "it failed" in capsys.readouterr().err
    assert [(name, arguments) for name, _, _, arguments in called] == [("comparison", ("--quick", "--rounds", "5"))]
