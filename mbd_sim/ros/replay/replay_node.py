"""`ros2 run mbd_sim replay_node --ros-args -p bag:=RUN.mcap`: publishes a recording's topics again."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

from rclpy.clock import Clock as NodeClock
from rclpy.clock import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from mbd_sim.base.errors import InputError, counted, listed
from mbd_sim.recordings.messages.cdr import Message, RecordedTopic
from mbd_sim.recordings.run.reader import Recording, open_recording
from mbd_sim.ros.node.parameters import NodeParameters, ParameterSpec, program_help
from mbd_sim.ros.node.program import run_node
from mbd_sim.ros.publishing import publishers
from mbd_sim.ros.publishing.publishers import STAMP, MessageTemplate, message_type
from mbd_sim.ros.replay.player import Player
from mbd_sim.ros.stepping import realtime

PARAMETERS = (
    ParameterSpec("bag", "", "the recording: an .mcap or .db3 file, or a rosbag2 folder"),
    ParameterSpec("rate", 1.0, "1: as recorded; 2: twice as fast; 0: as fast as possible", 0.0, 1000.0, live=True),
    ParameterSpec("start", 0.0, "where to start, in s after the first message", 0.0, 1e9),
    ParameterSpec("end", 0.0, "where to end, in s after the first message; 0: at the end of the recording", 0.0, 1e9),
    ParameterSpec("loop", False, "restart at the end", live=True),
    ParameterSpec("stay", False, "pause at the end instead of exiting", live=True),
    ParameterSpec("start_paused", False, "wait for ~/pause, ~/step or ~/seek before the first message"),
    ParameterSpec(
        "delay", 0.0, "s until the first message, in which subscribers find the topics; ~/pause ends it", 0.0, 1e6
    ),
    ParameterSpec("clock_rate", 200.0, "/clock messages per recorded second; 0: none", 0.0, 100_000.0),
    ParameterSpec("seek_to", 0.0, "target of ~/seek, in s after the first message", 0.0, 1e9, live=True),
    ParameterSpec("real_time_priority", 20, "SCHED_FIFO priority of the playing thread, if permitted; 0: none", 0, 90),
    ParameterSpec("step_count", 1, "how many time stamps one call of ~/step advances", 1, 1_000_000, live=True),
)
EXAMPLE = "bag:=RUN.mcap"
PUBLISHED = (
    ("/clock", "rosgraph_msgs/msg/Clock: the recorded time, at clock_rate"),
    ("all recorded topics", "with their recorded types and quality of service"),
)
SERVICES = (
    ("~/pause", "std_srvs/srv/SetBool: pause (true) or resume"),
    ("~/step", "std_srvs/srv/Trigger: while paused, publish all messages with the next step_count time stamps"),
    ("~/seek", "std_srvs/srv/Trigger: jump to the time seek_to"),
)
THREADS_BY_PRIORITY = ("player", "reader", "executor")


CLOCK = "/clock"
UNPUBLISHABLE = (ImportError, AttributeError, ValueError, LookupError, InvalidTopicNameException)
ACKNOWLEDGMENT_TIMEOUT = Duration(seconds=2)  # for the last messages to reach their subscribers


class ReplayPublishers:
    """Publishes recorded messages unchanged.

    Topic names are relative to the node's namespace and can be remapped. `/clock` is computed from the recorded
    times, unless it has been recorded. `skipped` holds the topics that are not published, with the reasons.
    """

    def __init__(
        self, node: Node, recording: Recording, on_warning: Callable[[str], None], on_end: Callable[[], None]
    ) -> None:
        self.skipped: dict[str, str] = {}
        self.latched: list[str] = []
        self.publishers: dict[str, Publisher] = {}
        self.warn, self.end = on_warning, on_end
        self._log = node.get_logger()
        self._handles = ExitStack()
        self._publish: dict[str, Callable[[bytes], None]] = {}
        for name, topic in recording.topics.items():
            try:
                self._add(node, topic)
            except UNPUBLISHABLE as error:
                self.skipped[name] = f"{topic.type or 'its type'} cannot be published here ({error})"
        self.clock_recorded = CLOCK in self.publishers
        self._publish_clock: Callable[[bytes], None] | None = None
        if not self.clock_recorded:
            self._publish_clock = self._raw_publish(node.create_publisher(Clock, CLOCK, publishers.CLOCK))
        self._clock_message = MessageTemplate(Clock(clock=STAMP))

    def inform(self, text: str) -> None:
        """Log something that is not a problem."""
        self._log.info(text)

    def clock(self, time_ns: int) -> None:
        """Publish a time in ns on /clock."""
        if self._publish_clock is not None:
            self._clock_message.stamp(time_ns)
            self._publish_clock(self._clock_message.payload())

    def publish(self, message: Message) -> None:
        """Publish a recorded message."""
        publish = self._publish.get(message.topic)
        if publish is not None:
            publish(message.payload)

    def close(self) -> None:
        """Wait until the subscribers have received everything, and release the publishers."""
        for publisher in self.publishers.values():
            reliable = publisher.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
            if reliable and publisher.get_subscription_count():
                publisher.wait_for_all_acked(ACKNOWLEDGMENT_TIMEOUT)
        self._publish.clear()
        self._publish_clock = None
        self._handles.close()

    def _add(self, node: Node, topic: RecordedTopic) -> None:
        if topic.encoding != "cdr":
            raise ValueError(f"encoded as '{topic.encoding}'")
        profile = publishers.profile_of(topic.qos)
        name = topic.name if topic.name == CLOCK else topic.name.lstrip("/")
        publisher = node.create_publisher(message_type(topic.type), name, profile)
        self.publishers[topic.name] = publisher
        self._publish[topic.name] = self._raw_publish(publisher)
        if profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL:
            self.latched.append(topic.name)

    def _raw_publish(self, publisher: Publisher) -> Callable[[bytes], None]:
        """A publisher's function for serialized messages.

        `Publisher.publish` enters the publisher's handle for each message; entering it once halves the cost.
        """
        self._handles.enter_context(publisher.handle)
        publish: Callable[[bytes], None] = publisher.handle.publish_raw
        return publish


class ReplayNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Publishes a recording's topics in time, with their own types and QoS, and `/clock`."""

    def __init__(self, end: Callable[[], None]) -> None:
        """Open the recording; `end` is called at its end.

        :raises MbdSimError, ValueError: the recording cannot be played, or a parameter does not fit it.
        """
        super().__init__("replay_node")
        parameters = self.parameters = NodeParameters(self, PARAMETERS, self._on_parameter_change)
        unknown = parameters.finish()
        if not parameters["bag"]:
            raise InputError("no recording is given", "Give one: --ros-args -p bag:=RUN.mcap")
        self.recording = open_recording(parameters["bag"])
        self.output = ReplayPublishers(self, self.recording, self._warn, end)
        self.player = Player(
            self.recording,
            self.output,
            rate=parameters["rate"],
            start=parameters["start"],
            end=parameters["end"],
            loop=parameters["loop"],
            stay=parameters["stay"],
            paused=parameters["start_paused"] or parameters["delay"] > 0.0,
            clock_rate=0.0 if self.output.clock_recorded else parameters["clock_rate"],
            latched=self.output.latched,
            on_threads_started=self._prioritize,
        )
        if parameters["start"] > self.player.duration:
            start, duration = parameters["start"], self.player.duration
            raise ValueError(f"start is {start:g} s, but the recording lasts only {duration:g} s")
        if 0.0 < parameters["end"] < parameters["start"]:
            raise ValueError(f"end is {parameters['end']:g} s, before start, {parameters['start']:g} s")
        self._delay: Timer | None = None
        self._warn_of_gaps(unknown)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/step", self._on_step)
        self.create_service(Trigger, "~/seek", self._on_seek)

    def start(self) -> None:
        """Start to play."""
        delay, how = self.parameters["delay"], "playing"
        if self.player.paused:
            how = "paused" if self.parameters["start_paused"] else f"playing in {delay:g} s"
        count = sum(topic.count for topic in self.recording.topics.values())
        self.get_logger().info(
            f"{how}: {self.recording.path}, {counted(count, 'message')} on "
            f"{counted(len(self.output.publishers), 'topic')} in {self.player.duration:.6g} s"
        )
        self._start_time = time.perf_counter()
        self.player.start()
        if delay and not self.parameters["start_paused"]:
            self._delay = self.create_timer(
                delay, self._on_delay_over, clock=NodeClock(clock_type=ClockType.STEADY_TIME)
            )

    def stop(self) -> None:
        """Stop; when this returns, everything published has been delivered, or had time for it."""
        self.player.stop()
        duration = time.perf_counter() - self._start_time
        self.output.close()
        self.get_logger().info(
            f"played {counted(self.player.played, 'message')} in {duration:.3g} s, up to t = {self.player.time:.9g} s; "
            f"{self.player.lateness.summary().in_words()}; {counted(self.player.overruns, 'overrun')}"
        )

    def _warn_of_gaps(self, unknown_parameters: Sequence[str]) -> None:
        if unknown_parameters:
            self._warn(f"unknown parameters are ignored: {listed(unknown_parameters)}")
        for problem in self.recording.problems:
            self._warn(f"{problem}. The rest is played.")
        for name, reason in self.output.skipped.items():
            self._warn(f"{name} is not played: {reason}")

    def _prioritize(self) -> None:
        """Request real-time priority, except when playing as fast as possible: that would starve the machine."""
        priority = self.parameters["real_time_priority"] if self.parameters["rate"] > 0.0 else 0
        if self.parameters["real_time_priority"] and (refusal := realtime.prioritize(priority, THREADS_BY_PRIORITY)):
            self.get_logger().info(refusal, once=True)

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text)

    def _on_delay_over(self) -> None:
        self._end_delay()
        self.player.pause(False)

    def _end_delay(self) -> None:
        if self._delay is not None:
            self._delay.cancel()
            self._delay = None

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._end_delay()
        self.player.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "playing"
        return response

    def _on_step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.player.step(self.parameters["step_count"])
        response.success, response.message = not problem, problem or "stepped"
        return response

    def _on_seek(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.player.seek(self.parameters["seek_to"])
        response.success, response.message = not problem, problem or f"at t = {self.parameters['seek_to']:g} s"
        return response

    def _on_parameter_change(self, name: str, value: Any) -> None:
        match name:
            case "rate":
                self.player.set_rate(value)
                self._prioritize()
            case "loop":
                self.player.loop = value
            case "stay":
                self.player.stay = value


def _make_node(end: Callable[[], None]) -> ReplayNode:
    node = ReplayNode(end)
    realtime.freeze_memory()
    return node


def main(arguments: Sequence[str] | None = None) -> int:
    """Play until the end, or until SIGINT or SIGTERM."""
    return run_node("replay_node", _make_node, arguments, example=EXAMPLE, help_text=help_text)


def help_text() -> str:
    """What `--help` prints."""
    sections = {"published topics": PUBLISHED, "services": SERVICES}
    return program_help("replay_node", "Replays the topics of a recording.", EXAMPLE, PARAMETERS, sections)


if __name__ == "__main__":
    sys.exit(main())
