"""`mbd_sim view`: a recording as Rerun shows a live run; of a foreign one, the joints as plots."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.errors import CommandError, MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import of_vector
from mbd_sim.playback.run_table import Progress, RunTable, each
from mbd_sim.recording import cdr
from mbd_sim.recording.contents import Message
from mbd_sim.recording.reader import ABOUT, Recording
from mbd_sim.recording.recomputation import (
    EFFORTS,
    ENERGIES,
    EVENTS,
    LIVE,
    STATES,
    WRENCHES,
    Recomputation,
)
from mbd_sim.simulation.compiled_model import Energies
from mbd_sim.simulation.events import Event, EventKind, parse_event
from mbd_sim.viewer.event_filter import EventFilter
from mbd_sim.viewer.sample_rows import RowWriter
from mbd_sim.viewer.scene_description import DisplayOptions, describe_scene

if TYPE_CHECKING:
    from mbd_sim.viewer.rerun_stream import RerunStream

Hold = Callable[[str], None]
BATCH = 1000  # samples that are sent at once
_AROUND = 1 << 32  # of the steps, only the remainder by this is recorded


def _go_on(address: str) -> None:
    """Nothing to wait for."""


def show(
    recording: Recording,
    replica: Recomputation,
    sink: str,
    rate: float,
    options: DisplayOptions,
    progress: Progress,
    hold: Hold = _go_on,
) -> tuple[str, int, list[str]]:
    """Show a run of ours; returns where to look, how many states were shown, and what was wrong with the files.

    :param replica: the simulation of its first file.

    :param rate: states for each second of simulated time, at most.
    :param hold: called with the address when all is sent; a server ends when it returns.
    :raises ViewerError: the sink cannot be opened.
    :raises MbdSimError: a point to trace does not exist.
    """
    from mbd_sim.viewer.rerun_stream import RerunStream

    writer = RowWriter(replica.simulation.model, options.reactions)
    try:
        scene = describe_scene(replica.simulation.model, writer.layout, options)
    except ValueError as error:
        raise MbdSimError(str(error)) from error
    stream = RerunStream(scene, sink, live=False)
    notes: list[str] = []
    try:
        shown = _Run(recording, replica, writer, stream, rate)
        for message in each(recording, progress, notes):
            shown.take(message)
        count = shown.finish()
        hold(stream.address)
    finally:
        stream.close()
    return stream.address, count, notes


class _Run:
    """Goes through a recording; the simulation only keeps the inputs that were commanded, and takes no steps."""

    def __init__(
        self, recording: Recording, replica: Recomputation, writer: RowWriter, stream: RerunStream, rate: float
    ) -> None:
        self._replica, self._writer, self._stream, self._rate = replica, writer, stream, rate
        self._step = replica.recorded_step
        self._tick = replica.first_tick
        # Of the mechanism's own steps behind the ticks.
        self._lag = self._tick - int(replica.part.metadata[ABOUT].get("first_step", "0"))
        self._event_filter, self._frame = EventFilter(), -1
        self._rows: list[Array] = []
        self._pending: tuple[Message, cdr.JointStates] | None = None
        self._y = replica.simulation.state
        self._count = 0

    def take(self, message: Message) -> None:
        """The next message."""
        role = self._replica.roles.get(message.topic)
        self._tick = self._tick_of(message)
        if role == STATES:
            self._emit(None)
            frame = int(message.time_ns * 1e-9 * self._rate + 1e-6)
            if frame != self._frame:
                self._frame, self._pending = frame, (message, cdr.joint_states(message.payload))
        elif role == ENERGIES and self._pending is not None:
            state = self._pending[0]
            if (state.time_ns, state.sequence) == (message.time_ns, message.sequence):
                self._emit(Energies(*cdr.numbers(message.payload).values.tolist()))
        elif role in (EFFORTS, WRENCHES, LIVE, EVENTS):
            self._emit(None)
            self._command(message, role)

    def finish(self) -> int:
        """Send what waits; returns the number of states."""
        self._emit(None)
        self._send()
        self._stream.flush()
        return self._count

    def _command(self, message: Message, role: str) -> None:
        time, simulation = message.time_ns * 1e-9, self._replica.simulation
        if role == LIVE:
            simulation.restore(self._y, max(self._tick - self._lag, 0))
        event = parse_event(cdr.text(message.payload)) if role == EVENTS else Event(EventKind.COMMAND)
        if event.kind is EventKind.RESET:
            self._lag, self._frame = self._tick, -1
        if role != EVENTS or event.kind is EventKind.RESET:
            try:
                self._replica.apply(message)
            except CommandError as error:
                event = Event(EventKind.WARNING, str(error))
        if role != LIVE and self._event_filter.accepts(event.kind):
            self._log(time, event)

    def _log(self, time: float, event: Event) -> None:
        from mbd_sim.viewer.event_log import LoggedEvent

        self._send()
        self._stream.send_events([LoggedEvent(time, event.kind, event.text)])

    def _emit(self, energies: Energies | None) -> None:
        """Show the state that waits; where its energies are not recorded they are computed, without the work."""
        if self._pending is None:
            return
        message, state = self._pending
        self._pending = None
        simulation = self._replica.simulation
        model, own = simulation.model, (self._tick_of(message) - self._lag) * self._step
        y = state_of(self._replica, state, energies, self._y)
        self._y = y
        if energies is None:
            energies = model.energies(own, y, simulation.start_energy, simulation.inputs)
        self._rows.append(self._writer.row(message.time_ns * 1e-9, own, y, simulation.inputs, energies))
        self._count += 1
        if len(self._rows) >= BATCH:
            self._send()

    def _tick_of(self, message: Message) -> int:
        half = _AROUND // 2
        return self._tick + (message.sequence - self._tick + half) % _AROUND - half

    def _send(self) -> None:
        if self._rows:
            self._stream.send_samples(np.array(self._rows))
            self._rows.clear()


def state_of(replica: Recomputation, given: cdr.JointStates, energies: Energies | None, before: Array) -> Array:
    """The integrated state of recorded joints: quaternions from rotation vectors, and the work from the energies."""
    simulation = replica.simulation
    model, y = simulation.model, before.copy()
    free = model.layout.nv
    for name, where in model.layout.q.items():
        values = given.position[model.layout.u[name]]
        if name in model.quaternions:
            offset = model.quaternions[name] - where.start
            values = np.concatenate([values[:offset], of_vector(values[offset:])])
        y[where] = values
    y[model.u_range] = given.velocity[:free]
    if energies is not None:
        y[-3:] = energies.work_applied, energies.work_drives, energies.dissipated
    return y


def show_table(table: RunTable, sink: str, hold: Hold = _go_on) -> str:
    """Show the joints of a recording that holds no mechanism, as plots; returns where to look. `hold`: see `show`.

    :raises ViewerError: the sink cannot be opened.
    """
    import rerun as rr
    import rerun.blueprint as rrb

    from mbd_sim.appearance import palette
    from mbd_sim.viewer import entity_paths
    from mbd_sim.viewer.plot_entities import Series
    from mbd_sim.viewer.sinks import Outlet

    quantities = {"position": table.position, "velocity": table.velocity, "effort": table.effort}
    known = {name: values for name, values in quantities.items() if not np.all(np.isnan(values))}
    views = [rrb.TimeSeriesView(origin=f"{entity_paths.JOINTS}/{name}", name=name.capitalize()) for name in known]
    panels = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
    recording = rr.RecordingStream("mbd_sim")
    time_panel = rrb.TimePanel(state="collapsed", timeline=entity_paths.TIMELINE)
    outlet = Outlet(recording, sink, rrb.Blueprint(rrb.Vertical(*views), *panels, time_panel))
    try:
        recording.send_recording_name(table.title)
        colors = tuple(palette.PARTS[index % len(palette.PARTS)] for index in range(len(table.names)))
        time = rr.TimeColumn(entity_paths.TIMELINE, duration=table.times)
        for name, values in known.items():
            series = Series(f"{entity_paths.JOINTS}/{name}", table.names, colors)
            for entity, style in series.style():
                recording.log(entity, style, static=True)
            for entity, columns in series.values(values):
                rr.send_columns(entity, indexes=[time], columns=columns, recording=recording, strict=True)
        recording.flush()
        hold(outlet.address)
        recording.disconnect()
    finally:
        outlet.close()
    return outlet.address
