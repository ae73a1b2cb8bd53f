"""The scene of a page: bodies, lines between points, arrows and traces, as a frame has them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array, identity_pose, pack_poses, unpack_poses
from mbd_sim.lab.scene.arrows import NOWHERE, Arrows
from mbd_sim.lab.scene.bodies import Bodies, Dragged
from mbd_sim.lab.scene.contacts import ContactNodes
from mbd_sim.lab.scene.ground import add_ground
from mbd_sim.lab.scene.traces import Traces
from mbd_sim.lab.scene.vectors import VIEWS, Vectors
from mbd_sim.lab.session.frames import Frame
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes import palette, solids
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.joints import weight
from mbd_sim.pictures.shapes.primitives import Connector, connectors
from mbd_sim.pictures.shapes.solids import LINE_WIDTH
from mbd_sim.simulation.model.model import Model

KEPT = (150, 150, 150)  # color of paths that were kept


@dataclass
class Shown:
    """What the user has chosen to see; the other vectors are those that the session was asked to watch."""

    traces: bool = True
    contacts: bool = True


class _Between:
    """A line of a shape along z from 0 to 1 that leads from one point to another."""

    def __init__(self, handle: Any, ends: tuple[Attachment, ...], pairs: Array | None) -> None:
        self.handle, self.ends, self._pairs = handle, ends, pairs

    def points(self, ends: list[Array]) -> Array:
        """The segments (n, 2, 3) for the ends (3,) in ground's frame."""
        if self._pairs is None:
            return np.stack([ends[:-1], ends[1:]], axis=1)
        return solids.between(self._pairs, ends[0], ends[1]).reshape(-1, 2, 3)


class Scene:
    """A mechanism in the scene of a server of viser."""

    def __init__(
        self, scene: Any, model: Model, extent: Extent, dragged: Dragged | None, *, dark: bool, in_file: bool = False
    ) -> None:
        """Build all nodes.

        :param scene: the `scene` of viser's server.
        :param dragged: called in a thread of viser while a part is dragged.
        :param in_file: for a file that plays it, see `Bodies`.
        """
        self._scene, self._model, self._extent = scene, model, extent
        self._mechanism, self._last_time, self.shown = model.mechanism, np.inf, Shown()
        self._looks: tuple[Any, ...] = ()
        self._last_poses = np.empty((0, 12))
        self._index = {name: index for index, name in enumerate((*model.part_names, GROUND))}
        scene.set_up_direction(extent.up)
        add_ground(scene, model.mechanism, extent, dark=dark)
        self._bodies = Bodies(scene, model, extent, dragged, in_file=in_file)
        self._start = {GROUND: identity_pose(), **model.poses(0.0, model.start)}
        self._lines: dict[tuple[str, str], _Between] = {}
        self._connect(model.mechanism)
        self._add_arrows(dark)
        self.traces = Traces(scene, model.mechanism, extent.size)
        self._path, self._kept_paths = (
            scene.add_line_segments(name, NOWHERE, color, thickness=0.6 * LINE_WIDTH * extent.size)
            for name, color in (("/path", palette.CURVE), ("/kept_paths", KEPT))
        )
        self._kept: list[tuple[Array, str]] = []
        self._labels: list[Any] = []

    def show(self, frame: Frame) -> None:
        """Move everything to a frame; nothing is sent for one that looks like the last one."""
        if self._shows(frame):
            return
        if frame.mechanism is not self._mechanism:
            self._reshape(frame.mechanism)
        self._poses = np.vstack([frame.poses, pack_poses(np.zeros(3), np.eye(3))])
        self._bodies.move(self._poses)
        for line in self._lines.values():
            line.handle.points = line.points([self._at(end) for end in line.ends]).astype(np.float32)
        self._show_arrows(frame)
        if frame.time < self._last_time or not self.shown.traces:
            self.traces.forget()
        if self.shown.traces:
            self.traces.extend(self._at)
        self._last_time = frame.time

    def _shows(self, frame: Frame) -> bool:
        """Whether the last frame and the choices of then look the same."""
        new = frame.mechanism, frame.pull, replace(self.shown), self.traces.chosen
        if frame.watched or frame.pull or new != self._looks or not np.array_equal(frame.poses, self._last_poses):
            self._looks, self._last_poses = new, frame.poses
            return False
        return frame.time == self._last_time

    def look_like(self, other: Scene) -> None:
        """Show the traces and paths that were chosen in another scene of the mechanism."""
        self.shown = replace(other.shown)
        self.traces.choose(other.traces.chosen)
        self._path.points = other._path.points.copy()
        for points, label in other._kept:
            self._keep(points, label)

    def draw_ahead(self, mechanisms: Iterable[Mechanism]) -> None:
        """Draw the bodies of mechanisms with other values, of which the last one stays shown."""
        for mechanism in mechanisms:
            self._bodies.reshape(mechanism)

    def draw_path(self, points: Array) -> None:
        """Draw a line through points (n, 3) that do not move."""
        self._path.points = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32) if len(points) else NOWHERE

    def keep_path(self, label: str) -> None:
        """Keep the present path in gray, under a label, so that later ones can be compared with it."""
        if len(self._path.points):
            self._keep(self._path.points.copy(), label)

    def clear_kept_paths(self) -> None:
        """Remove the paths that were kept."""
        self._kept.clear()
        self._kept_paths.points = NOWHERE
        for label in self._labels:
            label.remove()
        self._labels.clear()

    def _keep(self, segments: Array, label: str) -> None:
        """Draw segments (n, 2, 3) in gray, with a label a sixth of the path farther than that of the last one."""
        number = len(self._kept)
        self._kept.append((segments, label))
        self._kept_paths.points = np.concatenate([one for one, _ in self._kept])
        place = segments[number * len(segments) // 6 % len(segments), 0]
        self._labels.append(self._scene.add_label(f"/kept_paths/{number}", label, position=place))

    def _reshape(self, mechanism: Mechanism) -> None:
        """Draw a mechanism with other values, such as lengths."""
        self._mechanism = mechanism
        self._bodies.reshape(mechanism)
        self._connect(mechanism)
        self.traces.forget()
        self.traces.follow(mechanism)

    def _connect(self, mechanism: Mechanism) -> None:
        """Lead the lines to the points of a mechanism; a spring appears with its stiffness."""
        before, self._lines = self._lines, {}
        for one in connectors(mechanism, self._extent, self._start):
            key = one.kind, one.name
            self._lines[key] = before.pop(key) if key in before else self._connected(one)
            self._lines[key].ends = one.points
        for gone in before.values():
            gone.handle.remove()

    def _at(self, end: Attachment) -> Array:
        position, rotation = unpack_poses(self._poses[self._index[end.part]])
        return np.asarray(position + rotation @ end.point)

    def _connected(self, one: Connector) -> _Between:
        """The lines of a spring, a cylinder, a rod or a rope."""
        width, pairs = 2.0 * one.radius, None
        if one.form == "coil":
            width = LINE_WIDTH * self._extent.size
            pairs = np.repeat(solids.coil(one.radius)[::3], 2, axis=0)[1:-1]
        elif one.form == "cylinder":
            width, pairs = LINE_WIDTH * self._extent.size, solids.dashpot(one.radius)
        handle = self._scene.add_line_segments(f"/{one.kind}/{one.name}", NOWHERE, one.color, thickness=width)
        return _Between(handle, one.points, pairs)

    def _add_arrows(self, dark: bool) -> None:
        """Contact forces, the force of a hand, and what the views read."""
        mechanism, size = self._mechanism, self._extent.size
        force = weight(mechanism, size), 1.0
        self._contacts = ContactNodes(self._scene, self._extent, force[0], dark=dark)
        self._pull = Arrows(self._scene, "pull", palette.APPLIED, size, force)
        self._string = self._scene.add_line_segments(
            "/string", NOWHERE, palette.APPLIED, thickness=0.5 * LINE_WIDTH * size
        )
        self._views = {
            view.key: Arrows(self._scene, view.key, view.colors[dark], size, view.full(mechanism, size))
            for view in VIEWS
        }

    def _show_arrows(self, frame: Frame) -> None:
        if self.shown.contacts:
            self._contacts.show(frame.contacts)
        else:
            self._contacts.hide()
        for key, arrows in self._views.items():
            arrows.show(frame.watched.get(key) or Vectors())
        self._pull.show(Vectors([] if frame.pull is None else [(frame.pull[0], frame.pull[2])]))
        string = NOWHERE if frame.pull is None else np.array([frame.pull[:2]], dtype=np.float32)
        if len(string) or len(self._string.points):
            self._string.points = string
