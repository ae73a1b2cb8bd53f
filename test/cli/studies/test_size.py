"""`mbd_sim size`: from a prescribed motion, a run and a table to the same numbers, and what it refuses."""

import numpy as np
import pytest

from mbd_sim.cli.main import main
from mbd_sim.recordings.views.cycles import run_cycle
from mbd_sim.recordings.views.table import RunTable
from mbd_sim.studies.sizing import read_cycle

ARM = """
mechanism: arm
parts:
  arm: {mass: 3, center: [0.2, 0, 0], inertia: [0.1, 0.1, 0.1]}
joints:
  axis: {type: revolute, between: [ground, arm], axis: [0, -1, 0]}
"""
MOTORS = """name,rotor_inertia,continuous_torque,peak_torque,max_speed
small,1e-5,0.01,0.02,300
large,1e-4,5,15,300
"""


def test_from_a_motion_to_motors_and_back_from_the_table(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    (tmp_path / "motors.csv").write_text(MOTORS, encoding="utf-8")
    motion = [
        "size",
        "arm.yaml",
        "--drive",
        "axis=-90:90deg:31",
        "--motion",
        "cycloid:0.5s",
        "--return",
        "--dwell",
        "0.1",
    ]
    chosen = ["--catalog", "motors.csv", "--gear", "10", "--gear", "best"]
    assert main([*motion, *chosen, "--out", "cycle.csv", "--plot", "cycle.png"]) == 0
    first = capsys.readouterr().out
    assert [line.split()[0] for line in first.splitlines() if "best" in line or "  10  " in line] == ["large"] * 2 + [
        "small"
    ] * 2
    load = read_cycle("cycle.csv", "axis")
    assert np.allclose(load.effort, 0.22 * load.acceleration + 3 * 9.81 * 0.2 * np.cos(load.position))
    assert main(["size", "cycle.csv", "--joint", "axis", "--inertia", "0.22", *chosen]) == 0
    again = capsys.readouterr().out
    assert [line for line in again.splitlines() if line.startswith("Effort")] == [
        line for line in first.splitlines() if line.startswith("Effort")
    ]
    assert main([*motion, "--catalog", "motors.csv", "--motor", "small", "--spring", "rms"]) == 1
    assert "suffices" not in capsys.readouterr().out.replace("no motor", "")


@pytest.mark.parametrize(
    "line, message",
    [
        ("size arm.yaml --drive axis=0:90deg --speed 1 --motion cycloid:1s", "both say how the drive moves"),
        ("size arm.yaml --speed 1", "is for a prescribed motion"),
        ("size arm.yaml --drive axis=0:90deg --motion sine:1s", "no law of motion 'sine'"),
        ("size arm.yaml --drive axis=0:90deg --rest 0.1", "Give --spring too"),
        ("size gone.csv", "cannot read"),
        ("size gone.csv --time 3", "--time has no effect on a table"),
        (
            "size arm.yaml --drive axis=0:90deg --motion cycloid:1s --once",
            "--once has no effect on a prescribed motion",
        ),
        ("size arm.yaml --drive axis=0:90deg --speed 1 --dwell 1s", "--dwell has no effect on a constant speed"),
        ("size arm.yaml --drive axis=0:90deg --motion cycloid:1s --share 0.2", "--share has no effect on cycloid:1s"),
    ],
)
def test_what_has_no_effect_or_does_not_exist_is_refused(tmp_path, monkeypatch, capsys, line, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    assert main(line.split()) == 1
    assert message in capsys.readouterr().err


def test_the_load_of_a_run():
    t = np.linspace(0.0, 2.0, 201)
    speed, effort = np.cos(np.pi * t), 3.0 * np.sin(np.pi * t)
    both = np.stack([speed, speed], axis=1)
    run = RunTable(
        "run.mcap", True, "run", ("a", "b"), ("rad", "m"), t, np.arange(201), both, both,
        np.stack([np.zeros(201), effort], axis=1), None, (),
    )  # fmt: skip
    load = run_cycle(run)
    assert (load.name, load.rotation) == ("b", False) and load.rms == pytest.approx(3.0 / np.sqrt(2.0))
    assert np.allclose(load.acceleration, -np.pi * np.sin(np.pi * t), atol=1e-6)
