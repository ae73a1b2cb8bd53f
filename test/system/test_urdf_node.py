"""A robot's URDF with an overlay in the real node, and the run computed again from its recording alone."""

from __future__ import annotations

import signal
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from mbd_sim import parse_mechanism
from test.generators.urdf_robots import quadruped
from test.system.nodes import as_in_the_node, running

OVERLAY = """
urdf: four.urdf
base: free
gravity: [0, 0, 0]
integrator: {method: rk4}
joints:
  base: {angular_velocity: [0.3, 0, 1]}
  FL_thigh_joint: {position: 0.5, stiffness: 3, damping: 0.1}
"""


def test_a_robot_flies_and_its_recording_is_enough_to_compute_the_run_again(tmp_path: Path) -> None:
    (tmp_path / "four.urdf").write_text(quadruped())
    (tmp_path / "robot.yaml").write_text(OVERLAY)
    with running(tmp_path, mechanism="robot.yaml", record=True, record_dir="logs") as (process, listener):
        listener.until(lambda: listener.descriptions, "robot_description")
        robot = ElementTree.fromstring(listener.descriptions[0])
        assert {"trunk", "RR_foot"} <= {link.get("name") for link in robot.iter("link")}
        assert list(listener.states[-1].name[:7]) == [
            *(f"base.{label}" for label in ("x", "y", "z", "rx", "ry", "rz")),
            "FL_hip_joint",
        ]
        seen = len(listener.states)
        listener.until(lambda: len(listener.states) > seen + 20, "states")
        assert process.end(signal.SIGINT) == 0
    (path,) = (tmp_path / "logs").glob("four_legs_*.mcap")
    (tmp_path / "four.urdf").unlink()
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        (attachment,) = reader.iter_attachments()
        recorded = [
            (message.sequence, list(content.velocity))
            for _, channel, message, content in reader.iter_decoded_messages(topics=["/joint_states"])
        ]
    simulation = as_in_the_node(parse_mechanism(attachment.data.decode()))
    assert len(recorded) > 20
    for step, velocity in recorded:
        simulation.step(step - simulation.steps)
        assert velocity == simulation.u.tolist()
