"""The thread that publishes: each message is serialized once, then published, recorded and shown.

It decouples the stepping thread from DDS, disks and viewers, so that stepping never waits for any of them. If it cannot
keep up in real time, it leaves out states, markers and samples for the viewer, so that those that it publishes are new.
If measurements alone take all of its time, it publishes the newest state out of turn, so that controllers still get
some; this state is recorded in its turn.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from queue import SimpleQueue
from typing import TYPE_CHECKING

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from mbd_sim.recordings.messages import topics
from mbd_sim.recordings.messages.definitions import Topic
from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.recordings.messages.topics import OutputTopic, Recorded, SensorSerializer
from mbd_sim.recordings.run.recorder import Recorder
from mbd_sim.ros.publishing.markers import Markers
from mbd_sim.ros.publishing.publishers import STAMP, MessageTemplate, TopicPublisher
from mbd_sim.ros.publishing.recordings import NodeRecordings
from mbd_sim.ros.publishing.ring import NodeRing
from mbd_sim.ros.stepping.output import Item, SteppingOutput
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import Energies
from mbd_sim.simulation.run.events import ERRORS, Event, EventKind

if TYPE_CHECKING:
    from mbd_sim.pictures.rerun.viewer import Viewer


PATIENCE = 1.0  # s by which publishing may be late, as after a stall of the machine, before states are left out
IMPATIENCE = 0.02  # s, the same until that long none has been left out
STARVED = 0.1  # s without a state, after which the newest one is published out of turn


_Sink = Callable[[str, bytes, int, int, bool], None]  # of a message: its topic, payload, time in ns, ticks, repetition


class PublishingThread:
    """Publishes, records and shows the snapshots and events that the stepping thread emits.

    `age` is that of the last state in s when it was published, in real time, and `left_out` the number of states that
    were not published because a newer one was waiting.
    """

    def __init__(
        self,
        node: Node,
        model: Model,
        requested: Sequence[OutputTopic],
        *,
        frame_prefix: str = "",
        clock: bool = True,
        step_size: float | None = None,
    ) -> None:
        """Create the publishers of the requested topics, of the markers, and with `clock` that of `/clock`.

        :param step_size: in s, of the simulation whose sensors are published; by default that of the file.

        :raises ImportError: the package of a message type is not installed.
        """
        self.model = model
        self.recordings: NodeRecordings | None = None
        self.ring: NodeRing | None = None
        self.viewers: tuple[Viewer, ...] = ()
        self.energies: Energies | None = None
        self.latest: Snapshot | None = None
        self.busy = self.age = 0.0  # s; spent in publishing
        self.left_out = 0
        self._left_out_at = self._stated_at = -math.inf  # s of the steady clock; the last state was published then
        self._ahead: deque[Snapshot] = deque()  # published out of turn, and still in the queue
        self._output: SteppingOutput | None = None
        self._log = node.get_logger()
        self._topics = {topic.name: TopicPublisher(node, topic) for topic in requested}
        self._state_writers = {t.name: t.on_state(model, frame_prefix) for t in requested if t.on_state is not None}
        self._event_writers = {t.name: t.on_event(model) for t in requested if t.on_event is not None}
        self._sensors = SensorSerializer(model, step_size or model.mechanism.step, frame_prefix)
        self._node, self._clock_lock = node, threading.Lock()
        self._clock: TopicPublisher | None = None
        self.publish_clock(clock)
        self._clock_message = MessageTemplate(Clock(clock=STAMP))
        self._marker_publisher = TopicPublisher(node, topics.MARKERS).publisher
        self._frame_prefix = frame_prefix
        self._markers: Markers | None = None
        self._thread: threading.Thread | None = None

    @property
    def thread_id(self) -> int:
        """The system's id of the thread, 0 before it has started."""
        return (self._thread.native_id if self._thread else 0) or 0

    def publish_clock(self, publish: bool) -> None:
        """Create or destroy the publisher of `/clock`, from any thread."""
        with self._clock_lock:
            if publish and self._clock is None:
                self._clock = TopicPublisher(self._node, topics.CLOCK)
            elif not publish and self._clock is not None:
                self._node.destroy_publisher(self._clock.publisher)
                self._clock = None

    @property
    def publishes_clock(self) -> bool:
        """Whether there is a publisher of `/clock`."""
        return self._clock is not None

    def recorded_topics(self) -> dict[str, Topic]:
        """The topics that are recorded, for a recorder."""
        return {
            name: publisher.recorded_topic()
            for name, publisher in self._topics.items()
            if publisher.topic.recorded is not Recorded.NO
        }

    @property
    def recorder(self) -> Recorder | None:
        """The recorder of the present recording, or of the last one."""
        return self.recordings.recorder if self.recordings else None

    def prepare(self, snapshot: Snapshot) -> None:
        """Derive, compile and import everything that messages of a state need: none of it happens in the run."""
        model = self.model
        energies = model.energies(
            snapshot.time, snapshot.point.state, snapshot.point.start_energy, snapshot.point.inputs
        )
        for writer in self._state_writers.values():
            writer.payload(snapshot, energies)
        if model.row_names:
            model.violation(*snapshot.now)  # for the diagnostics
        self._sensors.prepare(snapshot.point.state, snapshot.point.inputs)
        self._markers = Markers(model, self._frame_prefix)
        self._markers.payload(snapshot)

    def start(self, output: SteppingOutput, live: Mapping[str, float]) -> None:
        """Publish the first messages, with the given live values; then start to publish from the queue until None."""
        self._output = output
        for name, publisher in self._topics.items():
            if publisher.topic.at_start is not None:
                self._send(name, publisher.topic.at_start(self.model, live), 0, 0)
        self._thread = threading.Thread(target=self._run, args=(output.queue,), name="outputs", daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Wait until the queue is empty, then finish the recording and close the viewer."""
        if self._thread is not None:
            self._thread.join()
        for sink in (self.recordings, *self.viewers):
            if sink is not None:
                sink.close()

    def _run(self, queue: SimpleQueue[Item]) -> None:
        while (item := queue.get()) is not None:
            began = time.perf_counter()
            try:
                if isinstance(item, Event):
                    self._publish_event(item)
                elif Due.RECORDING not in item.due:
                    self._publish_snapshot(item)
                elif self.recordings is not None:
                    self.recordings.at_moment(item)
            except Exception as error:  # one bad message must not end all output
                self._log.error(f"publishing failed: {error!r}", throttle_duration_sec=1.0)
            self.busy += time.perf_counter() - began

    def _publish_snapshot(self, snapshot: Snapshot) -> None:
        if Due.CLOCK in snapshot.due:
            self._clock_message.stamp(snapshot.clock_ns)
            with self._clock_lock:
                if self._clock is not None:
                    self._clock.publisher.publish(self._clock_message.payload())
        self.latest = snapshot
        if self._ahead and snapshot is self._ahead[0]:
            self._ahead.popleft()
            self._write_state(snapshot, self._record)
            snapshot = _without_state(snapshot)
        elif self._is_outdated(snapshot):
            self.left_out += 1
            self._publish_newest()
            snapshot = _without_state(snapshot)
        if Due.STATE in snapshot.due or Due.VIEW in snapshot.due:
            self._publish_state(snapshot)
        for one in self._sensors.measured(snapshot.arrivals, snapshot.clock_ns):
            self._send(one.topic, one.payload, snapshot.clock_ns, snapshot.ticks)
            for viewer in self.viewers:
                viewer.measure(snapshot.clock_ns * 1e-9, one.sensor, one.reading)
        if Due.MARKERS in snapshot.due:
            self._publish_markers(snapshot)
        if self.recordings is not None:
            self.recordings.check_limits(snapshot.clock_ns)

    def _is_outdated(self, snapshot: Snapshot) -> bool:
        """Whether the state is so old that it is left out, because a newer one waits."""
        if Due.STATE not in snapshot.due:
            return False
        now = time.perf_counter()
        age = max(0.0, now - snapshot.taken)
        patience = IMPATIENCE if now - self._left_out_at < PATIENCE else PATIENCE
        newest = self._output.newest if self._output is not None else None
        if self._ahead or (age > patience and newest is not None and newest.ticks > snapshot.ticks):
            self._left_out_at = now
            return True
        self.age = age
        return False

    def _publish_newest(self) -> None:
        """Publish the newest state out of turn, if none has been published for long."""
        now, newest = time.perf_counter(), self._output.newest if self._output is not None else None
        if newest is None or now - self._stated_at < STARVED or (self._ahead and newest is self._ahead[-1]):
            return
        self._ahead.append(newest)
        self._stated_at, self.age = now, max(0.0, now - newest.taken)
        self._write_state(newest, self._publish)

    def _publish_state(self, snapshot: Snapshot) -> None:
        """Publish, record and show the state, as far as each of them is due."""
        energies = self._energies(snapshot)
        if Due.STATE in snapshot.due:
            self._stated_at = time.perf_counter()
            self._write_state(snapshot, self._publish, self._record, energies=energies)
        if Due.VIEW in snapshot.due:
            point = snapshot.point
            for viewer in self.viewers:
                viewer.offer(snapshot.clock_ns * 1e-9, point.state, point.inputs, energies, snapshot.time)

    def _energies(self, snapshot: Snapshot) -> Energies:
        point = snapshot.point
        self.energies = self.model.energies(snapshot.time, point.state, point.start_energy, point.inputs)
        return self.energies

    def _write_state(self, snapshot: Snapshot, *sinks: _Sink, energies: Energies | None = None) -> None:
        """Write the messages of a state, each for all of the sinks."""
        energies = energies or self._energies(snapshot)
        for name, writer in self._state_writers.items():
            payload = writer.payload(snapshot, energies)
            for sink in sinks:
                sink(name, payload, snapshot.clock_ns, snapshot.ticks, snapshot.repeated)

    def _publish_markers(self, snapshot: Snapshot) -> None:
        """Publish markers if there is a subscriber."""
        if self._marker_publisher.get_subscription_count():
            assert self._markers is not None
            self._marker_publisher.publish(self._markers.payload(snapshot))

    def _publish_event(self, event: Event) -> None:
        for viewer in self.viewers:
            viewer.event(event.clock_ns * 1e-9, event)
        for name, write in self._event_writers.items():
            payload = write(event)
            if payload is not None:
                self._send(name, payload, event.clock_ns, event.ticks)
        if event.kind is EventKind.RESET:
            for publisher in self._topics.values():
                if publisher.topic.at_reset is not None:
                    publisher.publisher.publish(publisher.topic.at_reset(self.model))
        # A call on a line of its own for each severity: rclpy allows one severity for each line of code.
        if event.kind in ERRORS:
            self._log.error(event.text)
        elif event.kind is EventKind.WARNING:
            self._log.warning(str(event.payload))  # the severity says that it is a warning
        elif event.kind not in (EventKind.COMMAND, EventKind.NEW_STATE):  # which may come with each move of a hand
            self._log.info(event.text)

    def _send(self, name: str, payload: bytes, time_ns: int, ticks: int) -> None:
        """Publish and record a message."""
        self._publish(name, payload, time_ns, ticks)
        self._record(name, payload, time_ns, ticks)

    def _publish(self, name: str, payload: bytes, time_ns: int, ticks: int, repeated: bool = False) -> None:
        self._topics[name].publisher.publish(payload)

    def _record(self, name: str, payload: bytes, time_ns: int, ticks: int, repeated: bool = False) -> None:
        """Record a message, unless it repeats the last one."""
        recorded = self._topics[name].topic.recorded
        if recorded is Recorded.NO or repeated:
            return
        for sink in (self.recordings, self.ring):
            if sink is not None:
                sink.put(name, payload, time_ns, ticks, in_each_file=recorded is Recorded.EACH_FILE)


def _without_state(snapshot: Snapshot) -> Snapshot:
    return replace(snapshot, due=snapshot.due & (Due.CLOCK | Due.SENSORS))
