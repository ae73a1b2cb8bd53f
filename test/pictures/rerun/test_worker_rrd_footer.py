"""Files of runs are written without a footer, which would be kept in memory; it is added at the end."""

import subprocess
from pathlib import Path

import pytest
import rerun_cli

from mbd_sim import Simulation
from mbd_sim.pictures.rerun import worker
from mbd_sim.pictures.rerun.scene import DisplayOptions, RowMaker, describe_scene
from mbd_sim.pictures.rerun.worker import add_footer


def check(path):
    """What Rerun's own check says, empty if nothing."""
    program = Path(rerun_cli.__file__).parent / "rerun"
    done = subprocess.run([program, "rrd", "verify", str(path)], capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else done.stderr


@pytest.fixture
def without_footer(tmp_path):
    """A file as the viewer's process writes it."""
    from mbd_sim.pictures.rerun.stream import RerunStream

    model = Simulation.from_file("rod_pendulum").model
    RerunStream(
        describe_scene(model, RowMaker(model).layout, DisplayOptions()), str(tmp_path / "a.rrd"), footer=False
    ).close()
    return tmp_path / "a.rrd"


def test_a_footer_is_added(without_footer):
    assert "Missing RRD footer" in check(without_footer)
    add_footer(without_footer)
    assert check(without_footer) == ""
    assert list(without_footer.parent.iterdir()) == [without_footer]


def test_a_large_file_stays_as_it_is(without_footer, monkeypatch):
    before = without_footer.read_bytes()
    monkeypatch.setattr(worker, "LARGEST", len(before) - 1)
    add_footer(without_footer)
    assert without_footer.read_bytes() == before


def test_a_file_that_cannot_be_rewritten_stays_as_it_is(without_footer, tmp_path, monkeypatch):
    before = without_footer.read_bytes()
    failing = tmp_path / "rerun"
    failing.write_text('#!/bin/sh\necho half > "$5"\nexit 1\n')
    failing.chmod(0o755)
    monkeypatch.setenv("RERUN_CLI_PATH", str(failing))
    add_footer(without_footer)
    assert without_footer.read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"a.rrd", "rerun"}
    add_footer(tmp_path / "missing.rrd")
