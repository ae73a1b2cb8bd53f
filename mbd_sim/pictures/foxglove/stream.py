"""A server for Foxglove, and the topics on which it shows the samples of a motion.

Topics of joints, energies and markers have the names that a node gives them, so that layouts serve for both. The scene
is sent once more whenever somebody begins to look, because nothing sent before is kept.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import foxglove
import numpy as np
from foxglove.channels import FrameTransformsChannel, LogChannel, SceneUpdateChannel
from foxglove.messages import FrameTransform, FrameTransforms, Log, LogLevel, SceneUpdate
from foxglove.websocket import Capability, ChannelView, Client, ServerListener

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import quaternions
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.pictures.foxglove.entities import (
    MovingEntities,
    fixed_entities,
    nanoseconds,
    quaternion,
    timestamp,
    vector,
)
from mbd_sim.pictures.rerun.scene import LoggedEvent, PartPoses, Rows, SceneDescription, coordinates
from mbd_sim.pictures.rerun.sinks import ViewerError
from mbd_sim.simulation.model.state_records import Energies
from mbd_sim.simulation.run.events import ERRORS, EventKind

HOST = "127.0.0.1"
LINGER = 0.3  # s
BACKLOG = 4096  # messages that wait for a slow client, before the oldest are dropped
MARKERS, TRANSFORMS, JOINTS, ENERGIES, EVENTS = "/markers", "/tf", "/joint_states", "/energies", "/events"
COMPONENTS = {1: ("value",), 3: ("x", "y", "z"), 4: ("x", "y", "z", "w")}  # of a measured quantity

_NUMBER = {"type": "number"}
_NUMBERS = {"type": "array", "items": _NUMBER}
_STAMP = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_HEADER = {"type": "object", "properties": {"stamp": _STAMP, "frame_id": {"type": "string"}}}


def _schema(title: str, properties: dict[str, Any]) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties}


JOINTS_SCHEMA = _schema(
    "mbd_sim.JointState",
    {
        "header": _HEADER,
        "name": {"type": "array", "items": {"type": "string"}},
        "position": _NUMBERS,
        "velocity": _NUMBERS,
        "effort": _NUMBERS,
    },
)
ENERGIES_SCHEMA = _schema(
    "mbd_sim.Energies", {"header": _HEADER, **dict.fromkeys(Energies._fields, _NUMBER), "data": _NUMBERS}
)


class FoxgloveStream:
    """One server. `address` is what Foxglove connects to."""

    def __init__(
        self,
        scene: SceneDescription,
        port: int,
        *,
        on_watched: Callable[[], None] = lambda: None,
        **options: Any,
    ) -> None:
        """Start the server.

        :param on_watched: called whenever somebody begins to look at a topic, in a thread of the server.
        :param options: further ones of `foxglove.start_server`.
        :raises ViewerError: nothing can listen on the port.
        """
        self._scene, self._context = scene, foxglove.Context()
        self._fixed, self._moving = fixed_entities(scene), MovingEntities(scene)
        self._markers = SceneUpdateChannel(MARKERS, context=self._context)
        self._transforms = FrameTransformsChannel(TRANSFORMS, context=self._context)
        self._joints = foxglove.Channel(JOINTS, schema=JOINTS_SCHEMA, context=self._context)
        self._energies = foxglove.Channel(ENERGIES, schema=ENERGIES_SCHEMA, context=self._context)
        self._events = LogChannel(EVENTS, context=self._context)
        self._sensors: dict[tuple[str, str], foxglove.Channel] = {}
        mechanism = scene.mechanism
        self._names = [*mechanism.coordinate_names, *mechanism.driven_names]
        self._newest: Array | None = None  # the last sample, for those who begin to look later
        self._asked = False
        self._on_watched = on_watched
        options.setdefault("server_listener", _Listener(self.look))
        options["capabilities"] = [Capability.Time, *options.get("capabilities", ())]
        try:
            self.server = foxglove.start_server(
                name=mechanism.name,
                host=HOST,
                port=port,
                context=self._context,
                message_backlog_size=BACKLOG,
                **options,
            )
        except (OSError, RuntimeError) as error:
            reason = f"nothing can listen on port {port} ({error}). Choose another one, or 0 for any that is free"
            raise ViewerError(f"Foxglove's server does not start: {reason}.") from error
        self.address = f"ws://{HOST}:{self.server.port}"

    def look(self) -> None:
        """Somebody begins to look: send the scene with the next data."""
        self._asked = True
        self._on_watched()

    def send_samples(self, values: Array) -> None:
        """Show samples, rows (n, width) of `RowLayout` in the order of their times."""
        self._answer()
        rows = Rows(self._scene.rows, values)
        poses = PartPoses(self._scene, rows)
        if self._markers.has_sinks():
            for at, entities in zip(rows.times.tolist(), self._moving.of(rows, poses), strict=True):
                self._markers.log(SceneUpdate(entities=entities), log_time=nanoseconds(at))
        self._send_transforms(rows)
        self._send_numbers(rows)
        self.server.broadcast_time(nanoseconds(float(rows.times[-1])))
        self._newest = values[-1:]

    def send_events(self, events: Sequence[LoggedEvent]) -> None:
        """Show events."""
        for event in events:
            text = "commands are accepted" if event.kind is EventKind.COMMAND else event.text
            severity = LogLevel.Error if event.kind in ERRORS else LogLevel.Info
            severity = LogLevel.Warning if event.kind in (EventKind.WARNING, EventKind.EXPIRED) else severity
            message = Log(
                timestamp=timestamp(event.time), level=severity, message=text, name=self._scene.mechanism.name
            )
            self._events.log(message, log_time=nanoseconds(event.time))

    def send_measurements(self, sensor: str, quantity: str, times: Array, values: Array) -> None:
        """Show measurements (n, components) of a sensor over the times (n,) in s at which they arrived."""
        channel = self._sensor(sensor, quantity, values.shape[1])
        names = COMPONENTS[values.shape[1]]
        for at, numbers in zip(times.tolist(), values.tolist(), strict=True):
            channel.log({"header": _header(at), **_named(names, numbers)}, log_time=nanoseconds(at))

    def flush(self) -> None:
        """Send the scene and the last sample again to those who began to look while nothing moved."""
        if self._asked and self._newest is not None:
            self.send_samples(self._newest)

    def close(self) -> None:
        """Stop the server, once what it has to send had time to go."""
        if self._joints.has_sinks():
            time.sleep(LINGER)
        self.server.stop()

    def _answer(self) -> None:
        """Send the scene if somebody asked for it."""
        if self._asked:
            self._asked = False
            self._markers.log(SceneUpdate(entities=self._fixed))

    def _send_transforms(self, rows: Rows) -> None:
        if not self._transforms.has_sinks():
            return
        turned = [quaternions(rows.rotations[:, index]) for index in range(len(self._scene.part_names))]
        for number, at in enumerate(rows.times.tolist()):
            transforms = [
                FrameTransform(
                    timestamp=timestamp(at),
                    parent_frame_id=GROUND,
                    child_frame_id=part,
                    translation=vector(rows.positions[number, index]),
                    rotation=quaternion(*np.roll(turned[index][number], 1).tolist()),
                )
                for index, part in enumerate(self._scene.part_names)
            ]
            self._transforms.log(FrameTransforms(transforms=transforms), log_time=nanoseconds(at))

    def _send_numbers(self, rows: Rows) -> None:
        """Send the positions, velocities and efforts of joints, driven ones last, and the energies."""
        scene = self._scene
        speeds = rows.of("y")[:, scene.nq : scene.nq + scene.nv]
        free = (coordinates(scene, rows), speeds, rows.of("inputs")[:, : scene.nv])
        driven = np.split(rows.of("drives"), 3, axis=1)
        motions = [np.hstack(pair).tolist() for pair in zip(free, driven, strict=True)]
        samples = zip(rows.times.tolist(), *motions, rows.of("energies").tolist(), strict=True)
        for at, position, velocity, effort, energies in samples:
            log_time, header = nanoseconds(at), {"header": _header(at)}
            joints = {"name": self._names, "position": position, "velocity": velocity, "effort": effort}
            self._joints.log(header | joints, log_time=log_time)
            named = _named(Energies._fields, energies)
            self._energies.log({**header, **named, "data": [*named.values()]}, log_time=log_time)

    def _sensor(self, sensor: str, quantity: str, components: int) -> foxglove.Channel:
        """The channel of a measured quantity."""
        channel = self._sensors.get((sensor, quantity))
        if channel is None:
            properties = {"header": _HEADER, **dict.fromkeys(COMPONENTS[components], _NUMBER)}
            channel = foxglove.Channel(
                f"/sensors/{sensor}/{quantity}",
                schema=_schema(f"mbd_sim.{quantity}", properties),
                context=self._context,
            )
            self._sensors[sensor, quantity] = channel
        return channel


class _Listener(ServerListener):
    """Tells that somebody begins to look at a topic."""

    def __init__(self, look: Callable[[], None]) -> None:
        self._look = look

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._look()


def _header(at: float) -> dict[str, Any]:
    seconds, rest = divmod(nanoseconds(at), 1_000_000_000)
    return {"stamp": {"sec": seconds, "nsec": rest}, "frame_id": GROUND}


def _named(names: Sequence[str], numbers: Sequence[float]) -> dict[str, float | None]:
    """Numbers by name; JSON has none that are not finite."""
    return {name: number if math.isfinite(number) else None for name, number in zip(names, numbers, strict=True)}
