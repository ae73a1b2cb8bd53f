"""A batch of samples as columns of the recording: one call per entity, not one per row."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from mbd_sim.mechanism.model import Array
from mbd_sim.mechanism.rotation import quaternions
from mbd_sim.model import Energies, Model
from mbd_sim.viewer import paths
from mbd_sim.viewer.extent import tip_of

if TYPE_CHECKING:
    from rerun import RecordingStream

PAUSE = 5e-5  # s between two columns: a thread that waits for the interpreter gets it, which a pause of 0 would not do

Sample = tuple[float, Array, Array, Energies, float]
Event = tuple[float, str]


class Columns:
    """Sends samples of one model to one recording; remembers the last one, where the traces go on."""

    def __init__(self, recording: RecordingStream, model: Model) -> None:
        self._recording, self._model = recording, model
        self._tips = {name: tip_of(model.mechanism.parts[name]) for name in paths.ends(model.mechanism)}
        self._ends: dict[str, Array] = {}
        self._last_time = -np.inf

    def send(self, samples: Sequence[Sample]) -> None:
        """Send at least one sample, in the order of their times (s)."""
        model = self._model
        times = np.array([sample[0] for sample in samples])
        poses = np.array([model.pose_array(sample[4], sample[1]) for sample in samples])
        for index, name in enumerate(model.part_names):
            position, matrix = poses[:, index, :3], poses[:, index, 3:].reshape(-1, 3, 3).transpose(0, 2, 1)
            placed = rr.Transform3D.columns(translation=position, quaternion=quaternions(matrix))
            self._send(paths.part(name), times, placed)
            if name in self._tips:
                self._trace(name, times, position + matrix @ self._tips[name])
        if model.layout.nv:
            self._scalars(paths.POSITION, times, np.array([model.coordinates(sample[1]) for sample in samples]))
            self._scalars(paths.VELOCITY, times, np.array([sample[1][model.u_range] for sample in samples]))
            self._scalars(paths.EFFORT, times, np.array([sample[2] for sample in samples]))
        audit = [sample[3] for sample in samples]
        self._scalars(paths.BALANCE, times, np.array([(e.kinetic, e.potential, e.total) for e in audit]))
        exchange = np.array([(e.dissipated, e.work_applied, e.work_drives) for e in audit])
        self._scalars(paths.EXCHANGE, times, exchange)
        self._scalars(paths.RESIDUAL, times, np.array([[e.residual / paths.PICO] for e in audit]))
        self._last_time = times[-1]

    def send_events(self, events: Sequence[Event]) -> None:
        """Write at least one line to the log, at its time (s)."""
        texts = [text for _, text in events]
        self._send(paths.EVENTS, np.array([at for at, _ in events]), rr.TextLog.columns(text=texts))

    def _trace(self, name: str, times: Array, ends: Array) -> None:
        """Each row is the way from the sample before; the view shows those of the last second or so."""
        before = self._ends.get(name, ends[0]) if times[0] > self._last_time else ends[0]
        pieces = np.stack([np.vstack([before, ends[:-1]]), ends], axis=1)
        self._ends[name] = ends[-1]
        self._send(paths.trace(name), times, rr.LineStrips3D.columns(strips=list(pieces)))

    def _scalars(self, entity: str, times: Array, values: Array) -> None:
        columns = rr.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(times))
        self._send(entity, times, columns)

    def _send(self, entity: str, times: Array, columns: Any) -> None:
        index = rr.TimeColumn(paths.TIMELINE, duration=times)
        rr.send_columns(entity, indexes=[index], columns=columns, recording=self._recording, strict=True)
        time.sleep(PAUSE)
