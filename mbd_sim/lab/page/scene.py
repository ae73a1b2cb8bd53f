"""The scene of a page: parts that move by the pose of their frame, lines between points, arrows and traces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, assert_never

import numpy as np

from mbd_sim.base.geometry.pose import Array, identity_pose, pack_poses, unpack_poses
from mbd_sim.base.geometry.rotation import quaternions, to_quaternion
from mbd_sim.files.text.mesh_files import mesh_path
from mbd_sim.lab.session.frames import Frame
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Mesh
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes import palette, solids
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.joints import LONG, LONGEST, default_traces, pulls, weight
from mbd_sim.pictures.shapes.meshes import reason_not_to_draw, triangles
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.primitives import Connector, Lines, Primitive, connectors, primitives, wires
from mbd_sim.pictures.shapes.solids import LINE_WIDTH, Box, Cylinder, Ring, Rod, Sphere
from mbd_sim.simulation.model.model import Model

THIN = 0.25  # of the width of a line, for lines as thin as they can be seen
TRACE_POINTS = 600
SHORT = 1e-3  # relative to the mechanism's size; shorter arrows are not drawn
NOWHERE = np.zeros((0, 2, 3), dtype=np.float32)

Dragged = Callable[[int, str, str, Array, Array], None]  # page, phase, part, point in its frame, pointer in ground's


@dataclass
class Shown:
    """What the user has chosen to see."""

    traces: bool = True
    contacts: bool = True
    reactions: bool = False


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

    def __init__(self, scene: Any, model: Model, extent: Extent, dragged: Dragged | None, *, dark: bool) -> None:
        """Build all nodes.

        :param scene: the `scene` of viser's server.
        :param dragged: called in a thread of viser while a part is dragged.
        """
        self._scene, self._model, self._size, self._dragged = scene, model, extent.size, dragged
        self._names = (*model.part_names, GROUND)
        self._index = {name: index for index, name in enumerate(self._names)}
        self._poses = np.vstack([model.pose_array(0.0, model.start), pack_poses(np.zeros(3), np.eye(3))])
        self._full_force = weight(model.mechanism, extent.size)
        self.shown = Shown()
        self._frames = [scene.add_frame(f"/parts/{name}", show_axes=False) for name in self._names]
        self._last_time = np.inf
        self._add_ground(extent, dark)
        self._source = model.mechanism.source.file
        for number, one in enumerate([*primitives(model.mechanism, extent, self._can_draw), *wires(model, extent)]):
            if not one.hole:
                self._add(f"/parts/{one.part}/{number}", one)
        start = {GROUND: identity_pose(), **model.poses(0.0, model.start)}
        self._lines = [self._connected(one) for one in connectors(model.mechanism, extent, start)]
        self._pushes = [not pulls(model.mechanism, owner) for owner, _ in model.contact_readings.placed]
        self._contacts = self._arrows("contacts", palette.CONTACT if dark else (196, 138, 0))
        self._reactions = self._arrows("reactions", palette.REACTION if dark else (0, 120, 190))
        self._pull = self._arrows("pull", palette.APPLIED)
        self._string = scene.add_line_segments(
            "/string", NOWHERE, palette.APPLIED, thickness=0.5 * LINE_WIDTH * self._size
        )
        self._add_traces(model.mechanism)
        self._dark = dark

    def show(self, frame: Frame) -> None:
        """Move everything to a frame."""
        ground = pack_poses(np.zeros(3), np.eye(3))
        poses = self._poses = np.vstack([frame.poses, ground])
        positions, rotations = unpack_poses(poses)
        for handle, position, xyzw in zip(self._frames, positions, quaternions(rotations), strict=True):
            handle.position = position
            handle.wxyz = np.roll(xyzw, 1)
        for line in self._lines:
            line.handle.points = line.points([self._at(end) for end in line.ends]).astype(np.float32)
        self._show_arrows(frame)
        if frame.time < self._last_time or not self.shown.traces:
            self._forget_traces()
        if frame.time != self._last_time and self.shown.traces:
            self._extend_traces()
        self._last_time = frame.time

    def clear_traces(self) -> None:
        """Forget the traces, as after a change of a length."""
        self._forget_traces()

    def _at(self, end: Attachment) -> Array:
        position, rotation = unpack_poses(self._poses[self._index[end.part]])
        return np.asarray(position + rotation @ end.point)

    def _add_ground(self, extent: Extent, dark: bool) -> None:
        """A grid: the plane behind a mechanism that moves in a plane, otherwise the floor below it."""
        normal = extent.normal
        side = 2.5 * float(np.max(extent.upper - extent.lower))
        position, plane = extent.center.copy(), "xy"
        if normal is not None and abs(normal[2]) < 0.5:
            plane = "xz" if abs(normal[1]) > abs(normal[0]) else "yz"
            axis = 1 if plane == "xz" else 0
            position[axis] += (1.0 if plane == "xz" else -1.0) * 0.15 * extent.size
        else:
            position[2] = extent.lower[2] - 0.02 * extent.size
        cell = 10.0 ** np.floor(np.log10(side / 4.0))
        self._scene.add_grid(
            "/grid",
            width=side,
            height=side,
            plane=plane,
            position=position,
            cell_size=cell,
            section_size=5.0 * cell,
            cell_color=(52, 58, 68) if dark else (226, 229, 234),
            section_color=(74, 82, 94) if dark else (198, 204, 212),
            shadow_opacity=0.0,
        )

    def _add(self, path: str, primitive: Primitive) -> None:
        pose = primitive.pose
        place = {"position": pose.position, "wxyz": to_quaternion(pose.rotation), "color": primitive.color}
        add = self._scene
        match primitive.form:
            case Rod(length, radius):
                handles = [add.add_cylinder(path, radius=radius, height=length, **place)]
                for end in (-0.5, 0.5):
                    center = pose.position + end * length * pose.rotation[:, 2]
                    ball = {"position": center, "color": primitive.color}
                    handles.append(add.add_icosphere(f"{path}/{end}", radius=radius, **_local(ball, pose)))
            case Cylinder(length, radius):
                handles = [add.add_cylinder(path, radius=radius, height=length, radial_segments=48, **place)]
            case Ring(radius, tube):
                import trimesh

                mesh = trimesh.creation.torus(radius, tube, major_sections=64, minor_sections=12)
                handles = [add.add_mesh_simple(path, mesh.vertices, mesh.faces, **place)]
            case Box(size):
                handles = [add.add_box(path, dimensions=size, **place)]
            case Sphere(radius):
                handles = [add.add_icosphere(path, radius=radius, **place)]
            case Lines(strips, radius):
                segments = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in strips])
                color, width = place.pop("color"), 2.0 * radius or THIN * LINE_WIDTH * self._size
                add.add_line_segments(path, segments.astype(np.float32), color, thickness=width, **place)
                return
            case Mesh() as mesh:
                file = mesh_path(mesh.file, self._source)
                assert file is not None
                corners = triangles(file) * np.array(mesh.scale)
                faces = np.arange(3 * len(corners)).reshape(-1, 3)
                handles = [add.add_mesh_simple(path, corners.reshape(-1, 3), faces, side="double", **place)]
            case _ as unknown:
                assert_never(unknown)
        if self._dragged is not None and primitive.part != GROUND:
            for handle in handles:
                handle.on_drag("left")(self._drag_of(primitive.part))

    def _drag_of(self, part: str) -> Callable[[Any], None]:
        """Passes on the drags of a part, with the grabbed point in its frame."""
        held: dict[int, Array] = {}

        def on_drag(event: Any) -> None:
            if event.phase == "start":
                position, rotation = unpack_poses(self._poses[self._index[part]])
                held[event.client_id] = rotation.T @ (np.array(event.start_position) - position)
            point = held.get(event.client_id)
            if point is not None and self._dragged is not None:
                self._dragged(event.client_id, event.phase, part, point, np.array(event.end_position))

        return on_drag

    def _can_draw(self, mesh: Mesh) -> bool:
        path = mesh_path(mesh.file, self._source)
        return path is not None and not reason_not_to_draw(path)

    def _connected(self, one: Connector) -> _Between:
        """The lines of a spring, a cylinder, a rod or a rope."""
        width, pairs = 2.0 * one.radius, None
        if one.form == "coil":
            width = LINE_WIDTH * self._size
            pairs = np.repeat(solids.coil(one.radius)[::3], 2, axis=0)[1:-1]
        elif one.form == "cylinder":
            width, pairs = LINE_WIDTH * self._size, solids.dashpot(one.radius)
        handle = self._scene.add_line_segments(f"/{one.kind}/{one.name}", NOWHERE, one.color, thickness=width)
        return _Between(handle, one.points, pairs)

    def _arrows(self, name: str, color: Color) -> Any:
        size = self._size
        return self._scene.add_arrows(
            f"/{name}", NOWHERE, color, shaft_radius=0.006 * size, head_radius=0.016 * size, head_length=0.045 * size
        )

    def _show_arrows(self, frame: Frame) -> None:
        contacts = frame.contacts if self.shown.contacts else np.empty((0, 6))
        pushes = self._pushes[: len(contacts)]
        self._set(self._contacts, [self._arrow(row[:3], row[3:], p) for row, p in zip(contacts, pushes, strict=True)])
        joints, mechanism = frame.reactions, self._model.mechanism
        ends = {name: Attachment(one.child, one.child_pose.position) for name, one in mechanism.all_joints.items()}
        self._set(self._reactions, [self._arrow(self._at(ends[name]), force) for name, force in joints.items()])
        held = [] if frame.pull is None else [self._arrow(frame.pull[0], frame.pull[2])]
        self._set(self._pull, held)
        string = NOWHERE if frame.pull is None else np.array([frame.pull[:2]], dtype=np.float32)
        if len(string) or len(self._string.points):
            self._string.points = string

    def _arrow(self, point: Array, force: Array, push: bool = False) -> Array | None:
        """The ends (2, 3) of the arrow of a force (3,) in N; None if it is too short to be seen."""
        magnitude = float(np.linalg.norm(force))
        length = min(LONG * magnitude / self._full_force, LONGEST)
        if not length > SHORT:
            return None
        along = length * self._size * force / magnitude
        return np.array([point - along, point] if push else [point, point + along])

    def _set(self, handle: Any, arrows: list[Array | None]) -> None:
        drawn = [arrow for arrow in arrows if arrow is not None]
        if drawn or len(handle.points):
            handle.points = np.array(drawn, dtype=np.float32).reshape(-1, 2, 3)

    def _add_traces(self, mechanism: Mechanism) -> None:
        colors = palette.part_colors(mechanism)
        self._traces: Mapping[str, tuple[Attachment, list[Array], Any]] = {
            name: (
                at,
                [],
                self._scene.add_line_segments(
                    f"/traces/{name}", NOWHERE, colors[name], thickness=0.6 * LINE_WIDTH * self._size
                ),
            )
            for name, at in default_traces(mechanism).items()
        }

    def _extend_traces(self) -> None:
        for at, points, handle in self._traces.values():
            here = self._at(at)
            if points and np.linalg.norm(here - points[-1]) < 2e-3 * self._size:
                continue
            points.append(here)
            del points[:-TRACE_POINTS]
            if len(points) > 1:
                handle.points = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)

    def _forget_traces(self) -> None:
        for _, points, handle in self._traces.values():
            if points:
                points.clear()
                handle.points = NOWHERE


def _local(place: dict[str, Any], pose: Any) -> dict[str, Any]:
    """The placing of a child of a node at `pose`, given in the frame of that node's parent."""
    return {**place, "position": pose.rotation.T @ (place["position"] - pose.position)}
