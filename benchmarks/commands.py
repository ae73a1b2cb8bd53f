"""Every kind of command, sent from another process over DDS, and the answer of the node: the table of docs/node.md.

python -m benchmarks.commands
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped, Vector3, Wrench, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from benchmarks.node_process import Measured, running
from mbd_sim.recordings.messages import cdr

BENCH = """
mechanism: bench
gravity: [0, 0, 0]
integrator: {step: 0.5 ms}
ground: {points: {foot: [0, 0, -1]}}
parts:
  wheel: {mass: 1, inertia: [0.1, 0.1, 0.1]}
  arm: {mass: 1, inertia: [0.1, 0.1, 0.1]}
  fan: {mass: 1, inertia: [0.01, 0.01, 0.01]}
  disc: {mass: 1, inertia: [0.01, 0.01, 0.01]}
  rotor: {mass: 1, inertia: [0.001, 0.001, 0.001]}
  coil: {mass: 1, inertia: [0.1, 0.1, 0.1]}
  table: {mass: 100}
  trolley: {mass: 5}
joints:
  plain: {type: revolute, between: [ground, wheel], axis: [0, 0, 1], damping: 0.1, effort_limit: 2}
  servo: {type: revolute, between: [ground, arm], axis: [0, 0, 1], limits: {lower: -1, upper: 1}}
  spin: {type: revolute, between: [ground, fan], axis: [0, 0, 1], velocity_limit: 50}
  limited: {type: revolute, between: [ground, disc], axis: [0, 0, 1], damping: 0.1}
  motor: {type: revolute, between: [ground, rotor], axis: [0, 0, 1]}
  clutch: {type: revolute, between: [ground, coil], axis: [0, 0, 1], damping: 0.5}
  lift: {type: prismatic, between: [ground, table], axis: [0, 0, 1], damping: 2 kN*s/m}
  rail: {type: prismatic, between: [ground, trolley], axis: [1, 0, 0],
    drive: {command: position, bandwidth: 40, velocity_limit: 1, upper: 1.5}}
actuators:
  servo_motor: {type: effort, joint: servo, servo: {controls: position, kp: 100, kd: 10}}
  spin_motor: {type: effort, joint: spin, servo: {controls: velocity, kp: 1, ki: 5}}
  limited_motor: {type: effort, joint: limited, effort_limit: 0.5}
  dc: {type: dc_motor, joint: motor, torque_constant: 0.1, resistance: 1, voltage_limit: 24}
  torque: {type: dc_motor, joint: clutch, control: current, torque_constant: 0.2, resistance: 1}
  cylinder: {type: hydraulic_cylinder, between: [ground.foot, table], areas: [20 cm^2, 14 cm^2], retracted: 0.9,
    stroke: 0.6, dead_volumes: [1e-4, 1e-4], rated_flow: 20 L/min, supply: 160 bar, pressures: [50 bar, 70 bar]}
"""
SETTLING = 1.5  # s after which a command has taken effect
PERIOD = 2.2  # s in which the node publishes its diagnostics at least once
POSITION, VELOCITY, EFFORT = range(3)
Row = tuple[str, str, str]


class Sender:
    """Publishes commands to a node, and reads its states and why it has rejected a message."""

    def __init__(self, observed: Measured) -> None:
        self._observed, self._publishers = observed, dict[str, Any]()
        self._problem = ""
        observed.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith("commands") and "rejected" in status.message:
                self._problem = status.message.partition("the last one on ")[2]

    def send(self, topic: str, message: Any) -> None:
        """Publish once, after the node has been found."""
        if topic not in self._publishers:
            publisher = self._publishers[topic] = self._observed.node.create_publisher(type(message), topic, 10)
            while not publisher.get_subscription_count():
                time.sleep(0.01)
            time.sleep(0.2)
        self._problem = ""
        self._publishers[topic].publish(message)

    def state(self, joint: str, kind: int) -> float:
        """The position, velocity or effort of a joint."""
        states = cdr.joint_states(self._observed.last)
        arrays = states.position, states.velocity, states.effort
        return float(arrays[kind][states.names.index(joint)])

    def value(self, joint: str, kind: int) -> str:
        """The same as text."""
        return f"{('position', 'velocity', 'effort')[kind]} {self.state(joint, kind):.4g}"

    def answer(self, topic: str, message: Any, shown: Callable[[], str], wait: float = SETTLING) -> str:
        """What is shown some time after a message has been sent."""
        self.send(topic, message)
        time.sleep(wait)
        return shown()

    def refusal(self, topic: str, message: Any) -> str:
        """Why a message is rejected."""
        return "rejected: " + self.answer(topic, message, lambda: self._problem.partition(": ")[2] or "no", PERIOD)


def accepted(sender: Sender) -> Iterator[Row]:
    """Commands that are valid."""

    def by_name(text: str, joint: str, kind: int, wait: float = SETTLING, **values: float) -> Row:
        message = JointState(name=[joint], **{key: [value] for key, value in values.items()})
        return (
            "joint_commands",
            text,
            sender.answer("joint_commands", message, partial(sender.value, joint, kind), wait),
        )

    at_once = 0.2
    yield by_name("`effort` 0.5 N·m of a joint without an actuator", "plain", EFFORT, at_once, effort=0.5)
    time.sleep(1.0)
    yield "joint_commands", "nothing more, for longer than `command_timeout` (0.5 s)", sender.value("plain", EFFORT)
    yield by_name("`effort` 9 N·m, above the joint's `effort_limit` of 2 N·m", "plain", EFFORT, at_once, effort=9.0)
    topic, message = "sim_node/commands", Float64MultiArray(data=[1.0, *[0.0] * 6])
    answer = sender.answer(topic, message, partial(sender.value, "plain", EFFORT), at_once)
    yield topic, "efforts of all coordinates in order, the first 1 N·m", answer
    yield by_name("`position` 0.7 rad of a position servo", "servo", POSITION, position=0.7)
    yield by_name("`position` 3 rad, above the joint's upper limit of 1 rad", "servo", POSITION, position=3.0)
    yield by_name("`velocity` 20 rad/s of a velocity servo", "spin", VELOCITY, velocity=20.0)
    yield by_name("`velocity` 90 rad/s, above its `velocity_limit` of 50 rad/s", "spin", VELOCITY, velocity=90.0)
    yield by_name("`effort` 3 N·m of a motor with an `effort_limit` of 0.5 N·m", "limited", EFFORT, effort=3.0)
    yield by_name("`position` 0.4 m of a drive that follows commands", "rail", POSITION, position=0.4)
    names = ["plain", "servo", "spin", "rail"]
    message = JointState(name=names, position=[0.2, 0.1], velocity=[0.0, 5.0, 0.0], effort=[0.3, 0.0, 0.0])
    sender.answer("joint_commands", message, str)
    shown = (("servo", POSITION), ("spin", VELOCITY), ("rail", POSITION))
    text = "as ros2_control: four names, two positions, three velocities, three efforts, of the joints that have them"
    yield "joint_commands", text, "; ".join(sender.value(*one) for one in shown)
    yield from _of_actuators(sender)
    topic, message = "joint_trajectory", trajectory_of(["servo"], [(1, [-0.5])])
    answer = sender.answer(topic, message, partial(sender.value, "servo", POSITION), 2.0)
    yield topic, "a trajectory to -0.5 rad in 1 s, at rest there", answer
    topic, message = "sim_node/wrench/wheel", WrenchStamped(wrench=Wrench(torque=Vector3(z=0.4)))
    answer = sender.answer(topic, message, partial(sender.value, "plain", VELOCITY), 0.45)
    yield topic, "for 0.45 s a torque of 0.4 N·m on a part with the inertia 0.1 kg·m²", answer


def _of_actuators(sender: Sender) -> Iterator[Row]:
    """Commands of all channels in order, after which the valve is closed again."""
    topic, channels = "sim_node/actuator_commands", [0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 12.0, 1.5, 0.1, 0.1, 0.0]
    first = "all channels in order, among them 12 V for a DC motor with k = 0.1 N·m/A, …"
    yield topic, first, sender.answer(topic, Float64MultiArray(data=channels), lambda: sender.value("motor", VELOCITY))
    yield topic, "… 1.5 A for one with k = 0.2 N·m/A, …", sender.value("clutch", EFFORT)
    yield topic, "… and the opening 0.1 of the valve of a cylinder", sender.value("lift", VELOCITY)
    channels[8] = 0.0
    sender.send(topic, Float64MultiArray(data=channels))


def trajectory_of(joints: Sequence[str], points: Sequence[tuple[int, Sequence[float]]]) -> JointTrajectory:
    """A trajectory with velocities of zero at its points."""
    found = []
    for seconds, values in points:
        rest = [0.0] * len(values)
        found.append(
            JointTrajectoryPoint(positions=list(values), velocities=rest, time_from_start=Duration(sec=seconds))
        )
    return JointTrajectory(joint_names=list(joints), points=found)


def rejected(sender: Sender) -> Iterator[Row]:
    """Commands that are not valid."""
    cases: tuple[tuple[str, str, Any], ...] = (
        ("joint_commands", "`effort` of an unknown joint", JointState(name=["plian"], effort=[1.0])),
        ("joint_commands", "NaN", JointState(name=["plain"], effort=[math.nan])),
        ("joint_commands", "`position` of a joint without servo", JointState(name=["limited"], position=[1.0])),
        ("joint_commands", "`effort` of a drive", JointState(name=["rail"], effort=[1.0])),
        ("joint_commands", "two names, one number", JointState(name=["plain", "limited"], effort=[1.0])),
        ("sim_node/commands", "two numbers", Float64MultiArray(data=[1.0, 2.0])),
        ("sim_node/actuator_commands", "two numbers", Float64MultiArray(data=[1.0, 2.0])),
        ("joint_trajectory", "a point beyond the limits", trajectory_of(["servo"], [(1, [2.0])])),
        ("joint_trajectory", "times that do not increase", trajectory_of(["servo"], [(2, [0.1]), (1, [0.2])])),
        ("joint_trajectory", "a joint without a position servo", trajectory_of(["spin"], [(1, [0.2])])),
        ("sim_node/wrench/wheel", "an infinite force", WrenchStamped(wrench=Wrench(force=Vector3(x=math.inf)))),
        ("sim_node/set_state", "a joint that does not exist", JointState(name=["hip"], position=[1.0])),
    )
    for topic, text, message in cases:
        yield topic, text, sender.refusal(topic, message)


def of_bases() -> Iterator[Row]:
    """Velocities of a base on wheels, the shipped rover."""
    options = ["mechanism:=rover", "record:=false", "command_timeout:=2.0"]
    twist, sideways = (Twist(linear=Vector3(x=0.5, y=y), angular=Vector3(z=0.8)) for y in (0.0, 0.1))

    def speeds(sender: Sender) -> str:
        forward, yaw = (sender.state(name, VELOCITY) for name in ("ride.x", "ride.angle"))
        speed = math.hypot(forward, sender.state("ride.y", VELOCITY))
        return f"{speed:.3f} m/s, {abs(yaw):.3f} rad/s"

    with running([*options, "stamped_cmd_vel:=true"], 97) as observed:
        sender = Sender(observed)
        answer = sender.answer("cmd_vel", TwistStamped(twist=twist), partial(speeds, sender))
        yield "cmd_vel", "with `stamped_cmd_vel`, a TwistStamped: 0.5 m/s and 0.8 rad/s", answer
    with running(options, 97) as observed:
        sender = Sender(observed)
        answer = sender.answer("cmd_vel", twist, partial(speeds, sender))
        yield "cmd_vel", "a Twist: 0.5 m/s and 0.8 rad/s", answer
        yield "cmd_vel", "a velocity to the side", sender.refusal("cmd_vel", sideways)
        time.sleep(1.0)
        yield "cmd_vel", "nothing more, for longer than `command_timeout` (here 2 s)", speeds(sender)


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bench.yaml").write_text(BENCH, encoding="utf-8")
        with running([f"mechanism:={folder}/bench.yaml", "record:=false", "publish_rate:=200.0"]) as observed:
            sender = Sender(observed)
            rows = [*accepted(sender), *rejected(sender)]
    rows += of_bases()
    print("| topic | command | answer |\n|---|---|---|")
    for topic, text, answer in rows:
        print(f"| `{topic.replace('sim_node', '~')}` | {text} | {answer} |")


if __name__ == "__main__":
    main()
