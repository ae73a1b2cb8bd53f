"""The node's live run in Rerun, written to a file that Rerun's own tools read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from test.system.nodes import running


def test_a_run_with_rerun_to_a_file_holds_the_scene_and_the_plots(tmp_path: Path) -> None:
    with running(tmp_path, rerun="run.rrd", mechanism="balancing_pendulum") as (process, listener):
        listener.until(lambda: len(listener.states) > 100, "a second of states")
        assert process.end() == 0, process.text
    rerun = str(Path(sys.executable).with_name("rerun"))
    subprocess.run([rerun, "rrd", "verify", str(tmp_path / "run.rrd")], check=True, capture_output=True)
    printed = subprocess.run(
        [rerun, "rrd", "print", str(tmp_path / "run.rrd")], check=True, capture_output=True, text=True
    ).stdout
    for entity in (
        "/world/parts/cart",
        "/world/parts/pendulum",
        "/joints/position",
        "/energy",
        "/sensors/imu/specific_force",
    ):
        assert entity in printed


def test_a_wrong_sink_is_reported_and_the_simulation_runs(tmp_path: Path) -> None:
    with running(tmp_path, rerun="spwan") as (process, listener):
        listener.until(lambda: len(listener.states) > 20, "states")
        assert "no viewer sink 'spwan'" in process.text
