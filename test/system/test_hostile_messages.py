"""Whatever arrives over DDS: the nodes refuse it, go on answering, and their motion stays right."""

from __future__ import annotations

import contextlib
import importlib
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from mbd_sim.recordings.run.reader import open_recording
from test.recordings.runs import record_run
from test.system.nodes import Listener, as_in_the_node, nanoseconds, new_domain, running
from test.system.raw_requests import raw_requests
from test.system.test_replay import Audience, ReplayProcess

LONG = "x" * 1_000_000
CONTROL = "\x1b[2J\x07\r\n\0shoulder"
BAD_UTF8 = b"\xff\xfe\xc0\x80"
NAN, INF = float("nan"), float("inf")


def interface(name: str) -> Any:
    """The class of a type such as std_msgs/msg/String."""
    package, kind, short = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), short)


def parameters(*values: ParameterValue, name: str = "real_time_factor") -> list[Parameter]:
    return [Parameter(name=name, value=value) for value in values]


PARAMETERS = [
    *parameters(*(ParameterValue(type=kind) for kind in (*range(11), 42, 99, 255))),
    *parameters(ParameterValue(type=3, double_value=NAN), ParameterValue(type=3, double_value=-INF)),
    *parameters(ParameterValue(type=8, double_array_value=[1.0] * 100_000), ParameterValue(type=3), name="gravity"),
    *(Parameter(name=name, value=ParameterValue(type=3)) for name in ("", "nothing", "/", LONG, CONTROL, "é" * 99)),
]
NAMES = ["", "/", "*", LONG, CONTROL, "é", "use_sim_time", *["nothing"] * 10_000]

# Hostile messages by type; all of them are refused.
MESSAGES: dict[str, list[Any]] = {
    "std_msgs/msg/Float64MultiArray": [
        Float64MultiArray(),
        Float64MultiArray(data=[NAN, 0.0]),
        Float64MultiArray(data=[INF, -INF]),
        Float64MultiArray(data=[1e308] * 3),
        Float64MultiArray(data=[1.0] * 300_000),
        Float64MultiArray(layout=MultiArrayLayout(dim=[MultiArrayDimension(label=CONTROL, size=2**32 - 1)] * 1000)),
    ],
    "sensor_msgs/msg/JointState": [
        JointState(),
        JointState(name=["shoulder"]),
        JointState(name=["shoulder"], effort=[NAN]),
        JointState(name=["shoulder", "shoulder"], effort=[1.0, 1.0]),
        JointState(name=["shoulder", "nothing"], effort=[1.0, 1.0]),
        JointState(name=["", LONG, CONTROL], effort=[1.0] * 3),
        JointState(name=[str(number) for number in range(50_000)], effort=[1.0] * 50_000),
        JointState(effort=[1.0] * 300_000),
    ],
    "trajectory_msgs/msg/JointTrajectory": [
        JointTrajectory(),
        JointTrajectory(joint_names=["shoulder"], points=[JointTrajectoryPoint(positions=[NAN])]),
        JointTrajectory(joint_names=["shoulder"], points=[JointTrajectoryPoint(positions=[0.0])]),  # no servo
        JointTrajectory(joint_names=["", LONG, CONTROL], points=[JointTrajectoryPoint(positions=[0.0] * 3)]),
        JointTrajectory(joint_names=["shoulder"], points=[JointTrajectoryPoint()] * 10_000),
        JointTrajectory(joint_names=["nothing"] * 50_000),
    ],
    "geometry_msgs/msg/WrenchStamped": [
        WrenchStamped(wrench=Wrench(force=Vector3(x=NAN))),
        WrenchStamped(wrench=Wrench(torque=Vector3(z=-INF))),
        *(WrenchStamped(header=Header(frame_id=name)) for name in (LONG, CONTROL, "é" * 1000, "nothing")),
    ],
}  # fmt: skip
# Hostile requests by type of service; services without an entry only get bytes.
REQUESTS: dict[str, list[Any]] = {
    "rcl_interfaces/srv/SetParameters": [SetParameters.Request(parameters=PARAMETERS)],
    "rcl_interfaces/srv/SetParametersAtomically": [
        SetParametersAtomically.Request(parameters=[*parameters(ParameterValue(type=3, double_value=2.0)), one])
        for one in PARAMETERS
    ],
    "rcl_interfaces/srv/GetParameters": [GetParameters.Request(names=NAMES)],
    "rcl_interfaces/srv/GetParameterTypes": [GetParameterTypes.Request(names=NAMES)],
    "rcl_interfaces/srv/DescribeParameters": [DescribeParameters.Request(names=NAMES)],
    "rcl_interfaces/srv/ListParameters": [
        ListParameters.Request(prefixes=NAMES, depth=depth) for depth in (0, 1, 2**64 - 1)
    ],
}


def damaged(valid: bytes) -> Iterator[bytes]:
    """Bytes that are no message, made from one: cut, too long, with wrong counts and wrong encodings."""
    draw = random.Random(len(valid))
    yield b""
    yield b"\x00"
    yield b"\xff" * 64
    yield valid[:4]
    yield valid[:4] + b"\xff" * 64
    yield valid[:-1]
    yield valid + BAD_UTF8 * 100
    yield valid.replace(b"nothing", BAD_UTF8 + b"abc")
    for _ in range(10):
        position = draw.randrange(4, max(len(valid), 5))
        yield valid[:position] + draw.randbytes(4) + valid[position + 4 :]


def encoded(type_name: str, service_type: Any) -> Iterator[bytes]:
    """Requests with strings that are not UTF-8; of services without strings and arrays, any bytes.

    Fast DDS decodes requests into a buffer that grows (rmw_fastrtps 8.4), so that it reads as many elements as a forged
    count says, before the node sees anything; no client library sends such a request.
    """
    requests = REQUESTS.get(type_name)
    if requests is not None:
        yield from (serialize_message(request).replace(b"nothing", BAD_UTF8 + b"abc") for request in requests)
    elif type_name.startswith("std_srvs/"):
        yield from damaged(serialize_message(service_type.Request()))


def attack_topics(listener: Listener, name: str, answers: Callable[[str], None]) -> int:
    """Send to all topics that a node subscribes to; returns their number."""
    context = Context()
    rclpy.init(context=context, domain_id=listener.context.get_domain_id())
    stranger = Node("stranger", context=context)  # a process has one type for each topic
    found = listener.node.get_subscriber_names_and_types_by_node(name, "/")
    for topic, (type_name, *_) in found:
        message_type = interface(type_name)
        publisher = listener.node.create_publisher(message_type, topic, 100)
        wrong = stranger.create_publisher(WrenchStamped if message_type is String else String, topic, 100)
        listener.until(publisher.get_subscription_count, topic)
        for message in MESSAGES.get(type_name, []):
            publisher.publish(message)
            publisher.publish(serialize_message(message)[:-5])
        wrong.publish(wrong.msg_type())
        if type_name in MESSAGES:
            samples = {"sensor_msgs/msg/JointState": JointState(name=["nothing"], effort=[1.0])}
            for data in damaged(serialize_message(samples.get(type_name, MESSAGES[type_name][-1]))[:4096]):
                publisher.publish(data)
        answers(topic)
        listener.node.destroy_publisher(publisher)
    stranger.destroy_node()
    rclpy.shutdown(context=context)
    return len(found)


def attack_services(listener: Listener, name: str, least: int, answers: Callable[[str], None]) -> None:
    """Send to all services of a node, once at least so many are discovered."""
    listener.until(lambda: name in listener.node.get_node_names(), f"the discovery of {name}")

    def found() -> list[tuple[str, list[str]]]:
        return list(listener.node.get_service_names_and_types_by_node(name, "/"))

    listener.until(lambda: len(found()) >= least, f"the discovery of the services of {name}")
    for service, (type_name, *_) in found():
        service_type = interface(type_name)
        for request in REQUESTS.get(type_name, []):
            client = listener.node.create_client(service_type, service)
            listener.until(client.service_is_ready, service)
            future = client.call_async(request)
            listener.until(future.done, f"answer of {service}")
            refuses(type_name, future.result())
            listener.node.destroy_client(client)
        with raw_requests(listener.node, service_type, service.lstrip("/")) as send:
            for data in encoded(type_name, service_type):
                send(data)
            answers(service)


def refuses(type_name: str, response: Any) -> None:
    if type_name.endswith("/SetParameters"):
        assert len(response.results) == len(PARAMETERS)
        assert all(result.reason for result in response.results if not result.successful)
        accepted = [one for one, result in zip(PARAMETERS, response.results, strict=True) if result.successful]
        assert all(one.name == "real_time_factor" and one.value.type in (2, 3) for one in accepted), [
            str(one)[:150] for one in accepted
        ]  # 0 is valid
    if type_name.endswith("/SetParametersAtomically"):
        assert response.result.successful or response.result.reason


def test_nothing_that_arrives_ends_sim_node_or_changes_its_motion(tmp_path: Path) -> None:
    with running(tmp_path, start_paused=True, record_dir=str(tmp_path)) as (process, listener):

        def answers(name: str) -> None:
            assert listener.parameter("mechanism") == "double_rod", name

        attack_services(listener, "sim_node", 12, answers)
        listener.pause(True)
        assert listener.reset().success  # bytes may happen to be a request to step
        topics = attack_topics(listener, "sim_node", answers)
        assert topics >= 6
        listener.set_parameter("real_time_factor", 1.0)
        listener.set_parameter("step_count", 100)
        start = listener.until_paused()
        assert listener.step().success
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) == start + 100_000_000, "100 steps")
        simulation = as_in_the_node("double_rod")
        simulation.step(100)
        assert list(listener.states[-1].position) == simulation.q.tolist()
        assert process.end() == 0
        assert "Traceback" not in process.text
        assert "\x1b[2J" not in process.text and max(map(len, process.text.splitlines())) < 1000


def test_nothing_that_arrives_ends_replay_node_or_changes_what_it_plays(tmp_path: Path) -> None:
    bag = record_run(tmp_path, "double_rod", seconds=0.3, seed=1, resets=False)
    domain = new_domain()
    process, listener = ReplayProcess(domain, tmp_path, {"bag": str(bag), "stay": True}), Audience(domain)
    listener.process = process
    with contextlib.ExitStack() as ends:
        ends.callback(process.kill)
        ends.callback(listener.close)
        listener.listen(JointState, "/joint_states")
        listener.all_matched()

        def answers(name: str) -> None:
            assert listener.parameter("bag") == str(bag), name

        attack_services(listener, "replay_node", 10, answers)
        attack_topics(listener, "replay_node", answers)
        listener.pause(True)
        assert listener.set_parameter("step_count", 1_000_000).successful
        assert listener.set_parameter("seek_to", 0.0).successful
        assert listener.call_seek().success
        assert listener.step().success
        recorded = [m.payload for m in open_recording(bag).in_time_order(0) if m.topic == "/joint_states"]
        received = listener.received["/joint_states"]
        listener.until(lambda: received[-len(recorded) :] == recorded, "the recorded states")
        assert process.end() == 0
        assert "Traceback" not in process.text
