"""`mbd_sim linearize`, `modes` and `bode`."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.cli.studies.linearize import without_round_off
from mbd_sim.studies.linear_analysis.plots import mode_shapes
from test.studies.linear_analysis.columns import COLUMN


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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--mode", "9", "--animate", "mode.gif"], "--mode 9: there are 2 modes"),
        (["--mode", "0", "--animate", "mode.gif"], "--mode 0: there are 2 modes"),
        (["--animate", "mode.txt"], "mode.txt: this file format is not supported"),
    ],
)
def test_a_mode_that_cannot_be_animated_is_refused_before_anything_is_written(column, words, message, capsys):
    assert main(["modes", "column.yaml", "--out", "modes.csv", *words]) == 1
    printed = capsys.readouterr()
    assert message in printed.err and printed.out == "" and not Path("modes.csv").exists()


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


def read_table(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_the_matrices_of_a_linearization_as_a_table(tmp_path, capsys):
    out = tmp_path / "matrices.csv"
    assert main(["linearize", "double_rod", "--out", str(out)]) == 0
    system = to_equilibrium_of("double_rod").state_space(None, None)
    rows = read_table(out)
    whole = np.block([[system.a, system.b], [system.c, system.d]])
    assert [row["row"] for row in rows] == [*(f"rate of {name}" for name in system.states), *system.outputs]
    assert np.array([[float(row[name]) for name in (*system.states, *system.inputs)] for row in rows]) == pytest.approx(
        whole, abs=1e-12
    )
    assert f"wrote {out}" in capsys.readouterr().out


def to_equilibrium_of(name):
    from mbd_sim.studies.linear_analysis.loci import to_equilibrium

    simulation = Simulation.from_file(name)
    to_equilibrium(simulation)
    return simulation


def test_the_modes_as_a_table(tmp_path):
    out = tmp_path / "modes.csv"
    assert main(["modes", "double_rod", "--out", str(out)]) == 0
    modes = [shape.mode for shape in mode_shapes(to_equilibrium_of("double_rod").linearize())]
    rows = read_table(out)
    assert [float(row["frequency_Hz"]) for row in rows] == pytest.approx([mode.frequency for mode in modes])
    names = Simulation.from_file("double_rod").coordinate_names
    assert max(float(row[f"{name}.amplitude"]) for row in rows for name in names) == pytest.approx(1.0)


def test_entries_of_round_off_are_printed_as_zero():
    found = without_round_off(np.array([[1e-17, 1.0, 2.0], [1e6, 1e-3, 0.5], [1e-16, 1e-16, 1e-16]]))
    assert found.tolist() == [[0.0, 1.0, 2.0], [1e6, 1e-3, 0.5], [1e-16, 1e-16, 1e-16]]


@pytest.mark.parametrize(
    ("spin", "where"),
    [
        (0, "the start itself"),
        (150, "the start, but at rest; for small motions about its motion, give --at start"),
    ],
)
def test_an_equilibrium_at_the_place_of_a_start_that_moves_is_not_called_the_start(tmp_path, capsys, spin, where):
    """A top that spins upright is stable; it was said that 'the start itself' is unstable."""
    file = tmp_path / "top.yaml"
    file.write_text(
        f"""mechanism: top
parts: {{top: {{mass: 0.5, shape: {{type: disc, radius: 0.1, at: [0, 0, 0.2]}}}}}}
joints: {{point: {{type: spherical, between: [ground, top], angular_velocity: [0, 0, {spin}]}}}}
"""
    )
    assert main(["modes", str(file)]) == 0
    assert f"unstable: motions grow with 6.794 1/s; {where}\n" in capsys.readouterr().out
    assert main(["modes", str(file), "--at", "start"]) == 0
    found = capsys.readouterr().out
    assert ("6.79446 1/s" in found) == (spin == 0) and ("damping ratio 0" in found) == (spin > 0)
