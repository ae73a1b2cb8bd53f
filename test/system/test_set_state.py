"""The state of a running node, set from outside."""

from __future__ import annotations

import math
from pathlib import Path

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from test.system.growing_recordings import verified
from test.system.nodes import running


def test_a_state_set_by_name_and_resets_to_given_starts_are_confirmed_recorded_and_verify(tmp_path: Path) -> None:
    starts = {"starts.early": "'crank_pivot = 20 deg'"}
    with running(tmp_path, mechanism="four_bar", record=True, record_dir="logs", **starts) as (process, listener):
        publisher = listener.node.create_publisher(JointState, "sim_node/set_state", 10)
        listener.until(publisher.get_subscription_count, "matching")
        names = list(listener.states[-1].name)
        publisher.publish(JointState(name=[names[0]], position=[1.2], velocity=[0.5]))
        listener.until(
            lambda: f"state set: {names[0]} = 1.2, {names[0]}.velocity = 0.5" in listener.events, "the event"
        )
        listener.ready_to_command()
        listener.by_order.publish(Float64MultiArray(data=[1.0] * 7))
        listener.until(lambda: "efforts expected, but 7 given" in process.text, "the rejection of the command")
        publisher.publish(JointState(name=names, position=[1.0] * len(names)))  # its reason is given nevertheless
        listener.until(lambda: "the loops cannot be closed with these positions" in process.text, "the rejection")
        listener.until(lambda: any("set_state: message rejected" in event for event in listener.events), "its event")
        for bad in (
            JointState(name=["crank"], position=[1.0]),
            JointState(name=[names[0]], position=[math.nan]),
            JointState(name=[names[0]], position=[1.0], effort=[1.0]),
            JointState(name=[names[0]] * 2, position=[1.0, 2.0]),
            JointState(name=[names[0]], position=[1.0, 2.0]),
            JointState(),
        ):
            publisher.publish(bad)
        assert not listener.set_parameter("start", "nowhere").successful
        assert listener.set_parameter("start", "early").successful
        listener.pause(True)
        listener.reset()
        listener.until_paused()
        listener.until(lambda: abs(listener.states[-1].position[0] - math.radians(20)) < 1e-12, "the given start")
        listener.until(lambda: abs(listener.next_energies()[-1]) < 1e-12, "its energies")
        listener.pause(False)
        seen = len(listener.states)
        listener.until(lambda: len(listener.states) > seen + 20, "states after the reset")
        assert abs(listener.next_energies()[-1]) < 1e-7
        assert process.end() == 0
        assert "Traceback" not in process.text
    result = verified(tmp_path / "logs")
    assert (result.commands["new_states"], result.commands["resets"]) == (2, 1)
