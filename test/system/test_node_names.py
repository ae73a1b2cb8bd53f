"""A node whose mechanism has names that ROS does not allow in topics: they stay in messages and parameters."""

from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from mbd_sim.files.text.yaml_text import yaml_text
from mbd_sim.mechanism.values.source import dotted
from mbd_sim.recordings.run.verification import verify
from test.generators.names import named_mechanism
from test.system.nodes import running

NAMES = [
    "my robot/2", "upper-arm", "2nd.arm", "größe", "shoulder-pitch", "el/bow joint", "ta:ble", "tip (1)", "tip 2",
    "imu-1", "imu_1", "mo,tor", "d & <1>", "*", "a.b",
]  # fmt: skip


def test_names_stay_in_messages_and_parameters(tmp_path: Path) -> None:
    (tmp_path / "names.yaml").write_text(yaml_text(named_mechanism(NAMES)), encoding="utf-8")
    hinge = NAMES[4]
    options = {
        "mechanism": str(tmp_path / "names.yaml"), "live": "all", "part_poses": "all", "wrenches": "all", "record": True,
        "record_dir": "logs", "joint_reactions": True, "marker_rate": 10.0, "accelerations": "all",
        "start": "shoulder-pitch = 0.3, 'el/bow joint' = 0.1",
    }  # fmt: skip
    with running(tmp_path, **options) as (_, listener):
        listener.until(lambda: listener.states, "joint states")
        assert list(listener.states[-1].name)[:2] == [hinge, NAMES[5]]
        poses, measured = [], []
        listener.node.create_subscription(PoseStamped, "sim_node/poses/_2nd_arm", poses.append, 10)
        listener.node.create_subscription(JointState, "sim_node/sensors/imu_1", measured.append, 10)
        listener.until(lambda: poses and measured, "poses and measurements")
        key = dotted(("joints", hinge, "damping"))
        listener.set_parameter(key, 0.7)
        assert listener.parameter(key) == pytest.approx(0.7)
        topics = [name for name, _ in listener.node.get_topic_names_and_types()]
        assert {f"/sim_node/wrench/{word}" for word in ("_2nd_arm", "upper_arm", "gr_e")} <= set(topics)
    (recording,) = (tmp_path / "logs").glob("*.mcap")
    (verification,) = verify(recording)
    assert verification.is_intact and verification.agrees, verification.first
