"""`ros2 run mbd_sim replay_node --ros-args -p bag:=RUN.mcap`: a recording as topics again."""

from __future__ import annotations

import gc
import signal
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool, Trigger

from mbd_sim.errors import MbdSimError, listed
from mbd_sim.recording.reader import open_recording
from mbd_sim.ros import realtime
from mbd_sim.ros.node_parameters import Declared, Parameters
from mbd_sim.ros.replay_player import Player
from mbd_sim.ros.replay_publishers import ReplayTopics

PARAMETERS = (
    Declared("bag", "", "the recording: an .mcap or .db3 file, or a folder of rosbag2"),
    Declared("rate", 1.0, "1: as recorded; 2: twice as fast; 0: as fast as possible", 0.0, 1000.0, live=True),
    Declared("start", 0.0, "where to begin, in s after the first message", 0.0, 1e9),
    Declared("end", 0.0, "where to end, in s after the first message; 0: at the end of the recording", 0.0, 1e9),
    Declared("loop", False, "begin again at the end", live=True),
    Declared("stay", False, "wait at the end, paused, instead of ending", live=True),
    Declared("start_paused", False, "wait for ~/pause, ~/step or ~/seek before the first message"),
    Declared("clock_rate", 200.0, "/clock messages per recorded second; 0: none", 0.0, 100_000.0),
    Declared("seek_to", 0.0, "where ~/seek goes, in s after the first message", 0.0, 1e9, live=True),
    Declared("real_time_priority", 20, "of the playing thread (SCHED_FIFO), where permitted; 0: ordinary", 0, 90),
    Declared("step_count", 1, "times of messages that one call of ~/step shows", 1, 1_000_000, live=True),
)
IMPOSSIBLE = (MbdSimError, ValueError, InvalidParameterTypeException, InvalidParameterValueException)
THREADS = ("player", "reader", "executor")  # in the order of their priorities
CLEANING = 10.0  # s between looks of the garbage collector, which does not run by itself


class ReplayNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Publishes a recording's topics in time, with its own types and QoS, and `/clock`."""

    def __init__(self, ended: threading.Event) -> None:
        super().__init__("replay_node")
        self.parameters = Parameters(self, self._parameter_changed, PARAMETERS)
        unknown = self.parameters.finish()
        if not self.parameters["bag"]:
            raise ValueError("there is nothing to play. Name a recording: --ros-args -p bag:=RUN.mcap")
        self.recording = open_recording(self.parameters["bag"])
        self._ended = ended
        self.topics = ReplayTopics(self, self.recording, self._tell, ended.set)
        self.player = Player(
            self.recording,
            self.topics,
            rate=self.parameters["rate"],
            start=self.parameters["start"],
            end=self.parameters["end"],
            loop=self.parameters["loop"],
            stay=self.parameters["stay"],
            paused=self.parameters["start_paused"],
            clock_rate=0.0 if self.topics.clock_recorded else self.parameters["clock_rate"],
            latched=self.topics.latched,
            on_threads=self._prioritize,
        )
        if self.parameters["start"] > self.player.duration:
            raise ValueError(f"start is {self.parameters['start']:g} s, but it lasts {self.player.duration:g} s only")
        self._warn(unknown)
        self.create_timer(CLEANING, gc.collect, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_service(SetBool, "~/pause", self._pause)
        self.create_service(Trigger, "~/step", self._step)
        self.create_service(Trigger, "~/seek", self._seek)

    def start(self) -> None:
        """Begin to play."""
        count = sum(topic.count for topic in self.recording.topics.values())
        self.get_logger().info(
            f"{'paused' if self.player.paused else 'playing'}: {self.recording.path}, {count} messages on "
            f"{len(self.topics.publishers)} topics in {self.player.duration:.6g} s"
        )
        self._began = time.perf_counter()
        self.player.start()

    def stop(self) -> None:
        """End; what was published has been delivered, or had its time, when this returns."""
        self.player.stop()
        took = time.perf_counter() - self._began
        self.topics.close()
        late = self.player.lateness.spread()
        self.get_logger().info(
            f"played {self.player.shown} messages in {took:.3g} s, up to t = {self.player.time:.9g} s; late by "
            f"{1e3 * late.median:.2f} ms (median), {1e3 * late.p99:.2f} (p99), {1e3 * late.maximum:.1f} at most; "
            f"{self.player.overruns} overruns"
        )

    def _warn(self, unknown: Sequence[str]) -> None:
        logger = self.get_logger()
        if unknown:
            logger.warning(f"parameters that mean nothing here: {listed(unknown)}")
        for problem in self.recording.problems:
            logger.warning(f"{problem}. What it holds is played.")
        for name, why in self.topics.skipped.items():
            logger.warning(f"{name} is left out: {why}")

    def _prioritize(self) -> None:
        """Real-time priority, unless playing knows no pause: it would leave nothing for the rest of the machine."""
        priority = self.parameters["real_time_priority"] if self.parameters["rate"] > 0.0 else 0
        if self.parameters["real_time_priority"] and (refusal := realtime.prioritize(priority, THREADS)):
            self.get_logger().info(refusal, once=True)

    def _tell(self, text: str) -> None:
        self.get_logger().warning(text)

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.player.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "playing"
        return response

    def _step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.player.step(self.parameters["step_count"])
        response.success, response.message = not problem, problem or "stepped"
        return response

    def _seek(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.player.seek(self.parameters["seek_to"])
        response.success, response.message = not problem, problem or f"at t = {self.parameters['seek_to']:g} s"
        return response

    def _parameter_changed(self, name: str, value: Any) -> None:
        match name:
            case "rate":
                self.player.set_rate(value)
                self._prioritize()
            case "loop":
                self.player.loop = value
            case "stay":
                self.player.stay = value


def main(arguments: Sequence[str] | None = None) -> int:
    """Play until the end, or SIGINT or SIGTERM; either may come again while it ends."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        return _run(ended)
    finally:
        rclpy.try_shutdown()


def _run(ended: threading.Event) -> int:
    try:
        node = ReplayNode(ended)
    except IMPOSSIBLE as error:
        print(f"replay_node cannot start:\n{error}", file=sys.stderr)
        return 1
    realtime.settle_memory()
    executor = EventsExecutor()
    executor.add_node(node)
    over = threading.Event()

    def spin() -> None:
        try:
            while not over.is_set():
                executor.spin_once(timeout_sec=0.1)
        finally:
            ended.set()

    spinning = threading.Thread(target=spin, name="executor", daemon=True)
    spinning.start()
    node.start()
    realtime.wait_for(ended)
    node.stop()
    over.set()
    executor.shutdown()
    spinning.join(timeout=2.0)
    node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main())
