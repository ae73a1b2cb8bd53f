"""`mbd_sim optimize`: goals from arguments and tables, the mechanism as a file, and errors with remedies."""

from pathlib import Path

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.cli.main import main
from mbd_sim.studies.kinematic_analysis import driven_motion

DRIVE = ["--drive", "crank_pivot=20:340deg:5"]


def test_a_path_from_a_table(tmp_path, monkeypatch, capsys):
    """The path of the middle of a longer coupler, with its plane y = 0 left out."""
    monkeypatch.chdir(tmp_path)
    target = load_mechanism("four_bar")
    motion = driven_motion(target, {"crank_pivot": (np.radians(20), np.radians(340))}, 5)
    path = motion.point("coupler.tip").position
    rows = [f"{x!r},{z!r}" for x, z in path[:, [0, 2]].tolist()]
    Path("path.csv").write_text("\n".join(["x,z", *rows]), encoding="utf-8")
    text = target.source.text.replace("rocker: 1.2 m", "rocker: 1.1 m")
    Path("start.yaml").write_text(text, encoding="utf-8")
    vary = ["--vary", "rocker=0.9 m:1.5 m"]
    words = [
        "start.yaml",
        *DRIVE,
        *vary,
        "--path",
        "coupler.tip=path.csv",
        "--out",
        "found.yaml",
        "--plot",
        "found.png",
    ]
    assert main(["optimize", *words]) == 0
    out = capsys.readouterr().out
    assert "rocker              1.1 -> 1.2" in out
    found = load_mechanism("found.yaml")
    assert found.parameters["rocker"] == pytest.approx(1.2, abs=1e-10)
    again = driven_motion(found, {"crank_pivot": (np.radians(20), np.radians(340))}, 5)
    assert again.point("coupler.tip").position == pytest.approx(path, abs=1e-9)
    assert Path("found.png").stat().st_size > 20000


def test_a_function(capsys):
    function = ["--function", "rocker_pivot=1.7 + 0.2*sin(crank_pivot)", "--free-offset", "--vary", "rocker=0.9:1.5"]
    assert main(["optimize", "four_bar", *DRIVE, *function]) == 0
    out = capsys.readouterr().out
    assert "Offset" in out and "Deviation, rms" in out and "rad  (minimized)" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--vary", "rocker", "--least-effort"], "'rocker' gives no bounds. Write KEY=LOW:HIGH"),
        (["--vary", "nope=1:2", "--least-effort"], "nope: is not a key of this file"),
        (["--vary", "[2]=1:2", "--least-effort"], "[2]: is not a key of a mechanism file"),
        (["--vary", "rocker=1 m:2 kg", "--least-effort"], "'2 kg': the unit 'kg' does not fit"),
        (["--vary", "parameters.nope=1:2", "--least-effort"], "parameters.nope: there is no 'nope'"),
        (["--vary", "rocker=2:1", "--least-effort"], "the lower bound is not below"),
        (["--vary", "rocker=1:2", "--path", "coupler.tip=none.csv"], "none.csv cannot be read"),
        (["--vary", "rocker=1:2", "--path", "coupler.tip"], "is not a path. Write PART.POINT=FILE.csv"),
        (["--vary", "rocker=1:2", "--function", "rocker_pivot=1 + sin(crnk)"], "unknown name 'crnk'"),
        (["--vary", "rocker=1:2", "--least-effort", "--free-timing"], "--free-timing without a path"),
        (["--vary", "rocker=1:2", "--least-effort", "--out", "x.csv"], "is not a mechanism file"),
        (["--vary", "rocker=1:2", "--least-effort", "--seed", "1"], "--seed has no effect without --global"),
    ],
)
def test_wrong_arguments(words, message, capsys):
    assert main(["optimize", "four_bar", *DRIVE, *words]) == 1
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "the first line must name the columns. They are x, y, z, drive"),
        ("x,z\n1,2\n3\n", "t.csv:3: 1 numbers instead of 2"),
        ("x,z\n1,2\n3,k\n", "t.csv:3: 'k' is not a number"),
        ("x,z\n1,2\n", "less than two positions"),
        ("x,drive\n1,0\n2,9\n", "positions of the drive beyond its range"),
        ("x\n1\n2\n", "t.csv has 2 positions, and the drive 5"),
    ],
)
def test_wrong_tables(text, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text(text, encoding="utf-8")
    assert main(["optimize", "four_bar", *DRIVE, "--vary", "rocker=1:2", "--path", "coupler.tip=t.csv"]) == 1
    assert message in capsys.readouterr().err
