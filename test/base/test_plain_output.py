"""Output where the terminal lacks characters: reports are readable, files keep theirs, and nothing ends a program."""

import io
import os
import subprocess
import sys
import warnings

import pytest

from mbd_sim.base import plain_output
from mbd_sim.base.plain_output import plain, use_plain_characters
from mbd_sim.cli.main import main

ENVIRONMENT = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.parametrize(
    ("text", "expected", "encoding"),
    [
        ("5 N·m, 9.81 m/s², 30°", "5 N*m, 9.81 m/s^2, 30 deg", "ascii"),
        ("5 N·m, λ ≤ 30°", "5 N·m, lambda ≤ 30°", "cp437"),
        ("λ₁ = −1 ± 2 × Σ ω", "lambda_1 = -1 +/- 2 x Sigma omega", "ascii"),
        ("Ångström, Gödel, 中", "Angstrom, Godel, \\u4e2d", "ascii"),
        ("√(a) ≤ ∞ … ½", "sqrt (a) <= inf ... 1/2", "ascii"),
    ],
)
def test_characters_have_plain_forms(monkeypatch, text, expected, encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict")
    monkeypatch.setattr(sys, "stdout", stream)
    use_plain_characters()
    print(text, end="", flush=True)
    assert stream.buffer.getvalue().decode(encoding) == expected


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


def test_reports_in_a_terminal_without_utf8():
    program = [sys.executable, "-m", "mbd_sim", "modes", "cart_pendulum"]
    ended = subprocess.run(program, capture_output=True, env={**os.environ, **ENVIRONMENT}, check=False)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert ended.stdout.isascii()
    assert b"eigenvalue 0 " in ended.stdout


def test_converted_files_stay_in_utf8(tmp_path, monkeypatch):
    text = "mechanism: m\ndescription: größte Auslenkung 30°\nparts: {a: {mass: 1}}\n"
    text += "joints: {j: {type: free, between: [ground, a]}}\n"
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict")
    monkeypatch.setattr(sys, "stdout", stream)
    assert main(["convert", str(tmp_path / "m.yaml")]) == 0
    stream.flush()
    assert stream.buffer.getvalue().decode("utf-8") == text


def test_warnings_of_this_package_are_sentences_and_others_keep_their_place(monkeypatch):
    """A cache that cannot be written was reported with a line of the source that calls the function of the warning."""
    usual = warnings.formatwarning
    monkeypatch.setattr(warnings, "formatwarning", usual)
    plain_output.use_plain_warnings()
    own, text = plain_output.__file__, "nothing can be stored"
    assert warnings.formatwarning(text, RuntimeWarning, own, 3) == "warning: nothing can be stored\n"
    for category, file in ((DeprecationWarning, own), (RuntimeWarning, "/usr/lib/numpy/core.py")):
        assert warnings.formatwarning(text, category, file, 3, "x") == usual(text, category, file, 3, "x")
