"""The topic `markers`: the mechanism as RViz draws it without TF, every marker in ground's frame.

A contact has a ball where it touches, a line along its normal, and an arrow for its force; all shrink to nothing while
it is open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np
from geometry_msgs.msg import Point, Pose, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from mbd_sim.base.geometry import pose as geometry
from mbd_sim.base.geometry.pose import Array, identity_pose, pack_poses, unpack_poses
from mbd_sim.base.geometry.rotation import aligning_z, to_quaternion
from mbd_sim.files.text.mesh_files import resource_uri
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Mesh, Polyhedron
from mbd_sim.pictures.shapes import palette, solids
from mbd_sim.pictures.shapes.extent import Extent, extent_of
from mbd_sim.pictures.shapes.joints import LONG, LONGEST, default_traces, pulls, weight
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.primitives import Connector, Lines, Primitive, connectors, primitives, wires
from mbd_sim.pictures.shapes.solids import (
    LINE_WIDTH,
    Box,
    Cone,
    Cylinder,
    Ellipsoid,
    Prism,
    Ring,
    Rod,
    Sphere,
    circle,
    triangles_of,
)
from mbd_sim.pictures.shapes.touching import NORMAL, SHORT, closed_places, of_shapes
from mbd_sim.recordings.messages.states import Snapshot, ros_poses
from mbd_sim.ros.publishing.publishers import STAMP, MessageTemplate, slot
from mbd_sim.simulation.model.model import Model

CONTACT_COLOR: Color = palette.CONTACT
RADIUS, SHAFT, HEAD, NORMAL_WIDTH = 0.014, 0.012, 0.028, 0.006  # relative to the mechanism's size
NOTHING = 1e-6  # relative to the mechanism's size; RViz does not accept zero


def ball_row(point: Array, closed: bool, size: float) -> Array:
    """The pose and the scale (10,) of the ball of a contact."""
    diameter = 2.0 * RADIUS * size if closed else NOTHING * size
    return np.concatenate([point, [0.0, 0.0, 0.0, 1.0], np.full(3, diameter)])


def normal_row(point: Array, normal: Array, closed: bool, size: float) -> Array:
    """The pose and the scale (10,) of the line along the normal (3,) of a contact, a cylinder along z."""
    if not closed:
        return np.concatenate([point, [0.0, 0.0, 0.0, 1.0], np.full(3, NOTHING * size)])
    w, x, y, z = to_quaternion(aligning_z(normal))
    return np.concatenate([point, [x, y, z, w], np.array([NORMAL_WIDTH, NORMAL_WIDTH, 2.0 * NORMAL]) * size])


def arrow_row(point: Array, force: Array, full_force: float, size: float, pushes: bool) -> Array:
    """The pose and the scale (10,) of the arrow of a force (3,) in N; it points along x.

    :param full_force: in N, which an arrow of `LONG` stands for.
    :param pushes: it ends at the point (3,); otherwise it starts there.
    """
    force_size = float(np.linalg.norm(force))
    length = min(LONG * force_size / full_force, LONGEST)
    if length < SHORT:
        return np.concatenate([point, [0.0, 0.0, 0.0, 1.0], np.full(3, NOTHING * size)])
    rotation = aligning_z(force / force_size)[:, [2, 0, 1]]  # x along the force
    w, x, y, z = to_quaternion(rotation)
    start = point - length * size * rotation[:, 0] if pushes else point
    return np.concatenate([start, [x, y, z, w], np.array([length, SHAFT, HEAD]) * size])


Scale = tuple[float, float, float]
Points = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, eq=False)
class FixedMarker:
    """A marker that moves with a part: its namespace and type, pose in the part's frame, scale in m, and color.

    `points`, in m in the marker's frame, are those of lines and triangles; `mesh` is the URI of a mesh.
    """

    part: str
    namespace: str
    type: int
    pose: geometry.Pose
    scale: Scale
    color: Color
    points: Points = ()
    mesh: str = ""


def fixed_markers(primitive: Primitive, source: str, size: float) -> list[FixedMarker]:
    """A primitive as RViz draws it: a rod with balls at its ends, a ring as a thick line; holes cannot be drawn.

    :param source: the file of the mechanism, from whose folder the paths of meshes count.
    :param size: the length in m of the mechanism.
    """

    def marker(
        type_: int, scale: Scale, pose: geometry.Pose = primitive.pose, points: Array | None = None, mesh: str = ""
    ) -> FixedMarker:
        rows = () if points is None else tuple((x, y, z) for x, y, z in points.tolist())
        return FixedMarker(primitive.part, primitive.kind, type_, pose, scale, primitive.color, rows, mesh)

    if primitive.hole:
        return []
    match primitive.form:
        case Rod(length, radius):
            axis = primitive.pose.rotation[:, 2]
            ends = [geometry.Pose(primitive.pose.position + sign * length / 2.0 * axis, np.eye(3)) for sign in (-1, 1)]
            balls = [marker(Marker.SPHERE, (2.0 * radius,) * 3, end) for end in ends]
            return [marker(Marker.CYLINDER, (2.0 * radius, 2.0 * radius, length)), *balls]
        case Cylinder(length, radius):
            return [marker(Marker.CYLINDER, (2.0 * radius, 2.0 * radius, length))]
        case Ring(radius, tube):
            rim = np.column_stack([radius * circle(np.linspace(0.0, 2.0 * np.pi, 49)), np.zeros(49)])
            return [marker(Marker.LINE_STRIP, (2.0 * tube, 0.0, 0.0), points=rim)]
        case Box(sides):
            return [marker(Marker.CUBE, sides)]
        case Sphere(radius):
            return [marker(Marker.SPHERE, (2.0 * radius,) * 3)]
        case Ellipsoid((x, y, z)):
            return [marker(Marker.SPHERE, (2.0 * x, 2.0 * y, 2.0 * z))]
        case Cone() | Polyhedron() | Prism() as solid:
            return [marker(Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0), points=triangles_of(solid).reshape(-1, 3))]
        case Lines(strips, radius):
            width = 2.0 * radius or THIN * size
            return [marker(Marker.LINE_STRIP, (width, 0.0, 0.0), points=strip) for strip in strips]
        case Mesh(file=file, scale=scale):
            return [marker(Marker.MESH_RESOURCE, scale, mesh=resource_uri(file, source))]
        case _:
            assert_never(primitive.form)


TRACE_POINTS = 150  # five seconds at 30 Hz
THIN = 0.003  # width of a thin line, relative to the mechanism's size

LineKind = Literal["coil", "cylinder", "line", "trace"]


@dataclass(frozen=True, eq=False)
class _MovingLine:
    """A line whose points are computed for each message from those of parts.

    `ends` are rows of `_AttachedPoints`, `number` is that of the marker and `count` how many points it has. `shape` are
    the points along z of a coil or a cylinder, which are stretched between the ends.
    """

    kind: LineKind
    ends: tuple[int, ...]
    number: int
    count: int
    shape: Array


class _AttachedPoints:
    """Points of parts, transformed to ground's frame all at once."""

    def __init__(self, model: Model) -> None:
        self._index = {name: index for index, name in enumerate((*model.part_names, GROUND))}
        self._parts: list[int] = []
        self._points: list[Array] = []

    def add(self, attachment: Attachment) -> int:
        """Add a point; returns its row."""
        self._parts.append(self._index[attachment.part])
        self._points.append(attachment.point)
        return len(self._parts) - 1

    def at(self, poses: Array) -> Array:
        """The points (n, 3) in ground's frame, from pose rows (parts + 1, 12) of the parts and of ground."""
        if not self._parts:
            return np.empty((0, 3))
        positions, rotations = unpack_poses(poses[self._parts])
        rotated: Array = np.einsum("nij,nj->ni", rotations, np.array(self._points))
        return positions + rotated


class Markers:
    """The markers of a mechanism, as a serialized message whose numbers are overwritten for each snapshot."""

    def __init__(self, model: Model, prefix: str = "") -> None:
        """Create the markers of shapes, joints, springs, dampers, constraints and traces.

        :param prefix: precedes `ground` in the name of the frame.
        """
        self._model, self._frame = model, prefix + GROUND
        extent = self._extent = extent_of(model)
        self._size = extent.size
        self._full_force = weight(model.mechanism, self._size)
        self._time = np.inf
        self._messages: list[Marker] = []
        self._add_fixed_markers(extent)
        self._attached, self._lines = _AttachedPoints(model), list[_MovingLine]()
        start = {GROUND: identity_pose(), **model.poses(0.0, model.start)}
        for connector in connectors(model.mechanism, extent, start):
            self._add_connector(connector)
        self._add_traces()
        self._add_contacts()
        self._template = MessageTemplate(MarkerArray(markers=self._messages))
        self._contacts = [[self._template.doubles(number, 10) for number in pair] for pair in self._contact_markers]
        self._poses = [self._template.doubles(number, 7) for number in range(len(self._part_rows))]
        self._line_points = [self._template.doubles(line.number, 3 * line.count).reshape(-1, 3) for line in self._lines]

    def payload(self, snapshot: Snapshot) -> bytes:
        """The message at a snapshot, serialized."""
        ground = pack_poses(np.zeros(3), np.eye(3))
        poses = np.vstack([self._model.pose_array(*snapshot.now), ground])
        origins, rotations = unpack_poses(poses[self._part_rows])
        positions = origins + np.einsum("nij,nj->ni", rotations, self._positions)
        rows = pack_poses(positions, rotations @ self._rotations)
        for view, pose in zip(self._poses, ros_poses(rows), strict=True):
            view[:] = pose
        restarted, self._time = snapshot.time < self._time, snapshot.time
        attached = self._attached.at(poses)
        for line, points in zip(self._lines, self._line_points, strict=True):
            self._update(points, line, attached[list(line.ends)], restarted)
        self._update_contacts(snapshot)
        self._template.stamp(snapshot.clock_ns)
        return self._template.payload()

    def _update(self, points: Array, line: _MovingLine, ends: Array, restarted: bool) -> None:
        """Overwrite the `points` (n, 3) of a line with its `ends` (k, 3) in ground's frame."""
        match line.kind:
            case "coil" | "cylinder":
                points[:] = solids.between(line.shape, ends[0], ends[1])
            case "line":
                points[:] = ends
            case "trace":
                points[:-1] = points[1:]
                points[slice(None) if restarted else -1] = ends[0]
            case _:
                assert_never(line.kind)

    def _update_contacts(self, snapshot: Snapshot) -> None:
        """Overwrite the pose and the scale of the ball, the normal and the arrow of each contact."""
        if not self._contacts:
            return
        point, readings = snapshot.point, self._model.contact_readings
        places = readings.places(snapshot.time, point.state, point.inputs)
        places[:, 0] = self._extent.in_front(places[:, 0], of_shapes(readings.placed))
        closed = closed_places([index for _, index in readings.placed], point.inputs, places[:, 1]).tolist()
        rows = zip(self._contacts, places, closed, self._pushes, strict=True)
        for (ball, line, arrow), (place, force, normal), touches, pushes in rows:
            ball[:] = ball_row(place, touches, self._size)
            line[:] = normal_row(place, normal, touches, self._size)
            arrow[:] = arrow_row(place, force if touches else np.zeros(3), self._full_force, self._size, pushes)

    def _add_fixed_markers(self, extent: Extent) -> None:
        mechanism, source = self._model.mechanism, self._model.mechanism.source.file
        drawn = primitives(mechanism, extent, lambda mesh: bool(resource_uri(mesh.file, source)))
        drawn += wires(self._model, extent)
        markers = [marker for one in drawn for marker in fixed_markers(one, source, extent.size)]
        names = (*self._model.part_names, GROUND)
        self._part_rows = [names.index(marker.part) for marker in markers]
        self._positions = np.array([marker.pose.position for marker in markers]).reshape(-1, 3)
        self._rotations = np.array([marker.pose.rotation for marker in markers]).reshape(-1, 3, 3)
        for marker in markers:
            self._add_marker(marker.namespace, marker.type, marker.scale, marker.color, marker.points, marker.mesh)

    def _add_connector(self, connector: Connector) -> None:
        shape, width = np.zeros((len(connector.points), 3)), LINE_WIDTH * self._size
        if connector.form == "coil":
            shape = solids.coil(connector.radius)
        elif connector.form == "cylinder":
            shape = solids.dashpot(connector.radius)
        else:
            width = 2.0 * connector.radius
        self._add_line(connector.form, connector.kind, connector.points, shape, width, connector.color)

    def _add_traces(self) -> None:
        colors, shape = palette.part_colors(self._model.mechanism), np.zeros((TRACE_POINTS, 3))
        for name, attachment in default_traces(self._model.mechanism).items():
            self._add_line("trace", "traces", (attachment,), shape, 0.5 * LINE_WIDTH * self._size, colors[name])

    def _add_contacts(self) -> None:
        self._pushes: list[bool] = []
        self._contact_markers: list[range] = []
        unit = (1.0, 1.0, 1.0)
        for owner, _ in self._model.contact_readings.placed:
            self._pushes.append(not pulls(self._model.mechanism, owner))
            number = len(self._messages)
            self._add_marker("contacts", Marker.SPHERE, unit, CONTACT_COLOR, ())
            self._add_marker("contact_normals", Marker.CYLINDER, unit, CONTACT_COLOR, ())
            self._add_marker("contact_forces", Marker.ARROW, unit, CONTACT_COLOR, ())
            self._contact_markers.append(range(number, number + 3))

    def _add_line(
        self, kind: LineKind, namespace: str, ends: tuple[Attachment, ...], shape: Array, width: float, color: Color
    ) -> None:
        number, count = len(self._messages), len(shape)
        type_ = Marker.LINE_LIST if kind == "cylinder" else Marker.LINE_STRIP
        self._add_marker(namespace, type_, (width, 0.0, 0.0), color, ())
        self._messages[-1].pose = Pose()
        self._messages[-1].points = [Point(x=slot(number)), *(Point() for _ in range(count - 1))]
        self._lines.append(_MovingLine(kind, tuple(self._attached.add(end) for end in ends), number, count, shape))

    def _add_marker(
        self,
        namespace: str,
        type_: int,
        scale: Scale,
        color: Color,
        points: Points,
        mesh: str = "",
    ) -> None:
        """Append a message; the place of its pose in the serialized message is found by its number."""
        number = len(self._messages)
        red, green, blue = (channel / 255.0 for channel in color)
        x, y, z = scale
        own_materials = bool(mesh) and not mesh.lower().endswith(".stl")  # which a color of 0 leaves as they are
        self._messages.append(
            Marker(
                header=Header(stamp=STAMP, frame_id=self._frame),
                ns=namespace,
                id=number,
                type=type_,
                pose=Pose(position=Point(x=slot(number))),
                scale=Vector3(x=x, y=y, z=z),
                color=ColorRGBA() if own_materials else ColorRGBA(r=red, g=green, b=blue, a=1.0),
                points=[Point(x=px, y=py, z=pz) for px, py, pz in points],
                mesh_resource=mesh,
                mesh_use_embedded_materials=own_materials,
            )
        )
