"""`sim_node` as its users meet it: over real DDS, from another process."""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from mbd_sim import Simulation
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.ros.node import sim_node
from test.system.growing_recordings import verified
from test.system.nodes import as_in_the_node, nanoseconds, new_domain, refusal, running

STEP_NS = 1_000_000


def free_run(ticks: int, efforts: dict[int, list[float]] | None = None) -> Simulation:
    """The double rod computed here, with efforts that take effect at given ticks."""
    simulation = as_in_the_node("double_rod")
    for tick in range(ticks):
        if efforts and tick in efforts:
            simulation.set_efforts(efforts[tick])
        simulation.step()
    return simulation


def tick(message: JointState) -> int:
    return nanoseconds(message.header.stamp) // STEP_NS


def assert_is_state_of(message: JointState, simulation: Simulation) -> None:
    assert list(message.position) == simulation.q.tolist()
    assert list(message.velocity) == simulation.u.tolist()


def test_states_and_energies_come_at_the_set_rate_with_a_residual_at_round_off(tmp_path: Path) -> None:
    """And the states are those of the same run without ROS, bit for bit."""
    with running(tmp_path, publish_rate=50) as (_, listener):
        listener.until(lambda: min(len(listener.energies), len(listener.states)) >= 50, "a second of states")
        stamps = [nanoseconds(message.header.stamp) for message in listener.states]
        gaps = np.diff(stamps)  # more where this process was left waiting
        assert min(gaps) == 20 * STEP_NS and not any(gaps % (20 * STEP_NS))
        for message in listener.states:
            assert list(message.name) == ["shoulder", "elbow"]
            assert len(message.position) == len(message.velocity) == len(message.effort) == 2
        labels = [dimension.label for dimension in listener.energies[-1].layout.dim]
        assert labels[:2] == ["kinetic", "potential"] and labels[-1] == "residual"
        assert all(abs(message.data[-1]) < 1e-9 for message in listener.energies)
        assert max(message.data[0] for message in listener.energies) > 1.0
        assert_is_state_of(listener.states[-1], free_run(tick(listener.states[-1])))


def test_the_clock_runs_in_real_time_and_parameters_are_described_and_bad_values_refused(tmp_path: Path) -> None:
    with running(tmp_path, clock_rate=100) as (_, listener):
        listener.until(lambda: len(listener.clocks) > 20, "clock")

        def keeps_time() -> bool:  # a busy machine may leave the node waiting for a while, but not for ever
            began, clock = time.monotonic(), listener.clocks[-1]
            listener.spin(1.0)
            return 0.8 < 1e-9 * (listener.clocks[-1] - clock) / (time.monotonic() - began) < 1.25

        listener.until(keeps_time, "a second in real time")
        gaps = np.diff(listener.clocks)
        assert min(gaps) == 10 * STEP_NS and not any(gaps % (10 * STEP_NS))
        rate = listener.descriptor("real_time_factor")
        assert rate.description.startswith("1: real time")
        assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (0.0, 1000.0)
        assert not rate.read_only
        assert listener.descriptor("mechanism").read_only
        assert not listener.set_parameter("mechanism", "rod_pendulum").successful
        assert not listener.set_parameter("publish_rate", -5.0).successful
        assert not listener.set_parameter("publish_rate", "fast").successful
        assert listener.set_parameter("publish_rate", 20).successful
        assert listener.parameter("publish_rate") == 20

        def gaps() -> set[int]:
            return set(np.diff([nanoseconds(state.header.stamp) for state in listener.states[-7:]]))

        listener.until(lambda: gaps() == {50 * STEP_NS}, "states at the new rate")


def test_efforts_by_order_and_by_name_change_the_motion(tmp_path: Path) -> None:
    with running(tmp_path, command_timeout=0) as (_, listener):
        listener.ready_to_command()
        listener.by_order.publish(Float64MultiArray(data=[3.0, -1.0]))
        listener.until(lambda: list(listener.states[-1].effort) == [3.0, -1.0], "the effort in joint_states")
        listener.by_name.publish(JointState(name=["elbow"], effort=[2.5]))
        listener.until(lambda: list(listener.states[-1].effort) == [3.0, 2.5], "the effort by name")
        later = nanoseconds(listener.states[-1].header.stamp) + 200 * STEP_NS
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) >= later, "0.2 s with these efforts")
        listener.until(lambda: abs(listener.next_energies()[3]) > 1e-3, "their work")
        assert abs(listener.next_energies()[-1]) < 1e-9
        last = listener.states[-1]
        unforced = free_run(tick(last))
        assert max(abs(np.array(last.position) - unforced.q)) > 1e-3


def test_bad_commands_are_rejected_whole_counted_and_leave_the_motion_untouched(tmp_path: Path) -> None:
    with running(tmp_path, command_timeout=0) as (process, listener):
        listener.ready_to_command()
        for data in ([1.0], [math.nan, 1.0]):
            listener.by_order.publish(Float64MultiArray(data=data))
        for name, effort in ((["elbw"], [1.0]), (["elbow"], [math.nan]), (["shoulder", "elbow"], [1.0])):
            listener.by_name.publish(JointState(name=name, effort=effort))
        listener.until(lambda: "rejected" in process.text, "a warning")
        sent = 5

        def counted() -> bool:  # warnings come once a second at most: one more message each time shows the count
            nonlocal sent
            listener.by_name.publish(JointState(name=["elbw"], effort=[1.0]))
            sent += 1
            listener.spin(1.2)
            return f"({sent} so far)" in process.text

        listener.until(counted, "the count of rejections")
        assert "Did you mean 'elbow'?" in process.text
        assert process.text.count("rejected") < sent
        last = listener.states[-1]
        assert_is_state_of(last, free_run(tick(last)))
        assert not listener.applied


def test_a_late_subscriber_receives_the_efforts_in_effect_also_after_a_reset(tmp_path: Path) -> None:
    latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    with running(tmp_path, command_timeout=0, record=True, record_dir="run") as (process, listener):
        listener.ready_to_command()
        for effort in (1.0, 2.0, 3.0):
            listener.by_order.publish(Float64MultiArray(data=[effort, 0.0]))
            listener.until(lambda effort=effort: listener.states[-1].effort[0] == effort, "the effort")  # type: ignore[misc]
        late: list[list[float]] = []
        listener.node.create_subscription(
            Float64MultiArray, "sim_node/applied_efforts", lambda message: late.append(list(message.data)), latched
        )
        listener.until(lambda: late and late[-1] == [3.0, 0.0], "the efforts in effect")
        listener.reset()
        listener.until(lambda: late[-1] == listener.applied[-1] == [0.0, 0.0], "no efforts")
        later: list[list[float]] = []
        listener.node.create_subscription(
            Float64MultiArray, "sim_node/applied_efforts", lambda message: later.append(list(message.data)), latched
        )
        listener.until(lambda: later and later[-1] == [0.0, 0.0], "no efforts, later")
        assert process.end() == 0
    (path,) = (tmp_path / "run").glob("*.mcap")
    recorded = [message for message in open_recording(path).messages() if message.topic.endswith("applied_efforts")]
    assert len(recorded) == 3  # the reset implies the last
    verified(path)


def test_pause_stops_time_and_step_takes_exactly_the_steps_that_were_set(tmp_path: Path) -> None:
    with running(tmp_path) as (_, listener):
        assert not listener.step().success
        assert listener.pause(True).success
        listener.until(lambda: "paused" in listener.events, "the event")
        ticks = listener.until_paused() // STEP_NS
        listener.spin(0.8)
        assert tick(listener.states[-1]) == ticks
        assert listener.set_parameter("step_count", 7).successful
        for taken in (7, 14):
            assert listener.step().success
            listener.until(lambda taken=taken: tick(listener.states[-1]) == ticks + taken, f"{taken} steps")
        assert_is_state_of(listener.states[-1], free_run(ticks + 14))
        assert listener.pause(False).success
        listener.until(lambda: tick(listener.states[-1]) > ticks + 60, "time going on")


def test_reset_returns_to_the_start_while_the_clock_goes_on(tmp_path: Path) -> None:
    with running(tmp_path) as (_, listener):
        clocks = listener.clocks
        listener.until(lambda: len(listener.states) > 30 and clocks, "states and the clock")
        listener.pause(True)
        assert listener.reset().success
        listener.until(lambda: list(listener.states[-1].velocity) == [0.0, 0.0], "the start state")
        assert list(listener.states[-1].position) == [math.pi / 2, 0.0]
        assert nanoseconds(listener.states[-1].header.stamp) > 29 * 10 * STEP_NS
        answer = listener.step().message
        listener.until(lambda: answer == f"t = {1e-9 * clocks[-1]:.9g} s", "the clock that ~/step returns")
        listener.pause(False)
        listener.spin(0.3)
        assert all(np.diff(clocks) >= 0)
        assert abs(listener.next_energies()[-1]) < 1e-9


def test_as_fast_as_possible_outruns_real_time(tmp_path: Path) -> None:
    def factors() -> np.ndarray:
        """How many times as fast as real time each message follows the one 50 messages before."""
        times = np.array([1e-9 * nanoseconds(state.header.stamp) for state in listener.states])
        return (times[50:] - times[:-50]) / np.subtract(listener.arrivals[50:], listener.arrivals[:-50])

    with running(tmp_path, real_time_factor=0) as (_, listener):
        listener.until(lambda: listener.states[-1].header.stamp.sec >= 3, "3 s of simulated time")
        listener.until(lambda: np.any(factors() > 2.0), "half a second of simulated time in a quarter")


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (
            {"mechanism": "dubble_rod"},
            "there is no shipped mechanism of this name (got 'dubble_rod'). Did you mean 'double_rod'?",
        ),
        ({"mechanism": "nowhere/to.yaml"}, "nowhere/to.yaml"),
        ({"method": "rk5"}, "no method 'rk5'"),
        ({"publish_rate": -1}, "publish_rate"),
        ({"publish_rate": "often"}, "publish_rate"),
        ({"mechanisn": "double_rod"}, "there is no parameter 'mechanisn'. Did you mean 'mechanism'?"),
        ({"wrenches": "upper, lowr"}, "there is no part or point 'lowr'. Did you mean 'lower'?"),
        ({"part_poses": "uper"}, "there is no part 'uper'. Did you mean 'upper'?"),
        ({"live": "joints.elbow.axis"}, "joints.elbow.axis"),
        ({"start": "'elbw = 1'"}, "start: there is no joint 'elbw'. Did you mean 'elbow'?"),
        ({"sensor_seed": 3}, "sensor_seed: double_rod has no sensors. Leave the parameter out."),
        ({"sensor_seed": -2}, "parameter 'sensor_seed' must lie between -1 and 1e+15, not -2."),
        ({"use_sim_time": True, "real_time_factor": 2.0}, "set real_time_factor in the node that publishes it"),
        ({"use_sim_time": True, "reset_rewinds_clock": True}, "set reset_rewinds_clock in the node that publishes it"),
    ],
)
def test_a_wrong_start_ends_the_node_with_a_reason(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], parameters: dict[str, Any], words: str
) -> None:
    """In this process: `test_a_wrong_start_ends_a_process` starts one."""
    arguments = ["--ros-args", "-p", "record:=false"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={str(value).lower() if isinstance(value, bool) else value}"]
    assert words in told(arguments, monkeypatch, capfd)


def told(arguments: list[str], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> str:
    """What the program prints with arguments with which it does not start; a node that starts all the same is ended."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(new_domain()))
    monkeypatch.setattr(sys, "argv", ["sim_node", *arguments])
    end = threading.Timer(30.0, signal.raise_signal, [signal.SIGINT])
    end.start()
    try:
        assert sim_node.main() == 1
    finally:
        end.cancel()
    assert not rclpy.ok()
    printed = "".join(capfd.readouterr())
    assert "Traceback" not in printed
    return printed


def test_a_wrong_start_ends_a_process(tmp_path: Path) -> None:
    assert "Did you mean 'joints.elbow.damping'?" in refusal(tmp_path, {"joints.elbow.dampng": 1.0})


@pytest.mark.parametrize(
    ("arguments", "word"),
    [(["-p", "mechanism:=rod_pendulum"], "-p mechanism:=rod_pendulum"), (["--ros-args", "-p", "step=1"], "step=1")],
)
def test_arguments_that_ros_would_pass_over_end_the_node_with_the_right_way(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], arguments: list[str], word: str
) -> None:
    printed = told(arguments, monkeypatch, capfd)
    assert word in printed
    assert "--ros-args -p mechanism:=double_rod" in printed


def test_an_effort_that_makes_the_motion_infinite_pauses_and_reset_recovers(tmp_path: Path) -> None:
    with running(tmp_path, command_timeout=0) as (process, listener):
        listener.ready_to_command()
        listener.pause(True)
        listener.pause(False)
        listener.by_order.publish(Float64MultiArray(data=[1e306, 0.0]))
        listener.until(lambda: any("diverged" in event for event in listener.events), "the event")
        listener.until(lambda: "became infinite" in process.text, "the reason on the console")
        assert "publishing failed" not in process.text
        assert all(np.all(np.isfinite(message.position)) for message in listener.states)
        later = listener.until_paused() + 200 * STEP_NS
        listener.reset()
        listener.pause(False)
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) >= later, "states after the reset")
        assert "Traceback" not in process.text
