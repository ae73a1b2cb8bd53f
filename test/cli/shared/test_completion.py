"""Completion in bash, as `register-python-argcomplete mbd_sim` sets it up."""

import functools
import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import argcomplete
import pytest

from mbd_sim.cli.main import COMMANDS, main

BIN = Path(sys.executable).parent
SCRIPT = """
eval "$({bin}/register-python-argcomplete mbd_sim)"
COMP_LINE="$1"; COMP_POINT=${{#1}}; COMP_TYPE=9
read -ra COMP_WORDS <<< "$1"
[[ "$1" == *" " ]] && COMP_WORDS+=("")
COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 ))
_python_argcomplete mbd_sim "${{COMP_WORDS[COMP_CWORD]}}" "${{COMP_WORDS[COMP_CWORD-1]}}"
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def completions(line, folder):
    done = subprocess.run(
        [shutil.which("bash"), "-c", SCRIPT.format(bin=BIN), "bash", line],
        env=os.environ | {"PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}"},
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return {text.strip() for text in done.stdout.splitlines() if text.strip()}


def completions_here(line, monkeypatch):
    """What the program answers, in this process."""
    answer = io.StringIO()
    variables = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    for name, value in {**variables, "COMP_TYPE": "9", "_ARGCOMPLETE_SUPPRESS_SPACE": "1"}.items():
        monkeypatch.setenv(name, value)
    complete = functools.partial(argcomplete.CompletionFinder(), exit_method=sys.exit, output_stream=answer)
    monkeypatch.setattr(argcomplete, "autocomplete", complete)
    monkeypatch.setattr(argcomplete.CompletionFinder, "_init_debug_stream", lambda _: None)  # pytest's descriptor 9
    with pytest.raises(SystemExit):
        main()
    return {text.strip() for text in answer.getvalue().split("\n") if text.strip()}


def test_a_shell_completes(tmp_path):
    assert completions("mbd_sim re", tmp_path) == {"recover", "rerun-with"}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("mbd_sim ver", {"verify"}),
        ("mbd_sim kinematics four_bar --drive crank_pi", {"crank_pin=", "crank_pivot="}),
        ("mbd_sim run double_r", {"double_rod"}),
        ("mbd_sim check mine", {"mine.yaml"}),
        ("mbd_sim recover double_r", set()),
        ("mbd_sim run double_rod --method tsit", {"tsitouras8"}),
        ("mbd_sim kinematics four_bar --point coupler", {"coupler", "coupler.P", "coupler.tip"}),
        ("mbd_sim run four_bar --poses crank,ro", {"crank,rocker"}),
        ("mbd_sim check four_bar --set joints.crank_pin.po", {"joints.crank_pin.position="}),
        ("mbd_sim plot four_bar --coordinates rocker_p", {"rocker_pivot"}),
        ("mbd_sim run nowhere --start a", set()),
    ],
)
def test_commands_options_mechanisms_and_files_are_completed(line, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").touch()
    Path("my_runs").mkdir()
    assert completions_here(line, monkeypatch) == expected


def test_all_commands_are_offered(monkeypatch):
    assert set(COMMANDS) <= completions_here("mbd_sim ", monkeypatch)
