"""A base on wheels under velocities from another participant, with and without headers, recorded and verified."""

from __future__ import annotations

import math
import signal
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped, Vector3

from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.messages.cdr import joint_states
from mbd_sim.recordings.run.reader import Recording, open_recording
from test.system.growing_recordings import verified
from test.system.nodes import running


def twist(x: float, yaw: float, y: float = 0.0) -> Twist:
    return Twist(linear=Vector3(x=x, y=y), angular=Vector3(z=yaw))


def speeds_at_the_last_warning(recording: Recording) -> Array:
    """The recorded speeds just before the watchdog has stopped the base for good, whatever this process waited for."""
    speeds = found = np.zeros(0)
    for message in recording.messages():
        if message.topic == "/joint_states":
            speeds = joint_states(message.payload).velocity
        elif message.topic.endswith("/events") and b"no more commands for" in message.payload:
            found = speeds
    return found


def test_a_rover_drives_in_a_circle_and_stops_when_no_more_velocities_arrive(tmp_path: Path) -> None:
    options = {
        "mechanism": "rover",
        "record": True,
        "record_dir": "logs",
        "real_time_factor": 2.0,
        "command_timeout": 2.0,
    }
    with running(tmp_path, **options) as (process, listener):
        velocities = listener.node.create_publisher(Twist, "cmd_vel", 10)
        listener.until(velocities.get_subscription_count, "the subscription")
        listener.until(lambda: listener.states, "states")
        timer = listener.node.create_timer(0.02, lambda: velocities.publish(twist(0.5, 0.8)))
        listener.until(lambda: listener.states[-1].position[2] > 2.0, "a third of a circle")
        assert list(listener.states[-1].name[:3]) == ["ride.x", "ride.y", "ride.angle"]
        # Only the newest message is read, so one that is followed by another at once may never be.
        refused = listener.node.create_timer(0.03, lambda: velocities.publish(twist(0.5, 0.0, y=0.1)))
        listener.until(lambda: "cmd_vel: message rejected" in process.text, "the rejection")
        listener.node.destroy_timer(refused)
        assert "this base cannot move sideways, but linear.y is 0.1. Set it to zero." in process.text
        velocities.publish(twist(math.nan, 0.0))
        listener.node.destroy_timer(timer)
        listener.until(lambda: abs(listener.states[-1].velocity[2]) < 1e-3, "the watchdog")
        listener.until(lambda: "no more commands for left_motor, right_motor" in process.text, "the warning")
        assert process.end(signal.SIGINT) == 0
    (path,) = (tmp_path / "logs").glob("rover_*.mcap")
    verification = verified(path)
    assert verification.commands["applied_commands"] >= 2  # the velocity, and the stop
    speeds = speeds_at_the_last_warning(open_recording(path))
    assert [math.hypot(*speeds[:2]), *speeds[2:]] == pytest.approx([0.5, 0.8, 4.45, 8.05], rel=1e-3)


def test_velocities_may_come_with_headers(tmp_path: Path) -> None:
    with running(tmp_path, mechanism="rover", stamped_cmd_vel=True, command_timeout=0.0) as (_, listener):
        velocities = listener.node.create_publisher(TwistStamped, "cmd_vel", 10)
        listener.until(velocities.get_subscription_count, "the subscription")
        velocities.publish(TwistStamped(twist=twist(0.4, 0.0)))
        listener.until(lambda: listener.states and listener.states[-1].position[0] > 0.3, "the motion")
        assert listener.states[-1].velocity[0] == pytest.approx(0.4, rel=0.02)
