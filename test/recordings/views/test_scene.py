"""Recorded runs shown in Rerun: the contents that its reader finds, compared with the recomputed simulation."""

import random
from collections import defaultdict

import numpy as np
import pytest
import rclpy

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.cli.main import main
from mbd_sim.recordings.run.reader import TopicRole, open_recording
from mbd_sim.recordings.run.recomputation import Recomputation
from mbd_sim.recordings.views.table import read_table
from mbd_sim.ros.node.sim_node import SimNode
from test.pictures.rerun.test_viewer import Recorded
from test.recordings.runs import ACTIONS, drive, record_run
from test.recordings.views.test_table import foreign_bag
from test.system.nodes import new_domain


@pytest.mark.parametrize("mechanism", ["tumbling", "stick_slip"])
def test_parts_have_the_poses_of_the_run(tmp_path, mechanism):
    """With a free joint and its quaternion, a driven joint, commands, wrenches and a reset."""
    run = record_run(tmp_path, mechanism, seconds=0.5, seed=3, commands=6, publish_rate=100.0, wrenches="'*'")
    shown = tmp_path / "run.rrd"
    assert main(["view", str(run), "--save", str(shown), "--rate", "1000", "--quiet", "--reactions"]) == 0
    recorded = Recorded(shown)
    recomputation = Recomputation(open_recording(run).files[0])
    expected = defaultdict(list)
    for message in open_recording(run).messages(set(recomputation.roles)):
        recomputation.advance(recomputation.tick_of(message))
        recomputation.apply(message)
        if recomputation.roles[message.topic] is TopicRole.JOINT_STATES:
            expected[message.time_ns].append(recomputation.simulation.poses())
    part = next(iter(recomputation.simulation.mechanism.parts))
    rows = recorded.rows[f"/world/parts/{part}"]
    assert len(rows) > 45
    assert len(rows) == sum(map(len, expected.values()))
    for time, row in rows:
        poses = expected[round(time * 1e9)].pop(0)
        np.testing.assert_allclose(row["Transform3D:translation"][0], poses[part].position, atol=1e-6)
        rotation = rot.from_quaternion(np.roll(row["Transform3D:quaternion"][0], 1))
        np.testing.assert_allclose(rotation, poses[part].rotation, atol=1e-6)
    table = read_table(open_recording(run))
    texts = {row["TextLog:text"][0] for _, row in recorded.rows["/events/log"]}
    assert {text for _, text in table.events} <= texts
    assert "/joints/reaction" in recorded.rows
    residual = recorded.column("/energy/residual_pJ", "Scalars:scalars")[:, 0]
    assert set((residual * 1e-12).round(20)) <= set(table.energies[:, -1].round(20))


def test_a_bag_without_a_mechanism_is_shown_as_plots(tmp_path, capsys):
    shown = tmp_path / "robot.rrd"
    assert main(["view", str(foreign_bag(tmp_path / "robot.mcap")), "--save", str(shown), "--quiet"]) == 0
    assert "contains no mechanism" in capsys.readouterr().out
    recorded = Recorded(shown)
    assert set(recorded.rows) == {"/joints/position"}
    values = recorded.column("/joints/position", "Scalars:scalars")
    np.testing.assert_array_equal(values[:, 0], np.arange(20.0))
    assert recorded.static["/joints/position"]["SeriesLines:names"] == [["a", "b"]]


def test_invalid_sinks_and_points_are_reported(tmp_path, capsys):
    run = record_run(tmp_path, "rod_pendulum", seconds=0.1, seed=1, commands=1)
    assert main(["view", str(run), "--save", str(tmp_path / "run.txt")]) == 1
    assert "no viewer sink" in capsys.readouterr().err
    assert main(["view", str(run), "--save", str(tmp_path / "run.rrd"), "--trace", "rod.tp", "--quiet"]) == 1
    assert "no point" in capsys.readouterr().err


def test_all_files_of_a_rosbag2_folder_are_shown(tmp_path):
    given = ["mechanism:=rod_pendulum", "start_paused:=true", f"record_dir:={tmp_path}", "record_format:=rosbag2"]
    arguments = [word for pair in given for word in ("-p", pair)]
    rclpy.init(args=["--ros-args", "--log-level", "ERROR", *arguments], domain_id=new_domain())
    try:
        node = SimNode(lambda: None)
        node.start()
        for seed in range(3):
            drive(node, 0.3, 2, random.Random(seed), ACTIONS)
            assert node.recordings.split()[0]
        node.stop()
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    (folder,) = (path for path in tmp_path.iterdir() if path.is_dir())
    recording = open_recording(folder)
    assert len(recording.files) == 4
    assert main(["view", str(folder), "--save", str(tmp_path / "run.rrd"), "--rate", "1000", "--quiet"]) == 0
    states = [recording.decoded(message) for message in recording.messages({"/joint_states"})]
    angles = Recorded(tmp_path / "run.rrd").column("/joints/position/angular", "Scalars:scalars")
    assert len(angles) > 80
    np.testing.assert_array_equal(angles, [state.position for state in states])
