"""The interfaces of `sim_node` besides joints and efforts: wrenches, live values, markers, diagnostics, poses."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Vector3, Wrench, WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter as NodeParameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import JointState, MultiDOFJointState
from std_msgs.msg import Float64MultiArray, Header, String
from visualization_msgs.msg import MarkerArray

from mbd_sim import Simulation
from test.system.growing_recordings import verified
from test.system.nodes import Listener, SimNodeProcess, as_in_the_node, nanoseconds, new_domain, running


def received(listener: Listener, kind: type, name: str) -> list[Any]:
    """Everything that comes on a topic from now on."""
    messages: list[Any] = []
    listener.node.create_subscription(kind, name, messages.append, 100)
    return messages


def computed(message: Any, mechanism: str) -> Simulation:
    """The free motion at the time of a message."""
    simulation = as_in_the_node(mechanism)
    simulation.step(nanoseconds(message.header.stamp) // 1_000_000)
    return simulation


def test_reactions_violation_poses_and_markers_are_those_of_the_same_run_without_ros(tmp_path: Path) -> None:
    extra = {"energy_values": True, "joint_reactions": True, "constraint_violation": True}
    extra |= {"part_poses": "coupler, rocker"}
    with running(tmp_path, mechanism="four_bar", **extra) as (_, listener):
        reactions = received(listener, MultiDOFJointState, "joint_reactions")
        energies = received(listener, JointState, "energy_values")
        violations = received(listener, Float64MultiArray, "constraint_violation")
        poses = received(listener, PoseStamped, "sim_node/poses/coupler")
        markers = received(listener, MarkerArray, "markers")
        listener.until(lambda: all([energies, reactions, violations, poses, markers]), "all topics")
        topics = {name for name, _ in listener.node.get_topic_names_and_types()}
    assert "/sim_node/poses/rocker" in topics and "/sim_node/poses/crank" not in topics
    latest = reactions[-1]
    assert latest.header.frame_id == "ground"
    simulation = computed(latest, "four_bar")
    for name, wrench in zip(latest.joint_names, latest.wrench, strict=True):
        expected = simulation.reactions()[name]
        assert [wrench.force.x, wrench.force.y, wrench.force.z] == expected.force.tolist()
        assert [wrench.torque.x, wrench.torque.y, wrench.torque.z] == expected.moment.tolist()
    assert set(latest.joint_names) == set(simulation.mechanism.all_joints)
    assert (
        dict(zip(energies[-1].name, energies[-1].position, strict=True))
        == computed(energies[-1], "four_bar").energies._asdict()
    )
    assert [dimension.label for dimension in violations[-1].layout.dim] == ["position", "velocity"]
    assert max(violations[-1].data) < 1e-9
    at, expected_at = poses[-1].pose.position, computed(poses[-1], "four_bar").poses()["coupler"].position
    assert [at.x, at.y, at.z] == expected_at.tolist()
    assert {marker.header.frame_id for marker in markers[-1].markers} == {"ground"}


def test_contact_states_and_events_are_those_of_the_same_run_without_ros(tmp_path: Path) -> None:
    with running(tmp_path, mechanism="rocking", contact_states=True, start_paused=True) as (_, listener):
        contacts = received(listener, JointState, "contact_states")
        events = received(listener, String, "sim_node/events")
        listener.all_matched()
        listener.pause(False)
        listener.until(lambda: len(contacts) > 5, "contact states")
        listener.until(lambda: any("contact: " in event.data for event in events), "an event of a contact")
    latest = contacts[-1]
    simulation = computed(latest, "rocking")
    left, right = (simulation.contacts()[name] for name in ("left", "right"))
    assert list(latest.name) == ["left", "left.friction_1", "right", "right.friction_1"]
    assert list(latest.position) == [left.gap, 0.0, right.gap, 0.0]
    assert list(latest.velocity) == [left.rate, *left.slip, right.rate, *right.slip]
    assert list(latest.effort) == [left.normal, *left.friction, right.normal, *right.friction]
    assert left.normal + right.normal > 5.0
    run = Simulation.from_file("rocking")
    run.run(until=max(6.0, 1e-9 * nanoseconds(latest.header.stamp) + 2.0))  # an event may be later than the state
    texts = {f"contact: {event.text}" for event in run.contact_events}
    assert {event.data for event in events if event.data.startswith("contact: ")} <= texts


def test_diagnostics_report_time_energies_and_commands_with_remedies(tmp_path: Path) -> None:
    with running(tmp_path, mechanism="four_bar") as (_, listener):
        listener.ready_to_command()
        messages = received(listener, DiagnosticArray, "/diagnostics")
        listener.until(lambda: messages, "diagnostics")
        by_name = {status.name: status for status in messages[-1].status}
        assert set(by_name) == {f"/sim_node: {name}" for name in ("timing", "mechanics", "commands", "output")}

        def timing_now() -> dict[str, float]:
            (status,) = (status for status in messages[-1].status if status.name == "/sim_node: timing")
            return {value.key: float(value.value) for value in status.values if value.key != "paused"}

        listener.until(lambda: timing_now()["real_time_factor"] > 0.2, "a second that is not lost to other processes")
        timing = timing_now()
        assert 0.0 < timing["period p50 (us)"] <= timing["period p99 (us)"] <= timing["period max (us)"]
        mechanics = {value.key: float(value.value) for value in by_name["/sim_node: mechanics"].values}
        assert abs(mechanics["energy residual (J)"]) < 1e-6
        assert mechanics["constraint violation (m)"] < 1e-9
        assert by_name["/sim_node: mechanics"].level == DiagnosticStatus.OK

        def warned() -> DiagnosticStatus | None:
            listener.by_name.publish(JointState(name=["crank_pivott"], effort=[1.0]))
            found = [status for status in messages[-1].status if status.name.endswith("commands")]
            return found[0] if found[0].level == DiagnosticStatus.WARN else None

        listener.until(warned, "a warning")
        assert "Did you mean 'crank_pivot'?" in warned().message  # type: ignore[union-attr]


def test_pauses_resets_and_changes_of_the_rate_are_not_warned_of_as_lost_time(tmp_path: Path) -> None:
    with running(tmp_path, real_time_priority=0) as (_, listener):
        statuses: list[DiagnosticStatus] = []

        def take(message: DiagnosticArray) -> None:
            statuses.extend(status for status in message.status if status.name == "/sim_node: timing")

        listener.node.create_subscription(DiagnosticArray, "/diagnostics", take, 100)
        listener.until(lambda: statuses, "diagnostics")
        for number, factor in enumerate((5.0, 0.02)):
            listener.pause(True)
            listener.spin(0.3)
            listener.pause(False)
            listener.reset()
            assert listener.set_parameter("real_time_factor", factor).successful
            listener.until(lambda number=number: len(statuses) > 2 * number + 2, "two periods of diagnostics")
    overruns = [int(value.value) for status in statuses for value in status.values if value.key == "overruns"]
    for before, after, status in zip(overruns[:-1], overruns[1:], statuses[1:], strict=True):
        # Where other programs kept the schedule from being met, it was restarted, and the warning is true.
        assert status.level == DiagnosticStatus.OK or after > before, status.message


def test_a_rate_beyond_the_steps_is_answered_with_what_it_becomes(tmp_path: Path) -> None:
    with running(tmp_path, publish_rate=20, clock_rate=2000) as (process, listener):
        assert "clock_rate is 2000 Hz" in process.text
        messages = received(listener, DiagnosticArray, "/diagnostics")
        assert listener.set_parameter("publish_rate", 5000).successful
        remark = (
            "publish_rate is 5000 Hz, but the state changes only with each step of 0.001 s: messages are sent at 1000"
        )
        listener.until(lambda: remark in process.text, "the warning on the console")
        listener.until(
            lambda: (
                messages and ("publish_rate (Hz)", "1000") in [(v.key, v.value) for v in messages[-1].status[3].values]
            ),
            "the rate that results",
        )


def test_a_wrench_acts_expires_is_recorded_and_the_run_can_be_computed_again(tmp_path: Path) -> None:
    with running(tmp_path, record=True, record_dir="logs", command_timeout=0.2) as (process, listener):
        applied = received(listener, Float64MultiArray, "sim_node/applied_wrenches")
        push = listener.node.create_publisher(WrenchStamped, "sim_node/wrench/lower", 10)
        listener.until(push.get_subscription_count, "matching")
        listener.all_matched()
        for frame in ("grund", "lower"):
            wrench = Wrench(force=Vector3(x=2.0, z=1.0))
            push.publish(WrenchStamped(header=Header(frame_id=frame), wrench=wrench))
        listener.until(lambda: any("wrench on lower" in event for event in listener.events), "the expiry")
        assert "there is no frame 'grund'. Did you mean 'ground'?" in process.text
        listener.until(lambda: len(applied) >= 2, "both changes")
        labels = [dimension.label for dimension in applied[0].layout.dim]
        assert labels[6] == "lower.own_force.x" and list(applied[0].data)[6:9] == [2.0, 0.0, 1.0]
        assert not any(applied[1].data[:12])
        result = listener.call(SetParameters, "set_parameters", parameters=[number("gravity", [0.0, 0.0, -1.62])])
        assert result.results[0].successful, result.results[0].reason
        result = listener.call(SetParameters, "set_parameters", parameters=[number("joints.elbow.damping", 0.25)])
        assert result.results[0].successful
        seen = len(listener.states)
        listener.until(lambda: len(listener.states) > seen + 20, "states")
        assert abs(listener.next_energies()[-1]) < 1e-9
        assert process.end(signal.SIGINT) == 0
    result = verified(tmp_path / "logs")
    assert result.compared["joint_states"] > 20 and result.commands["applied_wrenches"] >= 2


def number(name: str, value: float | list[float]) -> Parameter:
    """A parameter of one or several real numbers."""
    if isinstance(value, list):
        kind = ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=value)
    else:
        kind = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
    return Parameter(name=name, value=kind)


def test_live_values_are_parameters_and_what_does_not_fit_is_refused_with_a_reason(tmp_path: Path) -> None:
    with running(tmp_path, **{"parameters.m": 2.5, "joints.elbow.damping": 1}) as (_, listener):

        def set_to(name: str, value: float | list[float]) -> Any:
            return listener.call(SetParameters, "set_parameters", parameters=[number(name, value)]).results[0]

        assert listener.parameter("parameters.m") == 2.5
        assert list(listener.parameter("gravity")) == [0.0, 0.0, -9.81]
        assert "3 numbers" in set_to("gravity", [0.0, 0.0]).reason
        assert "a number" in set_to("parameters.m", float("nan")).reason
        reason = set_to("joints.elbow.dampin", 1.0).reason
        assert (
            "no parameter 'joints.elbow.dampin'. Did you mean 'joints.elbow.damping'?" in reason and "'live'" in reason
        )
        refused = set_to("joints.elbow.damping", -1.0)
        assert not refused.successful and "damping" in refused.reason
        assert not set_to("mechanism", 1.0).successful
        assert "start" in listener.descriptor("mechanism").additional_constraints
        assert set_to("parameters.m", 1.0).successful
        assert listener.parameter("parameters.m") == 1.0


def test_simulated_time_continues_over_a_reset_and_stops_in_a_pause(tmp_path: Path) -> None:
    with running(tmp_path, clock_rate=500) as (_, listener):
        listener.node.set_parameters([NodeParameter("use_sim_time", value=True)])
        clock = listener.node.get_clock()
        listener.until(lambda: clock.now().nanoseconds > 0, "simulated time")
        before = clock.now().nanoseconds
        listener.reset()
        listener.until(lambda: clock.now().nanoseconds > before, "time going on")
        listener.pause(True)
        paused_ns = listener.until_paused()
        # /clock is best effort: where its last message is lost, the repeated one brings the time.
        listener.until(lambda: clock.now().nanoseconds == paused_ns, "the time of the pause")
        listener.spin(0.8)
        assert clock.now().nanoseconds == paused_ns


def test_two_instances_and_two_clocks_are_warned_of(tmp_path: Path) -> None:
    domain = new_domain()
    # Running nodes may first warn that they have lost time, and then say nothing more on the console for 30 s.
    paused = {"start_paused": True}
    nodes = [SimNodeProcess(domain, tmp_path, paused, [f"__ns:=/{name}"]) for name in ("left", "right")]
    listener = Listener(domain, "left")
    messages = received(listener, DiagnosticArray, "/diagnostics")
    try:
        listener.until(
            lambda: (
                {status.name for message in messages for status in message.status if "/clock" in status.message}
                >= {"/left/sim_node: timing", "/right/sim_node: timing"}
            ),
            "both warnings",
        )
        listener.until(lambda: all("publishes /clock as well" in node.text for node in nodes), "both consoles")
    finally:
        listener.close()
        for node in nodes:
            node.kill()


def test_commands_of_best_effort_publishers_arrive(tmp_path: Path) -> None:
    profile = QoSProfile(depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    with running(tmp_path, command_timeout=0.0) as (_, listener):
        publisher = listener.node.create_publisher(JointState, "joint_commands", profile)
        listener.until(publisher.get_subscription_count, "a subscription that fits")

        def applied() -> bool:
            publisher.publish(JointState(name=["elbow"], effort=[0.5]))
            return bool(listener.states) and listener.states[-1].effort[1] == 0.5

        listener.until(applied, "the effort")
