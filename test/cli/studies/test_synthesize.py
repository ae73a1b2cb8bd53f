"""`mbd_sim synthesize` and `mbd_sim centers`: files that load, pictures, exit codes and errors with remedies."""

import pytest

from mbd_sim import load_mechanism
from mbd_sim.cli.main import main

THREE = ["--pose=0,0,0", "--pose=1,50cm,30deg", "--pose=1.8,1.6,70deg", "--center=0.2,-1", "--center=1.6,-0.8"]


def test_poses_are_written_and_drawn(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["synthesize", "poses", *THREE, "--out", "lift.yaml", "--plot", "lift.png"]) == 0
    out = capsys.readouterr().out
    assert "1 of 1 pair, 1 without defects" in out and "linkage 1: it passes through all poses" in out
    assert load_mechanism("lift.yaml").name == "lift" and (tmp_path / "lift.png").exists()


@pytest.mark.parametrize(
    ("words", "name", "said"),
    [
        (["dead-center", "--swing", "60deg", "--time-ratio", "1.25"], "rocker", "Transmission angle  38.04 deg"),
        (["dead-center", "--stroke", "80mm", "--crank", "0.03", "--time-ratio", "1.2"], "slider", "0.03 m"),
        (
            ["function", "--function", "x**1.5", "--x", "1:2", "--input", "90deg", "--output", "60deg"],
            "rocker",
            "Four-bars           1",
        ),
    ],
)
def test_dead_centers_and_functions_are_written(words, name, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["synthesize", *words, "--out", "made.yaml"]) == 0
    assert said in capsys.readouterr().out
    assert name in load_mechanism("made.yaml").joints


def test_centers_are_printed_tabulated_and_drawn(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["--polygons", "--inflection", "coupler", "--centrodes", "coupler", "--out", "c.csv", "--plot", "c.png"]
    assert main(["centers", "four_bar", "--drive", "crank_pivot=60:90deg:4", "--speed", "10", *words]) == 0
    out = capsys.readouterr().out
    assert "ground / coupler" in out and "(1.34939, 2.33721) m" in out and "Inflection circle of coupler" in out
    assert (tmp_path / "c.png").exists() and "coupler.moving.x_m" in (tmp_path / "c.csv").read_text()
    assert main(["centers", "four_bar", "--drive", "crank_pivot=60deg"]) == 0
    assert "(1.34939, 2.33721) m" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["synthesize", "poses", "--pose=1,2"], "2 numbers instead of 3"),
        (["synthesize", "poses", *THREE, "--take", "2"], "there is no solution 2"),
        (["synthesize", "dead-center"], "either --swing or --stroke is needed"),
        (["synthesize", "function", "--x", "1:2"], "--function is needed"),
        (["synthesize", "dead-center", "--swing", "1", "--plot", "x.png"], "--plot has no effect on dead-center"),
        (["synthesize", "poses", *THREE, "--time-ratio", "2"], "--time-ratio has no effect on poses"),
        (["synthesize", "dead-center", "--stroke", "1", "--rocker", "2"], "--rocker has no effect on a slider-crank"),
        (["synthesize", "function", "--input-start", "9deg"], "--input-start has no effect on 5 positions"),
        (["centers", "four_bar", "--drive", "crank_pivot=1", "--centrodes", "coupler"], "centrodes need a range"),
        (
            ["centers", "four_bar", "--drive", "crank_pivot=1", "--speed", "2"],
            "--speed has no effect without --polygons",
        ),
        (
            ["kinematics", "four_bar", "--drive", "crank_pivot=1", "--seed", "2"],
            "--seed has no effect without --samples",
        ),
        (["check", "four_bar", "--latex", "--json", "--cost"], "--json, --cost: --latex prints equations"),
    ],
)
def test_mistakes_are_named(words, message, capsys):
    assert main(words) == 1
    assert message in capsys.readouterr().err
