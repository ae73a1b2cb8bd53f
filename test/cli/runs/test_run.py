"""`mbd_sim run` leaves files; the commands for recordings accept mechanisms. All of it needs no ROS."""

import json
import re

import numpy as np
import pytest
from PIL import Image

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.verification import verify
from mbd_sim.recordings.views.table import read_table

SLIDER = """
mechanism: planar_slider
parts: {puck: {mass: 2, inertia: [0.1, 0.1, 0.1]}}
joints:
  glide: {type: planar, between: [ground, puck], axis: [0, 0, 1], position: [0.1, 0.2, 0.3], velocity: [1, 0, 0]}
"""


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Run a command line in an empty folder; return its exit code, and what it printed."""
    monkeypatch.chdir(tmp_path)

    def run_command(*words):
        code = main([*words, "--quiet"])
        printed = capsys.readouterr()
        return code, printed.out + printed.err

    return run_command


def test_a_run_is_recorded_and_verifies(run, tmp_path):
    code, printed = run("run", "double_rod", "--time", "0.5", "--set", "l=80 cm", "--start", "elbow=30 deg",
                        "--effort", "elbow=0.5", "--out", "run.mcap", "--rate", "200")  # fmt: skip
    assert code == 0
    assert "wrote run.mcap: 101 states" in printed
    (found,) = verify(tmp_path / "run.mcap")
    assert found.agrees
    table = read_table(open_recording(tmp_path / "run.mcap"))
    sim = Simulation.from_file("double_rod", set={"l": 0.8, "joints.elbow.position": "30 deg"})
    sim.set_efforts({"elbow": 0.5})
    sim.run(until=0.5)
    assert list(table.position[-1]) == list(sim.q)
    assert list(table.effort[0]) == [0.0, 0.5]


def test_tables_contain_what_is_requested(run, tmp_path):
    code, printed = run("run", "double_rod", "--time", "0.1", "--out", "run.npz",
                        "--reactions", "--violation", "--poses", "lower")  # fmt: skip
    assert code == 0, printed
    table = np.load(tmp_path / "run.npz")
    assert len(table["time_s"]) == 11
    sim = Simulation.from_file("double_rod")
    sim.step(100)
    reaction, pose = sim.reactions()["elbow"], sim.poses()["lower"]
    assert [table[f"reaction.elbow.force_{axis}_N"][-1] for axis in "xyz"] == list(reaction.force)
    assert [table[f"reaction.elbow.moment_{axis}_Nm"][-1] for axis in "xyz"] == list(reaction.moment)
    assert [table[f"pose.lower.{axis}_m"][-1] for axis in "xyz"] == list(pose.position)
    assert np.all(table["violation.position"] == 0.0)
    about = json.loads(str(table["about"]))
    assert (about["recording"], about["mechanism"]) == ("double_rod", "double_rod")


def test_drives_are_in_the_table(run, tmp_path):
    run("run", "moving_support_pendulum", "--time", "0.1", "--out", "run.csv")
    names, *rows = (tmp_path / "run.csv").read_text().splitlines()
    sim = Simulation.from_file("moving_support_pendulum")
    sim.run(until=0.1)
    last = dict(zip(names.split(","), map(float, rows[-1].split(",")), strict=True))
    for name, drive in sim.drives().items():
        (effort,) = (value for column, value in last.items() if column.startswith(f"{name}.effort"))
        assert effort == drive.force


def test_the_motion_is_drawn_at_a_pace_and_in_a_size(run, tmp_path):
    options = ["--animate", "run.webp", "--pace", "0.25", "--size", "320x240"]
    code, printed = run("run", "double_rod", "--time", "0.04", *options)
    assert code == 0 and "wrote run.webp: 5 frames" in printed
    with Image.open(tmp_path / "run.webp") as picture:
        assert (picture.n_frames, picture.size) == (5, (320, 240))


@pytest.mark.parametrize("name", ["run.gif", "run.html", "run.mp4"])
def test_the_motion_is_drawn(run, tmp_path, name):
    if name.endswith("mp4"):
        pytest.importorskip("av")
    code, printed = run("run", "double_rod", "--time", "0.08", "--animate", name, "--trace", "lower.tip")
    assert code == 0
    assert f"wrote {name}: 3 frames" in printed
    content = (tmp_path / name).read_bytes()
    if name == "run.gif":
        with Image.open(tmp_path / name) as picture:
            assert (picture.n_frames, picture.size) == (3, (600, 400))
            assert picture.info["duration"] == 40
            first = np.array(picture.convert("L"))
            picture.seek(2)
            assert np.any(np.array(picture.convert("L")) != first)
            assert 0.002 < np.mean(first < 200) < 0.5
    elif name == "run.html":
        text = content.decode()
        assert len(re.findall(r'"iVBOR', text)) == 3
        assert "http" not in text
    else:
        import av

        with av.open(str(tmp_path / name)) as video:
            frames = [frame.to_ndarray(format="gray") for frame in video.decode(video=0)]
        assert len(frames) == 3
        assert frames[0].shape == (400, 600)


def test_a_run_that_diverges_leaves_its_files(run, tmp_path):
    code, printed = run(
        "run", "double_rod", "--time", "1", "--effort", "elbow=1e300", "--out", "run.mcap", "--plot", "run.png"
    )
    assert code == 1
    assert "wrote run.mcap" in printed and "wrote run.png" in printed
    (_, event), *_ = read_table(open_recording(tmp_path / "run.mcap")).events
    assert event.startswith("warning: ")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["export", "four_bar", "--time", "0.1", "--out", "t.csv"], "wrote t.csv: 11 rows"),
        (["plot", "double_rod", "--time", "0.1", "--out", "p.svg", "--show", "reactions,energies"], "reaction force"),
        (["verify", "double_rod", "--time", "0.1", "--set", "l=0.5"], "double_rod: verified, bit for bit"),
        (["view", "double_rod", "--time", "0.1", "--save", "v.rrd"], "double_rod: 21 states"),
        (["rerun-with", "double_rod", "--time", "0.1", "--set", "l=0.5", "--plot", "r.png"], "wrote r.png"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_commands_for_recordings_run_mechanisms(run, words, expected):
    code, printed = run(*words)
    assert code == 0, printed
    assert expected in printed
    assert "/tmp/mbd_sim" not in printed


def test_exported_recordings_keep_their_reactions(run):
    run("run", "four_bar", "--time", "0.1", "--reactions", "--out", "run.mcap")
    assert run("export", "run.mcap", "--out", "t.parquet")[0] == 0
    parquet = pytest.importorskip("pyarrow.parquet")
    names = parquet.read_table("t.parquet").column_names
    assert "reaction.rocker_pin.moment_z_Nm" in names


def test_a_coordinate_of_several_starts_where_it_is_put(run, tmp_path):
    (tmp_path / "slider.yaml").write_text(SLIDER)
    code, printed = run("run", "slider.yaml", "--time", "0.1", "--out", "t.npz",
                        "--start", "glide.y=50 cm", "--start", "glide.angle=90 deg")  # fmt: skip
    assert code == 0, printed
    table = np.load(tmp_path / "t.npz")
    first = [float(table[name][0]) for name in ("glide.x.position_m", "glide.y.position_m", "glide.angle.position_rad")]
    assert first == [0.1, 0.5, np.deg2rad(90.0)]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "double_rod", "--start", "elbo=1"], r"--start elbo: there is no joint.*Did you mean 'elbow'"),
        (["run", "double_rod", "--start", "elbow"], r"--start elbow: not of the form JOINT=VALUE"),
        (["run", "double_rod", "--set", "joints.elbow.dampin=1"], "dampin.*Did you mean 'damping'"),
        (["run", "double_rod", "--out", "run.txt"], r"run\.txt: this file format is not supported.*\.mcap, \.csv"),
        (["run", "double_rod", "--out", "no/run.csv"], "there is no folder no"),
        (["run", "double_rod", "--trace", "lower"], "Give --animate too"),
        (["run", "double_rod", "--pace", "0.5"], "--pace: nothing is drawn. Give --animate too"),
        (["run", "double_rod", "--animate", "run.gif", "--pace", "0.01"], "Give a pace of 0.025 or more"),
        (["run", "double_rod", "--animate", "run.gif", "--trace", "lower.tipp"], "Did you mean 'tip'"),
        (["run", "double_rod", "--animate", "run.avi"], r"Choose one of \.gif, \.webp, \.mp4, \.html"),
        (["run", "double_rod", "--reactions"], r"--reactions: nothing is recorded.*Give --out or --plot"),
        (["run", "double_rod", "--out", "a.csv", "--rate", "5000"], r"5000 Hz cannot be recorded.*1000 Hz"),
        (
            ["run", "double_rod", "--time", "1", "--step", "3"],
            "a run of 1 s has no step: one takes 3 s. Give a time of 3",
        ),
        (["plot", "double_rod", "--time", "1e-5", "--out", "p.png"], "a run of 1e-05 s has no step: one takes 0.001 s"),
        (["sweep", "double_rod", "--vary", "l=1,2", "--time", "1e-5"], "a run of 1e-05 s has no step"),
        (["plot", "double_rad", "--out", "p.png"], "neither a recording nor a shipped mechanism.*'double_rod'"),
        (["plot", "missing.mcap", "--out", "p.png"], r"missing\.mcap: there is no such file"),
        (["export", "missing/run", "--out", "t.csv"], "there is no such file or folder"),
    ],
    ids=lambda value: " ".join(value[1:4]) if isinstance(value, list) else None,
)
def test_errors_come_before_the_run_and_name_the_remedy(run, tmp_path, words, message):
    code, printed = run(*words)
    assert code == 1
    assert re.search(message, printed), printed
    assert not list(tmp_path.iterdir())


def test_options_of_a_mechanism_are_refused_with_a_recording(run):
    run("run", "double_rod", "--time", "0.1", "--out", "run.mcap")
    code, printed = run("plot", "run.mcap", "--out", "p.png", "--time", "3", "--set", "l=0.5")
    assert code == 1
    assert "run.mcap is a recording: --time, --set would have no effect. Leave it out, or use rerun-with" in printed
