"""What `replay_node` refuses at its start."""

from pathlib import Path

import pytest
import rclpy

from mbd_sim import Simulation
from mbd_sim.ros.replay.replay_node import ReplayNode
from test.system.nodes import new_domain


@pytest.mark.parametrize(
    ("start", "end", "message"),
    [
        (2.0, 0.0, "start is 2 s, but the recording lasts only 0.05 s"),
        (0.02, 0.01, "end is 0.01 s, before start, 0.02 s"),
    ],
)
def test_a_range_with_nothing_to_play_is_refused(tmp_path: Path, start: float, end: float, message: str) -> None:
    simulation = Simulation.from_file("rod_pendulum")
    with simulation.recording(tmp_path / "run.mcap"):
        simulation.step(50)
    given = {"bag": tmp_path / "run.mcap", "start": start, "end": end}
    arguments = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    rclpy.init(args=["--ros-args", *arguments], domain_id=new_domain())
    try:
        with pytest.raises(ValueError, match=message):
            ReplayNode(lambda: None)
    finally:
        rclpy.try_shutdown()
