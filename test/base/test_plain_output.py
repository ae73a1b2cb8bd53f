"""Output where the terminal lacks characters: reports are readable, files keep theirs, and nothing ends a program."""

import io
import os
import subprocess
import sys

import pytest

from mbd_sim.base import plain_output
from mbd_sim.base.plain_output import plain, use_plain_characters

ENVIRONMENT = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def started(*arguments, **environment):
    program = [sys.executable, "-m", "mbd_sim", *map(str, arguments)]
    return subprocess.run(program, capture_output=True, env={**os.environ, **ENVIRONMENT, **environment}, check=False)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("5 N·m, 9.81 m/s², 30°", "5 N*m, 9.81 m/s^2, 30 deg"),
        ("λ₁ = −1 ± 2 × Σ ω", "lambda_1 = -1 +/- 2 x Sigma omega"),
        ("Ångström, Gödel, 中", "Angstrom, Godel, \\u4e2d"),
        ("√(a) ≤ ∞ … ½", "sqrt (a) <= inf ... 1/2"),
    ],
)
def test_characters_have_plain_forms(monkeypatch, text, expected):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict")
    monkeypatch.setattr(sys, "stdout", stream)
    use_plain_characters()
    print(text, end="", flush=True)
    assert stream.buffer.getvalue().decode("ascii") == expected


def test_every_character_of_the_package_has_a_plain_form():
    from pathlib import Path

    letters = set().union(
        *(path.read_text(encoding="utf-8") for path in Path(plain_output.__file__).parent.parent.rglob("*.py"))
    )
    unread = sorted(letter for letter in letters if not letter.isascii() and plain(letter).startswith("\\"))
    assert unread == []
    assert all(plain(letter).isascii() for letter in letters if not letter.isascii())


def test_a_path_that_is_not_utf8_is_printed_with_its_bytes(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors="strict")
    monkeypatch.setattr(sys, "stdout", stream)
    use_plain_characters()
    print(os.fsdecode(b"run\xff.mcap"), end="", flush=True)
    assert stream.buffer.getvalue() == b"run\xff.mcap"


@pytest.mark.parametrize(
    ("encoding", "command"),
    [
        ("", ("modes", "cart_pendulum")),
        ("cp437", ("check", "four_bar")),
    ],
)
def test_reports_in_a_terminal_without_utf8(command, encoding):
    ended = started(*command, **({"PYTHONIOENCODING": encoding} if encoding else {}))
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert encoding or ended.stdout.isascii()
    assert (b"eigenvalue 0 " if command[0] == "modes" else b"four_bar") in ended.stdout


def test_converted_files_stay_in_utf8(tmp_path):
    text = "mechanism: m\ndescription: größte Auslenkung 30°\nparts: {a: {mass: 1}}\n"
    text += "joints: {j: {type: free, between: [ground, a]}}\n"
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    ended = started("convert", tmp_path / "m.yaml")
    assert (ended.returncode, ended.stdout.decode("utf-8")) == (0, text)
