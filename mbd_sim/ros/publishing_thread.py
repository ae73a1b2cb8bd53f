"""What leaves the node: each message is serialized once, then published, recorded and shown.

Runs in a thread of its own, so that neither DDS nor a disk nor a viewer is ever waited for by the stepping thread.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from queue import SimpleQueue

from rclpy.node import Node
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import MarkerArray

from mbd_sim.recording.recorder import Recorder
from mbd_sim.recording.run_metadata import Moment
from mbd_sim.recording.topic import Topic
from mbd_sim.ros import qos, state_messages
from mbd_sim.ros.markers import Markers
from mbd_sim.ros.message_template import STAMP, Template
from mbd_sim.ros.node_recordings import Recordings
from mbd_sim.ros.publisher import Output
from mbd_sim.ros.snapshots import Item, Snapshot
from mbd_sim.ros.transforms import transforms
from mbd_sim.simulation.compiled_model import Energies, Model
from mbd_sim.simulation.events import ERRORS, AppliedEfforts, AppliedWrench, ChangedValues, Event, EventKind
from mbd_sim.simulation.wrench_layout import wrench_labels
from mbd_sim.urdf.export import to_urdf
from mbd_sim.viewer import Viewer

LATCHED = ("robot_description", "live_values")  # topics whose last message each file of a recording begins with


@dataclass(frozen=True)
class Wanted:
    """What is told of a state besides joints and energies; `poses` are names of parts, `frame_prefix` is of frames."""

    reactions: bool = False
    violation: bool = False
    poses: tuple[str, ...] = ()
    tf: bool = False
    marker_rate: float = 0.0
    frame_prefix: str = ""


class Outputs:
    """All outputs of a node, fed with snapshots and events."""

    def __init__(self, node: Node, model: Model, wanted: Wanted) -> None:
        """Create the topics.

        :raises ImportError: `wanted.tf` without tf2_msgs.
        """
        self.model, self.wanted = model, wanted
        self.recordings: Recordings | None = None
        self.viewer: Viewer | None = None
        self.energies: Energies | None = None
        self.latest: Snapshot | None = None
        self.busy = 0.0
        self._log = node.get_logger()
        self._energies = state_messages.energies(node, model)
        self._tellings = {"joint_states": state_messages.joint_states(node, model), "energies": self._energies}
        if wanted.reactions:
            self._tellings["reactions"] = state_messages.joint_reactions(node, model, wanted.frame_prefix)
        if wanted.violation:
            self._tellings["violation"] = state_messages.constraint_violation(node, model)
        for number, pose in enumerate(state_messages.part_poses(node, model, wanted.poses, wanted.frame_prefix)):
            self._tellings[f"pose {number}"] = pose
        self._outputs = {key: telling.output for key, telling in self._tellings.items()} | {
            "applied_efforts": Output(node, Float64MultiArray, "~/applied_efforts", qos.COMMAND, vital=True),
            "applied_wrenches": Output(node, Float64MultiArray, "~/applied_wrenches", qos.COMMAND, vital=True),
            "live_values": Output(node, Float64MultiArray, "~/live_values", qos.LATCHED, vital=True),
            "events": Output(node, String, "~/events", qos.LATCHED, vital=True),
            "robot_description": Output(node, String, "robot_description", qos.LATCHED, vital=True),
        }
        self._tf = transforms(node, model, wanted.frame_prefix) if wanted.tf else None
        self._clock = node.create_publisher(Clock, "/clock", qos.CLOCK)
        self._clock_message = Template(Clock(clock=STAMP))
        self._efforts, self._effort_values = state_messages.labelled(model.coordinate_names)
        self._wrenches = {part: state_messages.labelled(wrench_labels(part)) for part in model.equations.inputs.loaded}
        self._marker_output = node.create_publisher(MarkerArray, "markers", qos.STATE)
        self._markers: Markers | None = None
        self._marker_due = 0.0
        self._thread: threading.Thread | None = None

    @property
    def thread_id(self) -> int:
        """The system's number of the thread, 0 before it has started."""
        return (self._thread.native_id if self._thread else 0) or 0

    def topics(self) -> dict[str, Topic]:
        """What a recorder needs to know of the topics."""
        return {key: output.topic for key, output in self._outputs.items()}

    @property
    def recorder(self) -> Recorder | None:
        """What writes the recording, or wrote the last one."""
        return self.recordings.recorder if self.recordings else None

    def start(self, queue: SimpleQueue[Item], live: Mapping[str, float]) -> None:
        """Publish the robot's description and live values, then what comes from the queue until it gives None."""
        description = serialize_message(String(data=to_urdf(self.model.mechanism)))
        self._send("robot_description", description, 0, 0)
        self._send_live(live, 0, 0)
        self._thread = threading.Thread(target=self._run, args=(queue,), name="outputs", daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Wait until the queue has been worked off, then finish the recording and the viewer."""
        if self._thread is not None:
            self._thread.join()
        for sink in (self.recordings, self.viewer):
            if sink is not None:
                sink.close()

    def _run(self, queue: SimpleQueue[Item]) -> None:
        while (item := queue.get()) is not None:
            began = time.perf_counter()
            try:
                if isinstance(item, Snapshot):
                    self._snapshot(item)
                elif isinstance(item, Moment):
                    if self.recordings is not None:
                        self.recordings.at(item)
                else:
                    self._event(item)
            except Exception as error:  # one bad message must not end all output
                self._log.error(f"output failed: {error!r}", throttle_duration_sec=1.0)
            self.busy += time.perf_counter() - began

    def _snapshot(self, snapshot: Snapshot) -> None:
        if snapshot.clock:
            self._clock_message.stamp(snapshot.clock_ns)
            self._clock.publish(self._clock_message.payload())
        self.latest = snapshot
        if not snapshot.state:
            return
        for key, (_, template, write) in self._tellings.items():
            told = write(snapshot)
            template.stamp(snapshot.clock_ns)
            self._send(key, template.payload(), snapshot.clock_ns, snapshot.ticks, recorded=not snapshot.repeated)
            if isinstance(told, Energies):
                self.energies = told
        if self._tf is not None:
            self._tf.write(snapshot)
            self._tf.template.stamp(snapshot.clock_ns)
            self._tf.output.publisher.publish(self._tf.template.payload())
        self._mark(snapshot)
        if self.recordings is not None:
            self.recordings.look(snapshot.clock_ns)
        if self.viewer is not None and self.energies is not None and not snapshot.repeated:
            self.viewer.offer(snapshot.clock_ns * 1e-9, snapshot.y, snapshot.inputs, self.energies, snapshot.time)

    def _mark(self, snapshot: Snapshot) -> None:
        """Publish markers where they are due and somebody listens."""
        rate, now = self.wanted.marker_rate, snapshot.clock_ns * 1e-9
        if not rate or (abs(now - self._marker_due) < 1.0 / rate - 1e-9 and not snapshot.repeated):
            return
        self._marker_due = now
        if self._marker_output.get_subscription_count():
            if self._markers is None:
                self._markers = Markers(self.model, self.wanted.frame_prefix)
            self._marker_output.publish(self._markers.payload(snapshot))

    def _event(self, event: Event) -> None:
        match event.payload:
            case AppliedEfforts(values):
                self._effort_values[:] = values
                self._send("applied_efforts", self._efforts.payload(), event.clock_ns, event.ticks)
            case AppliedWrench(part, inputs):
                template, numbers = self._wrenches[part]
                numbers[:] = inputs
                self._send("applied_wrenches", template.payload(), event.clock_ns, event.ticks)
            case ChangedValues(_, all_values) if all_values is not None:
                self._send_live(all_values, event.clock_ns, event.ticks)
        if self.viewer is not None:
            self.viewer.event(event.clock_ns * 1e-9, event)
        if event.kind is EventKind.COMMAND:  # its numbers are published; its text would say nothing more
            return
        text = event.text
        self._send("events", serialize_message(String(data=text)), event.clock_ns, event.ticks)
        # Two calls, on two lines: rclpy allows a line of code one severity only.
        if event.kind in ERRORS:
            self._log.error(text)
        elif event.kind is EventKind.WARNING:
            self._log.warning(text)
        else:
            self._log.info(text)

    def _send_live(self, live: Mapping[str, float], time_ns: int, ticks: int) -> None:
        template, values = state_messages.labelled(list(live))
        values[:] = list(live.values())
        self._send("live_values", template.payload(), time_ns, ticks)

    def _send(self, key: str, payload: bytes, time_ns: int, ticks: int, *, recorded: bool = True) -> None:
        self._outputs[key].publisher.publish(payload)
        if self.recordings is not None and recorded:
            self.recordings.put(key, payload, time_ns, ticks, latched=key in LATCHED)
