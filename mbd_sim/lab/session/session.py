"""What pages ask of a run, and what they show of it.

Pages put requests into a mailbox and read the newest frame; neither waits for the other. Requests of the same name
replace each other, so that a page that sends thousands of them is served once in each turn.

There are two sessions: one with a run of its own, and one with the run of a node.
"""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from mbd_sim.analysis.mechanics.inverse_kinematics import InverseKinematics
from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.frames import Frame, History, Samples
from mbd_sim.pictures.shapes.touching import touching

PICTURES = 60.0  # frames per second of real time
HISTORY_PERIOD = 1.0 / 30.0  # s of real time between points of the history
MOST_REQUESTS = 500  # names that may wait; a page has fewer controls


class Session(ABC):
    """Shows a bench in a thread of its own; `turn` is one turn of its loop, in which requests call the other methods.

    `of_node` says that the run is that of a node: it cannot be wound back, and the node names its recordings.
    """

    of_node = False

    def __init__(self, bench: Bench, *, running: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self.bench, self.history, self.samples = bench, History(), Samples()
        self.running, self.speed = running, 1.0
        self.watched: dict[str, Callable[[Bench], Any]] = {}  # what frames contain besides, by name
        self.reading: Callable[[Bench], float] | None = None
        self.message, self.generation, self.turns = "", 1, 0
        self.edition = 0  # counts changes of live values
        self._clock = clock
        self._waiting: dict[str, Callable[[Any], None]] = {}
        self._lock, self._wake, self._stopped = threading.Lock(), threading.Event(), threading.Event()
        self.pages = set[int]()  # that are open
        self._holder = -1  # the page whose hand holds a part
        self._last_point, self._rate, self._advanced = -math.inf, 0.0, clock()
        self._thread = threading.Thread(target=self._run, name="lab_session", daemon=True)
        self.frame = self._framed()

    def start(self) -> None:
        """Begin the loop."""
        self._thread.start()

    def stop(self) -> None:
        """End the loop."""
        self._stopped.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def ask(self, name: str, request: Callable[[Self], None]) -> None:
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
        """Serve the waiting requests, go on to the present, and publish a frame."""
        with self._lock:
            requests, self._waiting = list(self._waiting.values()), {}
        for request in requests:
            try:
                request(self)
            except (MbdSimError, ValueError) as error:
                self.message = str(error)
        self._go_on()
        self.turns += 1
        self.frame = self._framed()

    @abstractmethod
    def _go_on(self) -> None:
        """Bring the bench to the present."""

    @property
    @abstractmethod
    def recording(self) -> str:
        """What is being recorded; "" without a recording."""

    @abstractmethod
    def play(self) -> None:
        """Run on from the present state."""

    @abstractmethod
    def pause(self) -> None:
        """Stop in the present state; a hand lets go."""

    @abstractmethod
    def step(self, steps: int | None = None) -> None:
        """Pause, and take steps; by default those of the button."""

    @abstractmethod
    def reset(self) -> None:
        """Return to the start."""

    @abstractmethod
    def set_speed(self, speed: float) -> None:
        """Simulated seconds per second; inf: as fast as possible."""

    @abstractmethod
    def wind_to(self, time: float) -> None:
        """Pause in the state of the history nearest to a time in s."""

    @abstractmethod
    def step_back(self) -> None:
        """Pause in the last state of the history before the present one."""

    @abstractmethod
    def change(self, key: str, value: float) -> None:
        """Change a live value, in SI units: see `Simulation.set_live`."""

    @abstractmethod
    def set_effort(self, name: str, value: float) -> None:
        """Set the effort on a coordinate, in N or N·m."""

    @abstractmethod
    def set_command(self, name: str, value: float) -> None:
        """Set the command of a channel of an actuator or a drive, by its name in `Bench.values`."""

    @abstractmethod
    def set_state(self, positions: Mapping[str, float], velocities: Mapping[str, float]) -> None:
        """Set positions and speeds of joints, in rad and m: see `Simulation.set_state`."""

    @abstractmethod
    def drive_to(self, position: float) -> None:
        """Move the driven joint of a mechanism of positions: see `PositionBench.drive_to`."""

    @abstractmethod
    def take_hold(self, part: str, point: Array, target: Array) -> None:
        """Pull a point of a part toward a target: see `Bench.take_hold`."""

    @abstractmethod
    def let_go(self) -> None:
        """Remove the force of the hand."""

    @abstractmethod
    def place(self, part: str, point: Array, target: Array) -> None:
        """Move the paused mechanism with a point of a part: see `Bench.drag`."""

    @abstractmethod
    def put(self, found: InverseKinematics) -> None:
        """Pause, and put the mechanism at rest where inverse kinematics has found it.

        :raises CommandError: it cannot be there.
        """

    @abstractmethod
    def record(self, path: Path | str) -> None:
        """Record to an MCAP file from here on.

        :raises RecordingError: the file cannot be written.
        """

    @abstractmethod
    def end_recording_told(self) -> None:
        """Complete the recording, and say where it is."""

    def drag(self, page: int, phase: str, part: str, point: Array, target: Array) -> None:
        """A part is dragged on a page: pulled in a run, moved through its configurations otherwise."""
        if phase == "end":
            self.let_go()
        elif not self.running or self.bench.positions_only:
            self.place(part, point, target)
        elif self.bench.hold is None or phase == "start":
            self._holder = page
            self.take_hold(part, point, target)
        else:
            self.bench.pull_to(target)

    def enter(self, page: int) -> None:
        """A page was opened."""
        self.pages.add(page)

    def leave(self, page: int) -> None:
        """A page was closed: its hand lets go."""
        self.pages.discard(page)
        if page == self._holder:
            self.let_go()

    def tell(self, message: str) -> None:
        """Show a message on all pages."""
        self.message = message

    def _measure_rate(self, simulated: float) -> None:
        """Simulated seconds per second, over about a second."""
        now = self._clock()
        passed, self._advanced = now - self._advanced, now
        weight = 1.0 - math.exp(-passed)
        if passed > 0.0:
            self._rate += weight * (simulated / passed - self._rate)

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
            position, force = hold.acting(simulation)
            pull = position, hold.target, force, hold.strongest
        return Frame(
            generation=self.generation,
            number=self.turns,
            mechanism=simulation.live_mechanism,
            time=simulation.time,
            running=self.running,
            rate=self._rate if self.running else 0.0,
            speed=self.speed,
            poses=model.pose_array(*now).copy(),
            contacts=touching(model, *now),
            energies=np.array(tuple(simulation.energies)),
            q=simulation.q.copy(),
            positions=model.coordinates(simulation.state),
            speeds=simulation.u.copy(),
            watched={name: read(self.bench) for name, read in self.watched.items()},
            pull=pull,
            span=self.history.span or (simulation.time, simulation.time),
            message=self.message or self.bench.message,
            recording=self.recording,
            values=self.bench.values(),
        )
