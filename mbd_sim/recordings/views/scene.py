"""Shows a recording in a viewer: a run like a live one; in Rerun, one without a mechanism as plots of its joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mbd_sim.base.errors import CommandError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.pictures.rerun import paths
from mbd_sim.pictures.rerun.scene import DisplayOptions, LoggedEvent, RowMaker, SceneDescription, describe_scene
from mbd_sim.pictures.rerun.viewer import EventFilter
from mbd_sim.pictures.rerun.worker import Stream
from mbd_sim.pictures.shapes import palette
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import RUN_METADATA, Message
from mbd_sim.recordings.run.reader import COMMANDS, Recording, TopicRole
from mbd_sim.recordings.run.recomputation import SEQUENCE_MODULUS, Recomputation
from mbd_sim.recordings.views.sensor_columns import SensorTables
from mbd_sim.recordings.views.table import Progress, RunTable, iterate_messages
from mbd_sim.simulation.model.state_records import Energies
from mbd_sim.simulation.run.events import Event, EventKind, parse_event
from mbd_sim.simulation.run.run_point import integrated_energies, recorded_state

AddressCallback = Callable[[str], None]
OpenStream = Callable[[SceneDescription], Stream]
BATCH_SIZE = 1000  # states that are sent at once


def _ignore_address(address: str) -> None:
    """Return at once: a window or a file needs no server."""


def rerun_stream(sink: str) -> OpenStream:
    """What opens a recording in Rerun."""
    from mbd_sim.pictures.rerun.stream import RerunStream

    return lambda scene: RerunStream(scene, sink, live=False)


def show_run(
    recording: Recording,
    recomputation: Recomputation,
    open_stream: OpenStream,
    rate: float,
    options: DisplayOptions,
    progress: Progress,
    on_sent: AddressCallback = _ignore_address,
) -> tuple[str, int, list[str]]:
    """Show a run recorded by `sim_node`; return the viewer's address, the number of states, and problems of the files.

    :param recomputation: that of the first file; it provides the mechanism and takes no steps.
    :param open_stream: opens what shows the scene.
    :param rate: the largest number of states shown per second of simulated time.
    :param on_sent: called with the address when everything has been sent; a server ends when it returns.
    :raises ViewerError: the sink cannot be opened.
    :raises InputError: a point to trace does not exist.
    """
    writer, options = RowMaker(recomputation.simulation.model, options.reactions), replace(options, measurements=True)
    scene = describe_scene(recomputation.simulation.model, writer.layout, options)
    stream = open_stream(scene)
    notes: list[str] = []
    try:
        sender = _RunSender(recomputation, writer, stream, rate, SensorTables(recording))
        for message in iterate_messages(recording, progress, notes):
            sender.add(message)
        count = sender.finish()
        on_sent(stream.address)
    finally:
        stream.close()
    return stream.address, count, notes


class _RunSender:
    """Sends recorded states and events; the simulation only keeps the commanded inputs, and takes no steps."""

    def __init__(
        self,
        recomputation: Recomputation,
        writer: RowMaker,
        stream: Stream,
        rate: float,
        sensors: SensorTables,
    ) -> None:
        self._recomputation, self._writer, self._stream, self._rate = recomputation, writer, stream, rate
        self._tick = recomputation.first_tick
        first_step = int(recomputation.file.metadata[RUN_METADATA].get("first_step", "0"))
        self._zero_tick = self._tick - first_step  # the tick at time zero of the mechanism
        self._event_filter, self._frame = EventFilter(), -1
        self._rows: list[Array] = []
        self._pending: tuple[Message, cdr.JointStates] | None = None  # a state whose energies may follow
        self._y = recomputation.simulation.state
        self._count, self._sensors = 0, sensors
        self._measured: dict[tuple[str, str], list[tuple[float, Sequence[float]]]] = {}

    def add(self, message: Message) -> None:
        """Process the next message."""
        role = self._recomputation.roles.get(message.topic)
        self._tick = self._tick_of(message)
        if role is TopicRole.JOINT_STATES:
            self._add_pending_state()
            frame = int(message.time_ns * 1e-9 * self._rate + 1e-6)
            if frame != self._frame:
                self._frame, self._pending = frame, (message, cdr.joint_states(message.payload))
        elif role is TopicRole.ENERGIES and self._pending is not None:
            state = self._pending[0]
            if (state.time_ns, state.sequence) == (message.time_ns, message.sequence):
                self._add_pending_state(Energies(*cdr.multi_array(message.payload).values.tolist()))
        elif role is TopicRole.SENSORS:
            sensor, _, values = self._sensors.read(message)
            for quantity, numbers in values.items():
                self._measured.setdefault((sensor, quantity), []).append((message.time_ns * 1e-9, numbers))
        elif role is not None and role in COMMANDS:
            self._add_pending_state()
            self._apply(message, role)

    def finish(self) -> int:
        """Send everything that is left; return the number of states."""
        self._add_pending_state()
        self._send_rows()
        self._stream.flush()
        return self._count

    def _apply(self, message: Message, role: TopicRole) -> None:
        """Apply a command, and show it or the event."""
        is_event = role is TopicRole.EVENTS
        if role is TopicRole.NEW_STATES:
            steps = int(cdr.multi_array(message.payload).values[0])
            self._zero_tick, self._frame = self._tick - steps, -1
        if role is TopicRole.LIVE_VALUES:
            self._recomputation.simulation.restore(self._y, max(self._tick - self._zero_tick, 0))
        event = parse_event(cdr.text(message.payload)) if is_event else Event(EventKind.COMMAND)
        if event.kind is EventKind.RESET:
            self._zero_tick, self._frame = self._tick, -1
        if not is_event or event.kind is EventKind.RESET:
            try:
                self._recomputation.apply(message)
            except CommandError as error:
                event = Event(EventKind.WARNING, str(error))
        if role not in (TopicRole.LIVE_VALUES, TopicRole.NEW_STATES) and self._event_filter.accepts(event.kind):
            self._send_rows()
            self._stream.send_events([LoggedEvent(message.time_ns * 1e-9, event.kind, event.text)])

    def _add_pending_state(self, energies: Energies | None = None) -> None:
        """Add the state that is pending; if its energies are not recorded they are computed, without the work."""
        if self._pending is None:
            return
        message, joints = self._pending
        self._pending = None
        simulation = self._recomputation.simulation
        model = simulation.model
        time = (self._tick_of(message) - self._zero_tick) * self._recomputation.recorded_step
        self._y = recorded_state(model, self._y, joints.position, joints.velocity)
        if energies is None:
            energies = model.energies(time, self._y, simulation.start_energy, simulation.inputs)
        else:
            self._y[-3:] = integrated_energies(energies)
        self._rows.append(self._writer.row(message.time_ns * 1e-9, time, self._y, simulation.inputs, energies))
        self._count += 1
        if len(self._rows) >= BATCH_SIZE:
            self._send_rows()

    def _tick_of(self, message: Message) -> int:
        """Return the tick of a message, which may be before or after the present one."""
        half = SEQUENCE_MODULUS // 2
        return self._tick + (message.sequence - self._tick + half) % SEQUENCE_MODULUS - half

    def _send_rows(self) -> None:
        if self._rows:
            self._stream.send_samples(np.array(self._rows))
            self._rows.clear()
        for key, measurements in self._measured.items():
            times, numbers = zip(*measurements, strict=True)
            self._stream.send_measurements(*key, np.array(times), np.array(numbers))
        self._measured.clear()


def show_joint_plots(table: RunTable, sink: str, on_sent: AddressCallback = _ignore_address) -> str:
    """Show the joints of a recording without a mechanism as plots; return the viewer's address.

    :param on_sent: see `show_run`.
    :raises ViewerError: the sink cannot be opened.
    """
    import rerun as rr
    import rerun.blueprint as rrb

    from mbd_sim.pictures.rerun.plots import PlottedCurves
    from mbd_sim.pictures.rerun.sinks import SinkConnection

    quantities = {"position": table.position, "velocity": table.velocity, "effort": table.effort}
    recorded = {name: values for name, values in quantities.items() if not np.all(np.isnan(values))}
    views = [rrb.TimeSeriesView(origin=f"{paths.JOINTS}/{name}", name=name.capitalize()) for name in recorded]
    panels = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
    stream = rr.RecordingStream("mbd_sim")
    time_panel = rrb.TimePanel(state="collapsed", timeline=paths.TIMELINE)
    connection = SinkConnection(stream, sink, rrb.Blueprint(rrb.Vertical(*views), *panels, time_panel))
    try:
        stream.send_recording_name(table.title)
        colors = tuple(palette.PARTS[index % len(palette.PARTS)] for index in range(len(table.names)))
        times = rr.TimeColumn(paths.TIMELINE, duration=table.times)
        for name, values in recorded.items():
            series = PlottedCurves(f"{paths.JOINTS}/{name}", table.names, colors)
            for entity, style in series.style():
                stream.log(entity, style, static=True)
            for entity, columns in series.values(values):
                rr.send_columns(entity, indexes=[times], columns=columns, recording=stream, strict=True)
        stream.flush()
        on_sent(connection.address)
        stream.disconnect()
    finally:
        connection.close()
    return connection.address
