"""The thread that owns the simulation of a page: it serves requests, keeps time, and publishes frames.

Pages put requests into a mailbox and read the newest frame; neither waits for the other. Requests of the same name
replace each other, so that a page that sends thousands of them is served once in each turn.
"""

from __future__ import annotations

import math
import threading
import time
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import DivergedError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.positions import PositionBench
from mbd_sim.recordings.run.run_recorder import RunRecorder
from mbd_sim.simulation.model.live_values import PreparedValues
from mbd_sim.simulation.run.events import EventKind
from mbd_sim.simulation.run.state import RunPoint

PICTURES = 60.0  # frames per second of real time
LONGEST_TURN = 0.03  # s of real time for steps, after which requests are served
HISTORY_PERIOD = 1.0 / 30.0  # s of real time between points to wind back to
MOST_SAMPLES = 3600
MOST_BYTES = 64e6
MOST_POINTS = 5400  # three minutes at 30 points a second
MOST_REQUESTS = 500  # names that may wait; a page has fewer controls

Request = Callable[["Session"], None]


@dataclass(frozen=True, eq=False)
class Frame:
    """What pages show: all of one moment.

    `poses` (parts, 12) are as in `Model.pose_array`, `contacts` (n, 6) as in `Model.contact_places`; `reactions` are
    the forces (3,) in N on the second part of each joint, where they are requested. `pull` are the held point, the
    pointer (3,) and the force (3,), if something is held. `values` are those of the sliders by key, in SI units.
    `generation` counts the mechanisms.
    """

    generation: int
    number: int
    time: float
    running: bool
    rate: float
    poses: Array
    contacts: Array
    energies: Array
    positions: Array
    speeds: Array
    reactions: Mapping[str, Array]
    pull: tuple[Array, Array, Array] | None
    span: tuple[float, float]
    message: str
    recording: str
    values: Mapping[str, float]


class History:
    """Points of a run in the order of time; the oldest ones are forgotten."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, RunPoint]] = deque(maxlen=MOST_POINTS)

    def __len__(self) -> int:
        return len(self._points)

    def add(self, time: float, point: RunPoint) -> None:
        """Add a point at a time in s. Points from then on belong to a motion that was given up: they are forgotten."""
        if not self._points:
            size = point.state.nbytes + point.inputs.nbytes + point.samples.nbytes + point.history.nbytes + 500
            self._points = deque(maxlen=max(2, min(MOST_POINTS, int(MOST_BYTES / size))))
        while self._points and self._points[-1][0] >= time:
            self._points.pop()
        self._points.append((time, point))

    def clear(self) -> None:
        """Forget everything, as other equations hold from here on."""
        self._points.clear()

    @property
    def span(self) -> tuple[float, float]:
        """The times in s of the first and the last point; zeros if there is none."""
        return (self._points[0][0], self._points[-1][0]) if self._points else (0.0, 0.0)

    def nearest(self, time: float) -> RunPoint | None:
        """The point nearest to a time in s; None if there is none."""
        if not self._points:
            return None
        at = bisect_left(self._points, time, key=lambda one: one[0])
        around = [self._points[index] for index in (at - 1, at) if 0 <= index < len(self._points)]
        return min(around, key=lambda one: abs(one[0] - time))[1]

    def points(self) -> list[tuple[float, RunPoint]]:
        """All points with their times."""
        return list(self._points)


@dataclass
class Samples:
    """What the plots show: rows (time, energies, positions, speeds, reading) in the order of time."""

    rows: deque[Array] = field(default_factory=lambda: deque(maxlen=MOST_SAMPLES))

    def add(self, row: Array) -> None:
        """Add a row; later ones belong to a motion that was given up."""
        while self.rows and self.rows[-1][0] >= row[0]:
            self.rows.pop()
        if self.rows and len(self.rows[-1]) != len(row):
            self.rows.clear()
        self.rows.append(row)

    def table(self, most: int) -> Array:
        """At most `most` of the rows (n, width), evenly chosen."""
        rows = list(self.rows)
        stride = max(1, math.ceil(len(rows) / most))
        return np.array(rows[::-1][::stride][::-1])


class Session:
    """Runs a bench in a thread of its own; `turn` is one turn of its loop."""

    def __init__(self, bench: Bench, *, running: bool = True, clock: Callable[[], float] = time.monotonic) -> None:
        self.bench, self.history, self.samples = bench, History(), Samples()
        self.running, self.speed, self.show_reactions = running, 1.0, False
        self.reading: Callable[[Bench], float] | None = None
        self.message, self.generation, self.turns = "", 1, 0
        self.edition = 0  # counts changes of live values
        self._clock = clock
        self._waiting: dict[str, Request] = {}
        self._lock, self._wake, self._stopped = threading.Lock(), threading.Event(), threading.Event()
        self._recorder: RunRecorder | None = None
        self._recorded, self._last_point = 0, -math.inf
        self._anchor, self._rate, self._advanced = (clock(), bench.simulation.time), 0.0, clock()
        self._thread = threading.Thread(target=self._run, name="lab_session", daemon=True)
        self.frame = self._framed()

    def start(self) -> None:
        """Begin the loop."""
        self._anchor = (self._clock(), self.bench.simulation.time)
        self._thread.start()

    def stop(self) -> None:
        """End the loop and complete the recording."""
        self._stopped.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        self.end_recording()

    def ask(self, name: str, request: Request) -> None:
        """Put a request for the next turn, from any thread; it replaces one of the same name that still waits."""
        with self._lock:
            if name in self._waiting or len(self._waiting) < MOST_REQUESTS:
                self._waiting.pop(name, None)
                self._waiting[name] = request
        self._wake.set()

    def _run(self) -> None:
        while not self._stopped.is_set():
            began = self._clock()
            self.turn()
            if self._wake.wait(max(0.0, began + 1.0 / PICTURES - self._clock())):
                self._wake.clear()

    def turn(self) -> None:
        """Serve the waiting requests, take the steps that are due, and publish a frame."""
        with self._lock:
            requests, self._waiting = list(self._waiting.values()), {}
        for request in requests:
            try:
                request(self)
            except (MbdSimError, ValueError) as error:
                self.message = str(error)
        if self.running:
            self._advance()
        self.turns += 1
        self.frame = self._framed()

    def play(self) -> None:
        """Run on from the present state."""
        self.running, self.message, self._advanced, self._rate = True, "", self._clock(), 0.0
        self._restart_clock()

    def pause(self) -> None:
        """Stop in the present state; a hand lets go."""
        if self.running:
            self._remember(always=True)
        self.running = False
        self.bench.let_go()

    def step(self, steps: int = 1) -> None:
        """Pause, and take steps."""
        self.pause()
        self._guarded(steps)
        self._remember(always=True)

    def reset(self) -> None:
        """Return to the start."""
        self.bench.let_go()
        self.bench.simulation.reset()
        self.history.clear()
        self.samples.rows.clear()
        self._note("reset from the page")
        self._restart_clock()

    def set_speed(self, speed: float) -> None:
        """Simulated seconds per second; inf: as fast as possible."""
        self.speed = speed
        self._restart_clock()

    def wind_to(self, time: float) -> None:
        """Pause in the state of the history nearest to a time in s; a hand that pulled there has let go."""
        point = self.history.nearest(time)
        if point is not None:
            self.pause()
            self.bench.simulation.restore(point)
            self.bench.clear_wrenches()
            self.edition += 1
            self._note(f"wound back to {self.bench.simulation.time:.6g} s")

    def change(self, key: str, value: float) -> None:
        """Change a live value, in SI units: see `Simulation.set_live`."""
        self.apply(self.bench.simulation.prepare_live({key: value}, reassemble=True))

    def apply(self, prepared: PreparedValues) -> None:
        """Change live values that were prepared in this `edition` of the session: see `Simulation.set_live`."""
        self.bench.simulation.apply_live(prepared)
        self.edition += 1
        self._note("sliders: " + ", ".join(f"{key} = {value!r}" for key, value in prepared.changes.items()))
        self.message = ""

    def tell(self, message: str) -> None:
        """Show a message on all pages."""
        self.message = message

    def drive_to(self, position: float) -> None:
        """Pause, and move the driven joint of a mechanism of positions: see `PositionBench.drive_to`."""
        self.pause()
        if isinstance(self.bench, PositionBench):
            self.bench.drive_to(position)
            self.message = ""

    def adopt(self, bench: Bench) -> None:
        """Go on with another mechanism, in the state of this one as far as names agree."""
        recording, path = self._recorder is not None, self._recorder.path if self._recorder else None
        self.bench.let_go()
        self._note("the file was saved: another mechanism goes on")
        try:
            bench.adopt_state(self.bench)
            self.message = "the file was read again"
        except MbdSimError as error:
            self.message = f"the file was read again; the motion begins at its start: {error}"
        self.end_recording()
        self.bench, self.generation, self.edition = bench, self.generation + 1, self.edition + 1
        self.history.clear()
        self.samples.rows.clear()
        self.reading = None
        self._restart_clock()
        if recording and path is not None:
            self.record(path)

    def record(self, path: Path | str) -> None:
        """Record to an MCAP file from here on; after a change of the file, to the next one of a series.

        :raises RecordingError: the file cannot be written.
        """
        self.end_recording()
        path = Path(path)
        self._recorded += 1
        name = (
            path if self._recorded == 1 else path.with_name(f"{path.stem.split('_part')[0]}_part{self._recorded}.mcap")
        )
        self._recorder = RunRecorder(self.bench.simulation, name)

    def end_recording(self) -> Path | None:
        """Complete the recording; its path."""
        if self._recorder is None:
            return None
        recorder, self._recorder = self._recorder, None
        recorder.close()
        return recorder.path

    def end_recording_told(self) -> None:
        """Complete the recording, and say where it is."""
        path = self.end_recording()
        self.message = "nothing is being recorded" if path is None else f"recorded {path}"

    def _note(self, text: str) -> None:
        if self._recorder is not None:
            self._recorder.report(EventKind.NOTE, text)

    def _restart_clock(self) -> None:
        self._anchor = (self._clock(), self.bench.simulation.time)

    def _advance(self) -> None:
        """Take the steps that are due; if there are too many, the motion is slower than requested."""
        simulation, period, began = self.bench.simulation, self.bench.period, self._clock()
        start = simulation.time
        while self.running:
            elapsed = self._clock() - self._anchor[0]
            due = self._anchor[1] + elapsed * self.speed if math.isfinite(self.speed) else math.inf
            if due - simulation.time < simulation.step_size:
                break
            left = (due - simulation.time) / simulation.step_size
            self._guarded(period if left >= period else int(left))
            if self._clock() - began > LONGEST_TURN:
                self._restart_clock()
                break
        self._measure_rate(simulation.time - start)
        self._remember()

    def _measure_rate(self, simulated: float) -> None:
        """Simulated seconds per second, over about a second."""
        now = self._clock()
        passed, self._advanced = now - self._advanced, now
        weight = 1.0 - math.exp(-passed)
        if passed > 0.0:
            self._rate += weight * (simulated / passed - self._rate)

    def _guarded(self, steps: int) -> None:
        try:
            self.bench.advance(steps)
        except DivergedError as error:
            self.running, self.message = False, str(error)

    def _remember(self, *, always: bool = False) -> None:
        simulation, now = self.bench.simulation, self._clock()
        if always or now - self._last_point >= HISTORY_PERIOD:
            self._last_point = now
            self.history.add(simulation.time, simulation.snapshot())
        reading = float("nan") if self.reading is None else self.reading(self.bench)
        energies = np.array(tuple(simulation.energies))
        positions = simulation.model.coordinates(simulation.y)
        self.samples.add(np.concatenate([[simulation.time], energies, positions, simulation.u, [reading]]))

    def _framed(self) -> Frame:
        simulation, hold = self.bench.simulation, self.bench.hold
        model, now = simulation.model, (simulation.time, simulation.y, simulation.inputs)
        pull = None
        if hold is not None:
            position, velocity = self.bench.moving(hold)
            pull = position, hold.target, hold.force(position, velocity)
        reactions = simulation.reactions() if self.show_reactions else {}
        return Frame(
            generation=self.generation,
            number=self.turns,
            time=simulation.time,
            running=self.running,
            rate=self._rate if self.running else 0.0,
            poses=model.pose_array(*now).copy(),
            contacts=np.array(model.contact_readings.places(*now))
            if model.contact_readings.placed
            else np.empty((0, 6)),
            energies=np.array(tuple(simulation.energies)),
            positions=model.coordinates(simulation.state),
            speeds=simulation.u.copy(),
            reactions={name: one.force.copy() for name, one in reactions.items()},
            pull=pull,
            span=self.history.span,
            message=self.message or self.bench.message,
            recording=str(self._recorder.path) if self._recorder else "",
            values=self.bench.values(),
        )
