"""`mbd_sim linearize`, `modes` and `bode`."""

import csv
import json
from pathlib import Path

import pytest

from mbd_sim.cli.main import main
from test.linear_analysis.columns import COLUMN


@pytest.fixture
def column(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "column.yaml").write_text(COLUMN, encoding="utf-8")


def test_the_matrices_as_text_and_as_json(column, capsys):
    arguments = [
        "linearize",
        "column.yaml",
        "--set",
        "P=0",
        "--input",
        "efforts.foot",
        "--output",
        "points.upper.top.acceleration.x",
    ]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "column at the equilibrium: foot = 0, knee = 0" in printed and "A (4 × 4)" in printed
    assert main([*arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["inputs"] == {"efforts.foot": "N·m"} and found["A"][2] == pytest.approx([-0.5, 1.0, 0.0, 0.0])
    assert main(["linearize", "column.yaml", "--at", "later"]) == 1
    assert "--at later: neither" in capsys.readouterr().err


def test_modes_and_a_root_locus(column, capsys):
    assert main(["modes", "column.yaml"]) == 0
    printed = capsys.readouterr().out
    assert "Mode 1   0.0745184 Hz, damping ratio 0" in printed and "    foot 1\n" in printed
    assert (
        main(["modes", "column.yaml", "--vary", "P=1:3:41", "--out", "locus.csv", "--plot", "locus.png", "--quiet"])
        == 0
    )
    assert "stability changes between P = 2.05 and 2.1" in capsys.readouterr().out
    with Path("locus.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 41 and float(rows[-1]["real_1_1_s"]) == pytest.approx(-0.478073, rel=1e-5)
    assert main(["modes", "column.yaml", "--plot", "locus.png"]) == 1
    assert main(["modes", "column.yaml", "--mode", "9", "--animate", "mode.gif"]) == 1
    assert "there are 2 modes" in capsys.readouterr().err


def test_a_frequency_response(column, capsys):
    arguments = ["bode", "column.yaml", "--input", "base.x", "--output", "points.upper.top.acceleration.x"]
    assert (
        main(
            [*arguments, "--set", "P=0", "--set", "c=0.1", "--out", "bode.csv", "--plot", "bode.svg", "--points", "50"]
        )
        == 0
    )
    assert "points.upper.top.acceleration.x / base.x: " in capsys.readouterr().out
    with Path("bode.csv").open(encoding="utf-8") as file:
        first = next(csv.DictReader(file))
    assert float(first["frequency_Hz"]) == pytest.approx(0.1)
    assert main([*arguments, "--from", "3", "--to", "2"]) == 1
