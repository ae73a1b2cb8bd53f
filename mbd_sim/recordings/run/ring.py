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
from mbd_sim.recordings.run.paths import RecordingError, RecordingPaths
from mbd_sim.recordings.run.run_recorder import RunRecorder
from mbd_sim.recordings.run.run_watch import RunWatch
from mbd_sim.simulation.run.events import EventKind, Payload
from mbd_sim.simulation.run.simulation import BaseSimulation


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
        :param when: `impact`, or a condition, see `RunWatch`; then the files are written, once, and recording ends. By
            default they are written at the end, also if the motion diverges.
        :param after: seconds that are recorded after the event.
        :param options: of `RunRecorder`.
        :raises InputError, RecordingError: see `RunRecorder`; a time or a condition is not possible.
        """
        if not (seconds > 0.0 and after >= 0.0):
            message = f"a ring of {seconds:g} s, and {after:g} s after its event, is not possible"
            raise InputError(message, "Give positive times.")
        self.path, self.cause, self.written = Path(path), "", tuple[Path, ...]()
        self._simulation, self._options = simulation, options
        self._steps = max(round(seconds / simulation.step_size), 1)
        self._watch = RunWatch(simulation, when, after)
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
        if not self._watch.looks or problem or self._watch.has_event:
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
        self.cause = self._watch.cause or cause
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
            part = self._watch.most_steps(min(steps, self._steps - self._count))
            yield from self._recorder.parts_of(part)
            steps -= part
            self._count += part
            self._after_part(part)

    def report(self, kind: EventKind, payload: Payload = None) -> None:
        """Record an event; see `RunListener`."""
        if self._recorder is None:
            return
        self._recorder.report(kind, payload)
        self._watch.notice(kind, payload)

    def _after_part(self, steps: int) -> None:
        if self._watch.passed(steps):
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
