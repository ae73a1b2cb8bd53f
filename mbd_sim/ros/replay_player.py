"""A recording played in time: when which message is due. Knows no ROS."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from mbd_sim.recording.reader import Recording
from mbd_sim.recording.recorded_file import DamagedError, Message
from mbd_sim.ros.pacing import LONG, RE_ANCHOR, Histogram
from mbd_sim.ros.read_ahead import Ahead

NEVER = 1 << 63  # ns


class Stage(Protocol):
    """Where messages are shown. All is called from the player's thread."""

    def clock(self, time_ns: int) -> None:
        """Show the time."""

    def show(self, message: Message) -> None:
        """Show a message."""

    def tell(self, text: str) -> None:
        """Say what happened."""

    def end(self) -> None:
        """The recording is at its end, and nothing comes after it."""


class Player:
    """Plays a recording in a thread of its own; paused, sought and stepped from others.

    `rate` 1 is as recorded, 2 twice as fast, 0 as fast as possible. `start` and `end` are seconds after the first
    message; `end` 0 is the end of the recording. Where it comes late by more than `RE_ANCHOR`, it goes on from there
    and counts an overrun, instead of catching up in a burst.
    """

    def __init__(
        self,
        recording: Recording,
        stage: Stage,
        *,
        rate: float = 1.0,
        start: float = 0.0,
        end: float = 0.0,
        loop: bool = False,
        stay: bool = False,
        paused: bool = False,
        clock_rate: float = 200.0,
        latched: Sequence[str] = (),
        on_threads: Callable[[], None] = lambda: None,
    ) -> None:
        """`latched` are topics whose last message before a time is shown again when the player goes to that time.

        :param stay: wait, paused, at the end.
        :param clock_rate: times shown per recorded second; 0: none.
        :param on_threads: is called when threads have begun, `player` or `reader` by name.
        """
        self.recording, self.stage, self._on_threads = recording, stage, on_threads
        self.loop, self.stay, self.paused = loop, stay, paused
        self.lateness, self.overruns, self.shown = Histogram(), 0, 0
        self._rate, self._period_ns = rate, round(1e9 / clock_rate) if clock_rate > 0.0 else 0
        self._first_ns = recording.start_ns
        self._start_ns = self._first_ns + round(start * 1e9)
        self._end_ns = self._first_ns + round(end * 1e9) if end > 0.0 else recording.end_ns
        self._latched = tuple(latched)
        self._position = self._start_ns  # at `_since`, in recorded time
        self._since = time.perf_counter()
        self._shown_ns: int | None = None  # the time of the last message
        self._clock_due = NEVER
        self._steps, self._sought = 0, -1
        self._told: set[str] = set()
        self._stopping = False
        self._wake = threading.Event()
        self._requests: queue.SimpleQueue[tuple[Callable[[], None], threading.Event]] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)

    @property
    def time(self) -> float:
        """Where it is, in s after the first message of the recording."""
        return ((self._position if self._shown_ns is None else self._shown_ns) - self._first_ns) * 1e-9

    @property
    def duration(self) -> float:
        """How long the recording is in s."""
        return (self.recording.end_ns - self._first_ns) * 1e-9

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End; returns when nothing is shown any more."""
        self._stopping = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def pause(self, paused: bool) -> None:
        """Pause or go on; returns when it is so."""
        self._ask(lambda: setattr(self, "paused", paused))

    def set_rate(self, rate: float) -> None:
        """Play faster or slower from now on."""
        self._ask(lambda: setattr(self, "_rate", rate))

    def step(self, steps: int = 1) -> str:
        """While paused, show all messages of the next `steps` times; returns what went wrong, or ""."""
        if not self._thread.is_alive():
            return "the recording is at its end"
        if not self.paused:
            return "playing: pause before stepping"

        def more() -> None:
            self._steps += steps

        self._ask(more)
        return ""

    def seek(self, seconds: float) -> str:
        """Go to a time in s after the first message; returns what went wrong, or ""."""
        if not 0.0 <= seconds <= self.duration:
            return f"cannot seek to {seconds:g} s: the recording lasts from 0 to {self.duration:.9g} s"
        self._ask(lambda: setattr(self, "_sought", self._first_ns + round(seconds * 1e9)))
        return ""

    def _ask(self, action: Callable[[], None]) -> None:
        done = threading.Event()
        self._requests.put((action, done))
        self._wake.set()
        while self._thread.is_alive() and not done.wait(0.1):
            pass

    def _run(self) -> None:
        try:
            begin = self._start_ns
            while not self._stopping:
                if self._play(begin):
                    if self.loop and self._end_ns > self._start_ns:
                        begin = self._start_ns
                        continue
                    if not self.stay:
                        break
                    self._wait_at_end()
                if self._sought >= 0:
                    begin, self._sought = self._sought, -1
        except Exception as error:
            self.stage.tell(f"failed: {error!r}")
            raise
        finally:
            self.stage.end()

    def _play(self, begin: int) -> bool:
        """Show all from a time on; False where a seek, or the end of the player, came before."""
        self._position, self._shown_ns = begin, None
        self._clock_due = begin if self._period_ns else NEVER
        self._anchor()
        if begin > self._first_ns and self._latched:
            for message in self.recording.latest(self._latched, begin):
                self.stage.show(message)
        show = self.stage.show
        ahead = Ahead(self._messages(begin))
        self._on_threads()
        try:
            for message in ahead:
                if message.time_ns != self._shown_ns and not self._reach(message.time_ns):
                    return False
                show(message)
                self.shown += 1
        finally:
            ahead.close()
        return True

    def _messages(self, begin: int) -> Iterator[Message]:
        """What is to be shown: in the order of the file for a run of `sim_node`, whose clock may be set back."""
        if not self.recording.about:
            for message in self.recording.in_time_order(begin, self._skip):
                if message.time_ns > self._end_ns:
                    return
                yield message
            return
        waiting = True
        for block in self.recording.blocks:
            if waiting and block.end_ns < begin:
                continue
            try:
                loaded = block.load()
            except DamagedError as error:
                self._skip(error)
                continue
            for message in loaded:
                waiting = waiting and message.time_ns < begin
                if not waiting and message.time_ns <= self._end_ns:
                    yield message

    def _skip(self, error: DamagedError) -> None:
        if str(error) not in self._told:
            self._told.add(str(error))
            self.stage.tell(f"left out: {error}")

    def _wait_at_end(self) -> None:
        self.paused = True
        self.stage.tell(f"at the end, t = {self.time:.9g} s")
        while not self._stopping and self._sought < 0:
            self._wake.wait()
            self._serve()
            self._steps = 0

    def _reach(self, time_ns: int) -> bool:
        """Wait until the next time of a message, and show the clock on the way; False where that is not to come."""
        if time_ns < self._position:
            self._position = time_ns
            self._clock_due = min(self._clock_due, time_ns) if self._period_ns else NEVER
            self._anchor()
        stepped = False
        while self._clock_due < time_ns and not stepped:
            if not self._wait(self._clock_due, time_ns):
                return False
            stepped = self._position >= time_ns
            if not stepped:
                self.stage.clock(self._clock_due)
                self._clock_due += self._period_ns
        if not stepped and not self._wait(time_ns, time_ns):
            return False
        if self._clock_due <= time_ns:
            self.stage.clock(time_ns)
            self._clock_due = time_ns + self._period_ns
        self._shown_ns = time_ns
        return True

    def _wait(self, time_ns: int, next_ns: int) -> bool:
        """Wait until a recorded time; a step leads to `next_ns`. False at a seek or the end of the player."""
        while True:
            if self._wake.is_set() or self.paused:
                self._attend(time_ns)
                if self._stopping or self._sought >= 0:
                    return False
                if self._steps:
                    self._steps -= 1
                    self._position = next_ns
                    return True
                continue
            if self._rate <= 0.0:
                self._position = time_ns
                return True
            now = time.perf_counter()
            rest = self._since + (time_ns - self._position) * 1e-9 / self._rate - now
            if rest <= 0.0:
                self.lateness.add(-rest)
                self._position, self._since = time_ns, now + rest
                if -rest > RE_ANCHOR:
                    self.overruns += 1
                    self._anchor()
                return True
            if rest > LONG:
                self._wake.wait(rest - LONG / 2.0)
            else:
                time.sleep(rest)

    def _attend(self, limit_ns: int) -> None:
        """Serve requests; while paused, wait for one. The time that passed before is kept."""
        passed = (time.perf_counter() - self._since) * self._rate * 1e9 if not self.paused else 0.0
        self._position = min(limit_ns, self._position + round(passed))
        self._serve()
        if self.paused and not (self._steps or self._stopping or self._sought >= 0):
            self._wake.wait()
        self._anchor()

    def _serve(self) -> None:
        self._wake.clear()
        while not self._requests.empty():
            action, done = self._requests.get()
            action()
            done.set()
        if self._stopping:
            self._wake.set()

    def _anchor(self) -> None:
        self._since = time.perf_counter()
