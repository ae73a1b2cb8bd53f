"""What leaves the node: each message is made and serialized once, then published, recorded and shown.

Runs in a thread of its own, so that neither DDS nor a disk nor a viewer is ever waited for by the stepping thread.
"""

from __future__ import annotations

import array
import threading
from queue import SimpleQueue
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout, String

from mbd_sim.mechanism.urdf import to_urdf
from mbd_sim.model import Energies, Model
from mbd_sim.recording.recorder import Recorder, Topic
from mbd_sim.ros import qos
from mbd_sim.ros.runner import Event, Snapshot
from mbd_sim.viewer import Viewer

ERRORS = ("diverged", "failed")  # what events begin with that are errors
WARNING = "warning"  # and what those begin with that warn


class Output:
    """A topic: published, and recorded where `recorded`."""

    def __init__(self, node: Node, message_type: type, name: str, profile: QoSProfile, *, vital: bool = False) -> None:
        self.publisher = node.create_publisher(message_type, name, profile)
        package, _, kind = message_type.__module__.partition(".msg")[0], "", message_type.__name__
        self.topic = Topic(self.publisher.topic_name, f"{package}/msg/{kind}", qos.offered_qos_profiles(profile), vital)


class Outputs:
    """All outputs of a node, fed with snapshots and events."""

    def __init__(self, node: Node, model: Model) -> None:
        self.model = model
        self.recorder: Recorder | None = None
        self.viewer: Viewer | None = None
        self.energies: Energies | None = None
        self._log = node.get_logger()
        self._outputs = {
            "joint_states": Output(node, JointState, "joint_states", qos.STATE),
            "energies": Output(node, Float64MultiArray, "energies", qos.STATE),
            "applied_efforts": Output(node, Float64MultiArray, "~/applied_efforts", qos.COMMAND, vital=True),
            "events": Output(node, String, "~/events", qos.LATCHED, vital=True),
            "robot_description": Output(node, String, "robot_description", qos.LATCHED, vital=True),
        }
        self._clock = node.create_publisher(Clock, "/clock", qos.CLOCK)
        self._joints = JointState(name=[*model.coordinate_names, *model.driven_names])
        self._audit = Float64MultiArray(layout=_layout(Energies._fields))
        self._efforts = Float64MultiArray(layout=_layout(model.coordinate_names))
        self._thread: threading.Thread | None = None

    def topics(self) -> dict[str, Topic]:
        """What a recorder needs to know of the topics."""
        return {key: output.topic for key, output in self._outputs.items()}

    def bytes_per_second(self, rate: float) -> float:
        """Roughly what is recorded at a publish rate in Hz."""
        per_message = len(serialize_message(self._joints)) + 24 * len(self._joints.name)
        return rate * (per_message + len(serialize_message(self._audit)) + 8 * len(Energies._fields) + 62)

    def start(self, queue: SimpleQueue[Snapshot | Event | None]) -> None:
        """Publish the robot's description, then what comes from the queue until it gives None."""
        self._send("robot_description", String(data=to_urdf(self.model.mechanism)), 0, 0)
        self._thread = threading.Thread(target=self._run, args=(queue,), name="outputs", daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Wait until the queue has been worked off, then finish the recording and the viewer."""
        if self._thread is not None:
            self._thread.join()
        for sink in (self.recorder, self.viewer):
            if sink is not None:
                sink.close()

    def _run(self, queue: SimpleQueue[Snapshot | Event | None]) -> None:
        while (item := queue.get()) is not None:
            try:
                if isinstance(item, Snapshot):
                    self._snapshot(item)
                else:
                    self._event(item)
            except Exception as error:  # one bad message must not end all output
                self._log.error(f"output failed: {error!r}", throttle_duration_sec=1.0)

    def _snapshot(self, snapshot: Snapshot) -> None:
        stamp = _stamp(snapshot.clock_ns)
        if snapshot.clock:
            self._clock.publish(Clock(clock=stamp))
        if not snapshot.state:
            return
        model, y = self.model, snapshot.y
        joints = self._joints
        joints.header.stamp = stamp
        rows = [model.coordinates(y), y[model.u_range], snapshot.efforts]
        if model.driven_names:
            drives = model.drives(snapshot.time, y, snapshot.efforts)
            rows = [np.concatenate([row, driven]) for row, driven in zip(rows, drives, strict=True)]
        joints.position, joints.velocity, joints.effort = (_doubles(row) for row in rows)
        if snapshot.repeated:
            self._outputs["joint_states"].publisher.publish(joints)
            return
        self._send("joint_states", joints, snapshot.clock_ns, snapshot.ticks)
        energies = model.energies(snapshot.time, y, snapshot.start_energy)
        self._audit.data = array.array("d", energies)
        self._send("energies", self._audit, snapshot.clock_ns, snapshot.ticks)
        self.energies = energies
        if self.viewer is not None:
            self.viewer.offer(snapshot.clock_ns * 1e-9, y, snapshot.efforts, energies, snapshot.time)

    def _event(self, event: Event) -> None:
        if event.efforts is not None:
            self._efforts.data = _doubles(event.efforts)
            self._send("applied_efforts", self._efforts, event.clock_ns, event.ticks)
        if event.text != "command":
            self._send("events", String(data=event.text), event.clock_ns, event.ticks)
            # Two calls, on two lines: rclpy allows a line of code one severity only.
            if event.text.startswith(ERRORS):
                self._log.error(event.text)
            elif event.text.startswith(WARNING):
                self._log.warning(event.text)
            else:
                self._log.info(event.text)
            if self.viewer is not None:
                self.viewer.event(event.clock_ns * 1e-9, event.text)

    def _send(self, key: str, message: object, time_ns: int, ticks: int) -> None:
        payload = serialize_message(message)
        self._outputs[key].publisher.publish(payload)
        if self.recorder is not None:
            self.recorder.put(key, payload, time_ns, ticks)
            if self.recorder.failure:
                self._log.error(f"{self.recorder.failure}. The simulation goes on.", once=True)


def _layout(labels: tuple[str, ...]) -> MultiArrayLayout:
    return MultiArrayLayout(dim=[MultiArrayDimension(label=label, size=1, stride=1) for label in labels])


def _stamp(nanoseconds: int) -> Time:
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def _doubles(values: Any) -> array.array[float]:
    return array.array("d", values.tobytes())
