"""The session that owns the simulation of its pages: it serves requests, keeps time, and can wind back."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mbd_sim.analysis.mechanics.inverse_kinematics import InverseKinematics
from mbd_sim.base.errors import DivergedError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.continuation import continue_run
from mbd_sim.lab.session.positions import PositionBench
from mbd_sim.lab.session.session import Session
from mbd_sim.recordings.run.run_recorder import RunRecorder
from mbd_sim.simulation.model.live_values import PreparedValues
from mbd_sim.simulation.run.events import EventKind
from mbd_sim.simulation.run.run_point import RunPoint

LONGEST_TURN = 0.03  # s of real time for steps, after which requests are served


class OwnSession(Session):
    """Runs a bench of its own."""

    def __init__(self, bench: Bench, *, running: bool = True, clock: Callable[[], float] = time.monotonic) -> None:
        self._recorder: RunRecorder | None = None
        self._anchor = (clock(), bench.simulation.time)
        super().__init__(bench, running=running, clock=clock)

    def start(self) -> None:
        """Begin the loop."""
        self._restart_clock()
        super().start()

    def stop(self) -> None:
        """End the loop and complete the recording."""
        super().stop()
        self.end_recording()

    @property
    def recording(self) -> str:
        """See `Session`."""
        return str(self._recorder.path) if self._recorder else ""

    def play(self) -> None:
        """Run on from the present state, to which one can wind back."""
        self._remember(always=True)
        self.running, self.message, self._advanced = True, "", self._clock()
        self._rate = self.speed if math.isfinite(self.speed) else 0.0
        self._restart_clock()

    def pause(self) -> None:
        """Stop in the present state; a hand lets go."""
        if self.running:
            self._remember(always=True)
        self.running = False
        self.bench.let_go()

    def step(self, steps: int | None = None) -> None:
        """Pause, and take steps; by default as many as the force of a hand stays the same."""
        self.pause()
        self._remember(always=True)
        self._guarded(self.bench.period if steps is None else steps)
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
        self._return_to(self.history.nearest(time))

    def step_back(self) -> None:
        """See `Session`."""
        self._return_to(self.history.before(self.bench.simulation.time))

    def _return_to(self, point: RunPoint | None) -> None:
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

    def drive_to(self, position: float) -> None:
        """Pause, and move the driven joint of a mechanism of positions: see `PositionBench.drive_to`."""
        self.pause()
        if isinstance(self.bench, PositionBench):
            self.bench.drive_to(position)
            self.message = ""

    def set_effort(self, name: str, value: float) -> None:
        """See `Session`."""
        self.bench.simulation.set_efforts({name: value})

    def set_command(self, name: str, value: float) -> None:
        """See `Session`."""
        actuator, _, channel = name.rpartition(".")
        command: Any = {channel: value} if actuator else value
        self.bench.simulation.set_commands({actuator or channel: command})

    def set_state(self, positions: Mapping[str, float], velocities: Mapping[str, float]) -> None:
        """See `Session`."""
        self.bench.simulation.set_state(positions, velocities)

    def take_hold(self, part: str, point: Array, target: Array) -> None:
        """See `Session`."""
        self.bench.take_hold(part, point, target)

    def let_go(self) -> None:
        """See `Session`."""
        self.bench.let_go()

    def place(self, part: str, point: Array, target: Array) -> None:
        """See `Session`."""
        self.bench.drag(part, point, target)

    def put(self, found: InverseKinematics) -> None:
        """See `Session`."""
        self.pause()
        self.bench.put(found.q)
        self._note("put in place by inverse kinematics")
        self.message = ""

    def adopt(self, bench: Bench) -> None:
        """Go on with another mechanism, in the state of this one as far as names agree."""
        recording, path = self._recorder is not None, self._recorder.path if self._recorder else None
        self.bench.let_go()
        self._note("the file was saved: another mechanism goes on")
        try:
            continue_run(bench.simulation, self.bench.simulation, self.bench.file)
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
        """Record to an MCAP file from here on; where there is one of this name, to the next one of a series.

        :raises RecordingError: the file cannot be written.
        """
        self.end_recording()
        path, part = Path(path), 1
        while path.exists():
            part += 1
            path = path.with_name(f"{path.stem.split('_part')[0]}_part{part}{path.suffix}")
        self._recorder = RunRecorder(self.bench.simulation, path)

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

    def _go_on(self) -> None:
        """Take the steps that are due; if there are too many, the motion is slower than requested."""
        if not self.running:
            return
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

    def _guarded(self, steps: int) -> None:
        try:
            self.bench.advance(steps)
        except DivergedError as error:
            self.running, self.message = False, str(error)
