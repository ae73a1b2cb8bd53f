"""`mbd_sim kinematics`: report, table, picture, and errors with remedies."""

import csv
from pathlib import Path

import numpy as np
import pytest

from mbd_sim.cli.main import main


def test_report_table_and_picture(tmp_path, capsys):
    table, picture = tmp_path / "motion.csv", tmp_path / "motion.png"
    words = ["--drive", "crank_pivot=0:360deg:13", "--speed", "60rpm", "--point", "coupler.tip", "--modes", "--loads"]
    assert (
        main(["kinematics", "four_bar", *words, "--out", str(table), "--plot", str(picture), "--show", "efforts"]) == 0
    )
    out = capsys.readouterr().out
    assert "Assembly modes      2 at crank_pivot = 0 deg" in out
    assert "crank_pivot from 0 deg to 360 deg, 13 positions, at 6.28319 rad/s" in out
    assert "Dead points         none" in out
    assert "rocker_pin: from 44.4153 deg at crank_pivot = 0 deg to 90 deg" in out
    assert "rocker_pivot: least 91.2733 deg at crank_pivot = 39.1552 deg; greatest 143.13 deg" in out
    with table.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 13
    assert float(rows[12]["time_s"]) == pytest.approx(1.0, rel=1e-14)
    tip = [float(rows[3][f"coupler.tip.{axis}_m"]) for axis in "xyz"]
    assert np.hypot(tip[0] - 1.5, tip[2]) == pytest.approx(1.2, abs=1e-14)
    power = float(rows[3]["crank_pivot.effort_Nm"]) * float(rows[3]["crank_pivot.velocity_rad_s"])
    assert power == pytest.approx(float(rows[3]["power_W"]), rel=1e-14)
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_columns_and_limits_of_their_magnitudes(tmp_path, capsys):
    table = tmp_path / "motion.csv"
    words = ["kinematics", "four_bar", "--drive", "crank_pivot=0:360deg:13", "--out", str(table)]
    chosen = ["--column", "rocker_pivot.velocity*"]  # that of the drive is always in the file
    limits = ["--limit", "rocker_pivot.velocity_rad_s=0.4", "--limit", "rocker_pivot.position_rad=7"]
    assert main([*words, *chosen, *limits]) == 1
    out = capsys.readouterr().out
    with table.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["crank_pivot.position_rad", "rocker_pivot.velocity_rad_s"]
    speeds = np.abs([float(row["rocker_pivot.velocity_rad_s"]) for row in rows])
    assert f"rocker_pivot.velocity_rad_s: at most 0.4, exceeded in {np.sum(speeds > 0.4)} of 13 positions" in out
    assert f"{np.max(speeds):.6g} at crank_pivot = " in out
    assert "rocker_pivot.position_rad: at most 7, kept: " in out
    printed = [line.split() for line in out.splitlines()]
    assert printed[printed.index(list(rows[0])[1:]) + 1] == ["-0.5"]
    assert main([*words, "--limit", "rocker_pivot.position_rad=7"]) == 0
    for wrong, message in (("--column=rocker_pivot.speed", "no column is called"), ("--limit=x", "gives no limit")):
        assert main([*words, wrong]) == 1
        assert message in capsys.readouterr().err


def test_dead_points_are_marked(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lengths = "base: 2.2 m, crank: 1 m, coupler: 1 m, rocker: 1.1 m, density: 1"
    text = (Path(__file__).parents[3] / "config/constraints/four_bar.yaml").read_text(encoding="utf-8")
    head, rest = text.split("parameters:\n")
    Path("rocker.yaml").write_text(
        f"{head}parameters: {{{lengths}}}\n\nground:{rest.split('ground:')[1]}".replace("position: 90", "position: 40"),
        encoding="utf-8",
    )
    drive = ["--drive", "crank_pivot=-90:90deg:13"]
    assert main(["kinematics", "rocker.yaml", *drive]) == 1
    error = capsys.readouterr().err
    assert "crank_pivot reaches from -71.0344 deg to 71.0344 deg" in error and "--through-dead-points" in error
    assert main(["kinematics", "rocker.yaml", *drive, "--through-dead-points"]) == 0
    out = capsys.readouterr().out
    assert "Dead points         crank_pivot = 71.0344 deg; crank_pivot = -71.0344 deg" in out
    assert out.count("dead point") == 2


def test_an_angle_beyond_a_turn_without_a_unit_is_noted(capsys):
    for text, noted in (("0:10:3", True), ("0:360deg:3", False), ("0:3*pi:3", False)):
        assert main(["kinematics", "rod_pendulum", "--drive", f"pin={text}"]) == 0
        note = "10 is in rad (573°), because it has no unit. Write 10deg or 10rad."
        assert (note in capsys.readouterr().out) is noted


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--drive", "crank_pivot"], "gives no range of a drive. Write for example crank=0:360deg"),
        (["--drive", "crank_pivot=0:1:x"], "the number of positions cannot be 'x'"),
        (["--drive", "crank_pivot=0:1mm"], "mm"),
        (["--drive", "crank_pivvot=0:1"], "Did you mean 'crank_pivot'"),
        (["--drive", "crank_pivot=0:1:3", "--speed=-1"], "is negative"),
        (["--drive", "crank_pivot=0:1:3", "--speed", "1 m/s"], "the speed 1 m/s"),
        (["--drive", "crank_pivot=0:1:3", "--tolerance", "crank=1 kg"], "the unit 'kg' does not fit: a value in m"),
        (["--drive", "crank_pivot=0:1:3", "--tolerance", "joints.crank_pin.type=1 m"], "is not a number in the file"),
        (["--drive", "crank_pivot=0:1:3", "--point", "coupler.tap"], "Did you mean 'tip'"),
        (["--drive", "crank_pivot=0:1:3", "--plot", "x.csv"], "is not a picture"),
        (["--drive", "crank_pivot=0:1:3", "--out", "x.png"], "x.png"),
        (["--drive", "crank_pivot=0:1:3", "--show", "positions"], "--show: nothing is plotted. Give --plot too."),
        (
            ["--drive", "crank_pivot=0:1:3", "--plot", "x.png", "--show", "torques"],
            "show: there is no plot 'torques'",
        ),
        (["--drive", "crank_pivot=0:1:3", "--plot", "x.png", "--show", "efforts"], "Give --loads too."),
        (["--drive", "crank_pivot=0:1:3", "--plot", "x.png", "--show", "points"], "Name points with --point."),
    ],
)
def test_wrong_arguments(words, message, capsys):
    assert main(["kinematics", "four_bar", *words]) == 1
    assert message in capsys.readouterr().err
