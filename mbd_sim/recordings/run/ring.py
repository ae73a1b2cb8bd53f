"""Keeps the last seconds of a run, and writes them on request or after an event: an impact, a threshold, a divergence.

The run is recorded in files of as many seconds, of which the last two are kept; so at least the requested time is
there, and at most twice that. Each begins with its own state, so that it can be verified and shown like any recording.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from mbd_sim.base.errors import InputError
from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.values.expression import evaluate, names_in, require_valid
from mbd_sim.recordings.run.paths import RecordingError, RecordingPaths
from mbd_sim.recordings.run.run_recorder import RunRecorder
from mbd_sim.simulation.contact.records import ContactChange
from mbd_sim.simulation.model.state_records import Energies
from mbd_sim.simulation.run.events import EventKind, Payload
from mbd_sim.simulation.run.simulation import BaseSimulation

IMPACT = "impact"
CHECKS = 1000.0  # of a threshold, in each second of simulated time, at most one in each step


class Threshold:
    """A condition such as `abs(elbow.velocity) > 3`, of coordinates, their velocities, energies and the time `t`."""

    __repr__ = short_repr

    def __init__(self, simulation: BaseSimulation, text: str) -> None:
        """Check the expression; it holds where it is neither 0 nor false.

        :raises InputError: it is no expression, or has an unknown name.
        """
        self.text, self._simulation = text, simulation
        self._coordinates = {name: index for index, name in enumerate(simulation.coordinate_names)}
        known = ["t", *self._coordinates, *(f"{name}.velocity" for name in self._coordinates)]
        known += [f"energy.{name}" for name in Energies._fields]
        require_valid(self._condition, known, {})
        self._names = names_in(self._condition)

    @property
    def _condition(self) -> str:
        return f"where({self.text}, 1, 0)"

    def holds(self) -> bool:
        """Whether it holds in the present state."""
        simulation = self._simulation
        positions, speeds = simulation.model.coordinates(simulation.state), simulation.u
        values = {"t": simulation.time}
        for name, index in self._coordinates.items():
            values[name], values[f"{name}.velocity"] = float(positions[index]), float(speeds[index])
        if any(name.startswith("energy.") for name in self._names):
            values |= {f"energy.{name}": float(value) for name, value in simulation.energies._asdict().items()}
        return evaluate(self._condition, values) != 0.0


class RingRecorder:
    """Records a simulation; of its run, at least the last `seconds` are in the files that are written.

    `written` are these files: one or two, the older one first. `cause` says why they were written.

    >>> from mbd_sim import Simulation
    >>> from mbd_sim.recordings.run.ring import RingRecorder
    >>> sim = Simulation.from_file("double_rod")
    >>> with RingRecorder(sim, "end.mcap", 2.0, when="abs(elbow.velocity) > 4"):  # doctest: +SKIP
    ...     sim.run(until=60.0)
    """

    __repr__ = short_repr

    def __init__(
        self,
        simulation: BaseSimulation,
        path: str | Path,
        seconds: float,
        *,
        when: str = "",
        after: float = 0.0,
        **options: Any,
    ) -> None:
        """Begin.

        :param path: .mcap; a second file has `_part2` in its name.
        :param seconds: of simulated time that are kept.
        :param when: `impact`, or a condition, see `Threshold`; then the files are written, once, and recording ends. By
            default they are written at the end, also if the motion diverges.
        :param after: seconds that are recorded after the event.
        :param options: of `RunRecorder`.
        :raises InputError, RecordingError: see `RunRecorder`; a time or a condition is not possible.
        """
        if not (seconds > 0.0 and after >= 0.0):
            message = f"a ring of {seconds:g} s, and {after:g} s after its event, is not possible"
            raise InputError(message, "Give positive times.")
        self.path, self.cause, self.written = Path(path), "", tuple[Path, ...]()
        self._simulation, self._options, self._after = simulation, options, after
        self._steps = max(round(seconds / simulation.step_size), 1)
        self._on_impact = when == IMPACT
        self._threshold = Threshold(simulation, when) if when and not self._on_impact else None
        self._check_steps = max(round(1.0 / CHECKS / simulation.step_size), 1)
        self._ends_at: int | None = None
        self._count = 0  # steps in the present file
        self._recorder: RunRecorder | None = None
        if not self.path.parent.is_dir():
            raise InputError(f"{path}: there is no folder {self.path.parent}", "Create it, or choose another file.")
        self._folder = Path(tempfile.mkdtemp(prefix=f".{self.path.stem}_ring_", dir=self.path.parent))
        self._files: list[Path] = []
        try:
            self._begin_file()
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        problem = str(error) if isinstance(error, Exception) else ""
        if (self._threshold is None and not self._on_impact) or problem or self._ends_at is not None:
            self.write(problem or "end of the run", problem)
        self.close()

    @property
    def is_recording(self) -> bool:
        """Whether the files have not been written yet."""
        return self._recorder is not None

    def write(self, cause: str = "request", problem: str = "") -> tuple[Path, ...]:
        """Write what there is now, and record nothing any more; returns the files.

        :param problem: why the run ends, recorded as an event.
        :raises RecordingError: they cannot be written.
        """
        if self._recorder is None:
            return self.written
        self._end_file(problem)
        self.cause = self.cause or cause
        paths = RecordingPaths(self.path)
        try:
            for number, file in enumerate(self._files):
                shutil.move(file, paths.file(number))
        except OSError as error:
            raise RecordingError(f"cannot write {self.path}: {error.strerror or error}.") from error
        self.written = tuple(paths.file(number) for number in range(len(self._files)))
        if len(self.written) == 1:  # of an earlier ring
            paths.file(1).unlink(missing_ok=True)
        self.close()
        return self.written

    def close(self) -> None:
        """Record nothing any more, and remove what has not been written."""
        if self._recorder is not None:
            self._end_file("")
        shutil.rmtree(self._folder, ignore_errors=True)

    def parts_of(self, steps: int) -> Iterator[int]:
        """Divide steps at states to record and at ends of files; see `RunListener`."""
        while steps > 0:
            if self._recorder is None:
                yield steps
                return
            part = min(steps, self._steps - self._count)
            if (self._threshold is not None or self._on_impact) and self._ends_at is None:
                part = min(part, self._check_steps)
            if self._ends_at is not None:
                part = min(part, max(self._ends_at - self._simulation.steps, 1))
            yield from self._recorder.parts_of(part)
            steps -= part
            self._count += part
            self._after_part()

    def report(self, kind: EventKind, payload: Payload = None) -> None:
        """Record an event; see `RunListener`."""
        if self._recorder is None:
            return
        self._recorder.report(kind, payload)
        if kind is EventKind.CONTACT and self._on_impact and _is_impact(str(payload)):
            self._triggered(str(payload))

    def _triggered(self, cause: str) -> None:
        if self._ends_at is None:
            self.cause = cause
            self._ends_at = self._simulation.steps + round(self._after / self._simulation.step_size)

    def _after_part(self) -> None:
        if self._threshold is not None and self._ends_at is None and self._threshold.holds():
            self._triggered(f"{self._threshold.text} at t = {self._simulation.time:.9g} s")
        if self._ends_at is not None and self._simulation.steps >= self._ends_at:
            self.write()
        elif self._count >= self._steps:
            self._end_file("")
            for old in self._files[:-1]:
                old.unlink(missing_ok=True)
            self._files = self._files[-1:]
            self._begin_file()

    def _begin_file(self) -> None:
        self._count = 0
        file = self._folder / f"{self._simulation.steps}_{len(self._files)}{self.path.suffix}"
        self._recorder = RunRecorder(self._simulation, file, **self._options)
        self._simulation.listen(None)
        self._simulation.listen(self)
        self._files.append(file)

    def _end_file(self, problem: str) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.close(problem)


def _is_impact(text: str) -> bool:
    return f": {ContactChange.IMPACT} at " in text
