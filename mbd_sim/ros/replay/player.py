"""Plays a recording in time: reads messages ahead and decides when each is due. Independent of ROS."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Protocol

from mbd_sim.recordings.messages.cdr import DamagedError, Message
from mbd_sim.recordings.run.reader import Recording
from mbd_sim.ros.stepping.pacing import INTERRUPTIBLE_SLEEP, MAX_LATENESS, Histogram
from mbd_sim.ros.stepping.thread import RequestQueue

BATCH_SIZE = 200  # messages read at once
MAX_BATCHES = 20  # batches that may wait


class ReadAhead:
    """Iterates over messages that a thread of its own reads, so that unpacking a block delays none of them."""

    def __init__(self, messages: Iterator[Message]) -> None:
        self._messages = messages
        self._queue: queue.Queue[list[Message] | BaseException] = queue.Queue(MAX_BATCHES)
        self._closed = False
        self._thread = threading.Thread(target=self._read, name="reader", daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Message]:
        while batch := self._queue.get():
            if isinstance(batch, BaseException):
                raise batch
            yield from batch

    def close(self) -> None:
        """Stop reading."""
        self._closed = True

    def _read(self) -> None:
        try:
            while not self._closed and (batch := list(islice(self._messages, BATCH_SIZE))):
                self._put(batch)
            self._put([])
        except Exception as error:
            self._put(error)

    def _put(self, batch: list[Message] | BaseException) -> None:
        while not self._closed:
            try:
                self._queue.put(batch, timeout=0.1)
                return
            except queue.Full:
                continue


NEVER = 1 << 63  # ns


class PlayerOutput(Protocol):
    """The receiver of the messages played; all methods are called from the player's thread."""

    def clock(self, time_ns: int) -> None:
        """Publish the recorded time."""

    def publish(self, message: Message) -> None:
        """Publish a message."""

    def warn(self, text: str) -> None:
        """Report a problem to the user."""

    def inform(self, text: str) -> None:
        """Report something that is not a problem."""

    def end(self) -> None:
        """The player has ended: nothing follows."""


class Player:
    """Plays a recording in a thread of its own; other threads pause, step and seek.

    `rate` 1 is as recorded, 2 twice as fast, 0 as fast as possible. `start` and `end` are in s after the first
    message; `end` 0 is the end of the recording. A delay of more than `MAX_LATENESS` shifts the schedule and counts
    as an overrun; the player never catches up in a burst.
    """

    def __init__(
        self,
        recording: Recording,
        output: PlayerOutput,
        *,
        rate: float = 1.0,
        start: float = 0.0,
        end: float = 0.0,
        loop: bool = False,
        stay: bool = False,
        paused: bool = False,
        clock_rate: float = 200.0,
        latched: Sequence[str] = (),
        on_threads_started: Callable[[], None] = lambda: None,
    ) -> None:
        """Create the player, which `start` starts.

        :param stay: pause at the end.
        :param clock_rate: clock messages per recorded second; 0: none.
        :param latched: topics whose last earlier message is published again after a seek.
        :param on_threads_started: is called when the threads named `player` or `reader` have started.
        """
        self.recording, self.output, self._on_threads_started = recording, output, on_threads_started
        self.loop, self.stay, self.paused = loop, stay, paused
        self.lateness, self.overruns, self.played = Histogram(), 0, 0
        self._rate, self._clock_period_ns = rate, round(1e9 / clock_rate) if clock_rate > 0.0 else 0
        self._first_ns = recording.start_ns
        self._start_ns = self._first_ns + round(start * 1e9)
        self._end_ns = self._first_ns + round(end * 1e9) if end > 0.0 else recording.end_ns
        self._latched = tuple(latched)
        self._position_ns = self._start_ns  # the recorded time at `_position_time` of the steady clock
        self._position_time = time.perf_counter()
        self._played_ns: int | None = None  # the recorded time of the last message
        self._clock_due_ns = NEVER
        self._steps, self._seek_ns = 0, -1
        self._reported: set[str] = set()
        self._stopping = self._ended = False
        self._wake = threading.Event()
        self._requests: RequestQueue[[]] = RequestQueue(self._wake.set)
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)

    @property
    def time(self) -> float:
        """The present position in s after the first message of the recording."""
        return ((self._position_ns if self._played_ns is None else self._played_ns) - self._first_ns) * 1e-9

    @property
    def duration(self) -> float:
        """The length of the recording in s."""
        return (self.recording.end_ns - self._first_ns) * 1e-9

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread; nothing is played when this returns."""
        self._stopping = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def pause(self, paused: bool) -> None:
        """Pause or resume; returns when it has taken effect."""
        self._call(lambda: setattr(self, "paused", paused))

    def set_rate(self, rate: float) -> None:
        """Change the rate from now on."""
        self._call(lambda: setattr(self, "_rate", rate))

    def step(self, steps: int = 1) -> str:
        """While paused, play all messages of the next `steps` times; returns the problem, or "" on success."""
        if self._ended:
            return "the recording has ended"
        if not self.paused:
            return "the recording is playing: pause it before stepping"

        def add_steps() -> None:
            self._steps += steps

        self._call(add_steps)
        return ""

    def seek(self, seconds: float) -> str:
        """Go to a time in s after the first message; returns the problem, or "" on success."""
        if not 0.0 <= seconds <= self.duration:
            return f"cannot seek to {seconds:g} s: the recording runs from 0 to {self.duration:.9g} s"
        self._call(lambda: setattr(self, "_seek_ns", self._first_ns + round(seconds * 1e9)))
        return ""

    def _call(self, action: Callable[[], None]) -> None:
        self._requests.call(action, self._thread)

    def _run(self) -> None:
        try:
            begin_ns = self._start_ns
            while not self._stopping:
                if self._play(begin_ns):
                    if self.loop and self._end_ns > self._start_ns:
                        begin_ns = self._start_ns
                        continue
                    if not self.stay:
                        break
                    self._wait_at_end()
                if self._seek_ns >= 0:
                    begin_ns, self._seek_ns = self._seek_ns, -1
        except Exception as error:
            self.output.warn(f"failed: {error!r}")
            raise
        finally:
            self._ended = True
            self.output.end()

    def _play(self, begin_ns: int) -> bool:
        """Play from a recorded time on; False if a seek or the end of the player interrupted it."""
        self._position_ns, self._played_ns = begin_ns, None
        self._clock_due_ns = begin_ns if self._clock_period_ns else NEVER
        self._anchor()
        if begin_ns > self._first_ns and self._latched:
            for message in self.recording.latest(self._latched, begin_ns):
                self.output.publish(message)
        publish = self.output.publish
        messages = ReadAhead(self._messages(begin_ns))
        self._on_threads_started()
        try:
            for message in messages:
                if message.time_ns != self._played_ns and not self._advance_to(message.time_ns):
                    return False
                publish(message)
                self.played += 1
        finally:
            messages.close()
        return True

    def _messages(self, begin_ns: int) -> Iterator[Message]:
        """The messages to play.

        They come in the order of the file if `sim_node` recorded it, as its clock may have been set back; else by time.
        """
        if not self.recording.about:
            for message in self.recording.in_time_order(begin_ns, self._report_damage):
                if message.time_ns > self._end_ns:
                    return
                yield message
            return
        before_begin = True
        for block in self.recording.blocks:
            if before_begin and block.end_ns < begin_ns:
                continue
            try:
                loaded = block.load()
            except DamagedError as error:
                self._report_damage(error)
                continue
            for message in loaded:
                before_begin = before_begin and message.time_ns < begin_ns
                if not before_begin and message.time_ns <= self._end_ns:
                    yield message

    def _report_damage(self, error: DamagedError) -> None:
        if str(error) not in self._reported:
            self._reported.add(str(error))
            self.output.warn(f"not played: {error}")

    def _wait_at_end(self) -> None:
        self.paused = True
        self.output.inform(f"at the end, t = {self.time:.9g} s")
        while not self._stopping and self._seek_ns < 0:
            self._wake.wait()
            self._serve_requests()
            self._steps = 0

    def _advance_to(self, time_ns: int) -> bool:
        """Wait until a message's time, publishing the clock on the way; False if a seek or the end interrupted it."""
        if time_ns < self._position_ns:
            self._position_ns = time_ns
            self._clock_due_ns = min(self._clock_due_ns, time_ns) if self._clock_period_ns else NEVER
            self._anchor()
        stepped = False
        while self._clock_due_ns < time_ns and not stepped:
            if not self._wait_until(self._clock_due_ns, time_ns):
                return False
            stepped = self._position_ns >= time_ns
            if not stepped:
                self.output.clock(self._clock_due_ns)
                self._clock_due_ns += self._clock_period_ns
        if not stepped and not self._wait_until(time_ns, time_ns):
            return False
        if self._clock_due_ns <= time_ns:
            self.output.clock(time_ns)
            self._clock_due_ns = time_ns + self._clock_period_ns
        self._played_ns = time_ns
        return True

    def _wait_until(self, time_ns: int, next_ns: int) -> bool:
        """Wait until a recorded time; a step goes to `next_ns` instead. False if a seek or the end interrupted it."""
        while True:
            if self._wake.is_set() or self.paused:
                self._handle_wake(time_ns)
                if self._stopping or self._seek_ns >= 0:
                    return False
                if self._steps:
                    self._steps -= 1
                    self._position_ns = next_ns
                    return True
                continue
            if self._rate <= 0.0:
                self._position_ns = time_ns
                return True
            now = time.perf_counter()
            rest = self._position_time + (time_ns - self._position_ns) * 1e-9 / self._rate - now
            if rest <= 0.0:
                self.lateness.add(-rest)
                self._position_ns, self._position_time = time_ns, now + rest
                if -rest > MAX_LATENESS:
                    self.overruns += 1
                    self._anchor()
                return True
            if rest > INTERRUPTIBLE_SLEEP:
                self._wake.wait(rest - INTERRUPTIBLE_SLEEP / 2.0)
            else:
                time.sleep(rest)

    def _handle_wake(self, limit_ns: int) -> None:
        """Serve requests; while paused, wait for one. The position advances by the time that has passed."""
        passed_ns = (time.perf_counter() - self._position_time) * self._rate * 1e9 if not self.paused else 0.0
        self._position_ns = min(limit_ns, self._position_ns + round(passed_ns))
        self._serve_requests()
        if self.paused and not (self._steps or self._stopping or self._seek_ns >= 0):
            self._wake.wait()
        self._anchor()

    def _serve_requests(self) -> None:
        self._wake.clear()
        self._requests.serve_all()
        if self._stopping:
            self._wake.set()

    def _anchor(self) -> None:
        self._position_time = time.perf_counter()
