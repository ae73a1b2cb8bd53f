"""The scene as entities of Foxglove: what is fixed in parts moves with their frames; the rest is new in each sample."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, assert_never

import numpy as np
from foxglove.messages import (
    ArrowPrimitive,
    Color,
    CubePrimitive,
    CylinderPrimitive,
    LinePrimitive,
    LinePrimitiveLineType,
    ModelPrimitive,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SpherePrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)

from mbd_sim.base.geometry import pose as geometry
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import aligning_z, to_quaternion
from mbd_sim.files.text.mesh_files import mesh_path
from mbd_sim.mechanism.elements.parts import GROUND, Mesh, Polyhedron
from mbd_sim.pictures.rerun.loads import ArrowScale, loads
from mbd_sim.pictures.rerun.scene import PartPoses, Rows, SceneDescription, is_closed, weight
from mbd_sim.pictures.shapes import palette, solids
from mbd_sim.pictures.shapes.joints import pulls
from mbd_sim.pictures.shapes.meshes import as_glb, reason_not_to_draw
from mbd_sim.pictures.shapes.primitives import Connector, Lines, Primitive, connectors, primitives
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
    arc_arrow,
    between,
    circle,
    triangles_of,
)
from mbd_sim.pictures.shapes.touching import closed_places, normal_lines, of_shapes

READ = {".glb": "model/gltf-binary", ".obj": "model/obj", ".stl": "model/stl"}  # files of meshes, by themselves
POINT, NORMAL, SHAFT, HEAD, THIN = 0.014, 0.003, 0.012, 0.028, 0.003  # sizes relative to that of the mechanism
FAINT = 0.6  # share of the background in the color of a rope that is slack

Drawn = dict[str, Any]  # primitives by the field of `SceneEntity` that takes them


def fixed_entities(scene: SceneDescription) -> list[SceneEntity]:
    """What is fixed in ground and in each part, in its frame, with which it moves."""
    source = scene.mechanism.source.file
    by_part: dict[str, Drawn] = {}
    for one in (*primitives(scene.mechanism, scene.extent, lambda mesh: _draws(mesh, source)), *scene.wires):
        drawn = by_part.setdefault(one.part, {})
        for field, primitive in _translated(one, source, scene.extent.size):
            drawn.setdefault(field, []).append(primitive)
    return [
        SceneEntity(id=f"parts/{part}", frame_id=part, frame_locked=True, **drawn) for part, drawn in by_part.items()
    ]


def _draws(mesh: Mesh, source: str) -> bool:
    path = mesh_path(mesh.file, source)
    return path is not None and (path.suffix.lower() in READ or not reason_not_to_draw(path))


def _translated(primitive: Primitive, source: str, size: float) -> Iterator[tuple[str, Any]]:
    """A primitive of the mechanism as those of Foxglove; holes cannot be drawn."""
    if primitive.hole:
        return
    at, color, form = primitive.pose, color_of(primitive.color), primitive.form
    place = pose_of(at)
    look: dict[str, Any] = {"pose": place, "color": color}
    match form:
        case Rod(length, radius):
            yield "cylinders", _cylinder(radius, length, look)
            for sign in (-1.0, 1.0):
                end = geometry.Pose(at.position + sign * length / 2.0 * at.rotation[:, 2], at.rotation)
                yield "spheres", SpherePrimitive(pose=pose_of(end), size=vector([2.0 * radius] * 3), color=color)
        case Cylinder(length, radius):
            yield "cylinders", _cylinder(radius, length, look)
        case Ring(radius, tube):
            rim = np.column_stack([radius * circle(np.linspace(0.0, 2.0 * np.pi, 49)), np.zeros(49)])
            yield "lines", line(rim, 2.0 * tube, color, pose=place)
        case Box(sides):
            yield "cubes", CubePrimitive(size=vector(sides), **look)
        case Sphere(radius):
            yield "spheres", SpherePrimitive(size=vector([2.0 * radius] * 3), **look)
        case Ellipsoid(radii):
            yield "spheres", SpherePrimitive(size=vector(2.0 * np.array(radii)), **look)
        case Cone() | Polyhedron() | Prism():
            yield "triangles", TriangleListPrimitive(points=points(triangles_of(form).reshape(-1, 3)), **look)
        case Lines(strips, radius):
            for strip in strips:
                yield "lines", line(strip, 2.0 * radius or THIN * size, color, pose=place)
        case Mesh():
            yield "models", _model(form, source, color)
        case _:
            assert_never(form)


def _cylinder(radius: float, length: float, look: Mapping[str, Any]) -> CylinderPrimitive:
    return CylinderPrimitive(size=vector([2.0 * radius, 2.0 * radius, length]), bottom_scale=1.0, top_scale=1.0, **look)


def _model(mesh: Mesh, source: str, color: Color) -> ModelPrimitive:
    path = mesh_path(mesh.file, source)
    assert path is not None
    known = READ.get(path.suffix.lower())
    return ModelPrimitive(
        pose=pose_of(mesh.pose),
        scale=vector(mesh.scale),
        color=color,
        override_color=path.suffix.lower() == ".stl",
        media_type=known or READ[".glb"],
        data=Path(path).read_bytes() if known else as_glb(path),
    )


class MovingEntities:
    """What is drawn anew in each sample, in ground's frame: connectors, contacts, arrows of forces, and traces."""

    def __init__(self, scene: SceneDescription) -> None:
        self._scene, self._size = scene, scene.extent.size
        found = connectors(scene.mechanism, scene.extent, scene.start_poses)
        self._connectors = [(one, _shape(one)) for one in found]
        self._loads = list(loads(scene))
        self._closed = [index for _, index in scene.contacts]
        self._pushes = [not pulls(scene.mechanism, owner) for owner, _ in scene.contacts]
        self._contact_scale = ArrowScale("contacts", "", False, palette.CONTACT, self._size, weight(scene))
        self._colors = palette.part_colors(scene.mechanism)
        self._traces: dict[str, deque[tuple[float, Array]]] = {name: deque() for name in scene.traces}

    def of(self, rows: Rows, poses: PartPoses) -> list[list[SceneEntity]]:
        """The entities of each of the samples; the traces only with the last of them."""
        drawn: list[dict[str, Drawn]] = [{"connectors": {}, "contacts": {}, "forces": {}} for _ in range(len(rows))]
        for connector, shape in self._connectors:
            self._add_connector(connector, shape, rows, poses, drawn)
        for load in self._loads:
            for scale, (at, vectors) in zip(load.scales, load.vectors(rows, poses), strict=True):
                for number, (place, arrow, vector_) in enumerate(zip(at, scale.arrows(vectors), vectors, strict=True)):
                    self._add_load(drawn[number]["forces"], scale, place, arrow, vector_)
        if self._scene.contacts:
            self._add_contacts(rows, drawn)
        stamps = [timestamp(time) for time in rows.times.tolist()]
        found = [
            [SceneEntity(id=kind, frame_id=GROUND, timestamp=stamp, **fields) for kind, fields in each.items()]
            for stamp, each in zip(stamps, drawn, strict=True)
        ]
        found[-1].append(
            SceneEntity(id="traces", frame_id=GROUND, timestamp=stamps[-1], lines=self._trace(rows, poses))
        )
        return found

    def _add_connector(
        self,
        connector: Connector,
        shape: Array | None,
        rows: Rows,
        poses: PartPoses,
        drawn: Sequence[Mapping[str, Drawn]],
    ) -> None:
        ends = np.stack([poses.point(at) for at in connector.points], axis=1)
        closed = is_closed(self._scene, (connector.kind, connector.name), rows) if connector.slackens else None
        width = 2.0 * connector.radius if connector.form == "line" else LINE_WIDTH * self._size
        pairs = connector.form == "cylinder"
        for number, corners in enumerate(ends):
            slack = closed is not None and not closed[number]
            shown = palette.mixed(connector.color, palette.BACKGROUND, FAINT) if slack else connector.color
            through = corners if shape is None else between(shape, corners[0], corners[1])
            lines = drawn[number]["connectors"].setdefault("lines", [])
            lines.append(line(through, width, color_of(shown), pairs=pairs))

    def _add_load(self, drawn: Drawn, scale: ArrowScale, at: Array, arrow: Array, value: Array) -> None:
        """A force as an arrow, or a couple as an arc; nothing where it is too small to be seen."""
        (visible,), (magnitude,) = scale.visible(value[None])
        if not visible:
            return
        if scale.couple:
            arc = arc_arrow(at, value / magnitude, scale.sweep(float(magnitude)), scale.radius * self._size)
            drawn.setdefault("lines", []).append(line(arc, 0.7 * SHAFT * self._size, color_of(scale.color)))
        else:
            drawn.setdefault("arrows", []).append(self._arrow(at, arrow, scale.color))

    def _arrow(self, start: Array, along: Array, color: palette.Color) -> ArrowPrimitive:
        length = float(np.linalg.norm(along))
        head = min(1.5 * HEAD * self._size, 0.5 * length)
        rotation = aligning_z(along / length)[:, [2, 0, 1]]  # x along the arrow
        return ArrowPrimitive(
            pose=pose_of(geometry.Pose(start, rotation)),
            shaft_length=length - head,
            shaft_diameter=SHAFT * self._size,
            head_length=head,
            head_diameter=HEAD * self._size,
            color=color_of(color),
        )

    def _add_contacts(self, rows: Rows, drawn: Sequence[Mapping[str, Drawn]]) -> None:
        places, forces, normals = np.moveaxis(rows.of("contacts").reshape(len(rows), -1, 3, 3), 2, 0)
        places = self._scene.extent.in_front(places, of_shapes(self._scene.contacts))
        closed = closed_places(self._closed, rows.of("inputs"), forces)
        color = color_of(palette.CONTACT)
        for number, sample in enumerate(drawn):
            contacts = sample["contacts"]
            for index in np.flatnonzero(closed[number]):
                at, force = places[number, index], forces[number, index]
                ball = SpherePrimitive(
                    pose=pose_of(geometry.Pose(at, np.eye(3))), size=vector([2.0 * POINT * self._size] * 3), color=color
                )
                contacts.setdefault("spheres", []).append(ball)
                (ends,) = normal_lines(at[None], normals[number, index][None], self._size)
                contacts.setdefault("lines", []).append(line(ends, 2.0 * NORMAL * self._size, color))
                arrow = self._contact_scale.arrows(force[None])[0]
                start = at - arrow if self._pushes[index] else at
                self._add_load(contacts, self._contact_scale, start, arrow, force)

    def _trace(self, rows: Rows, poses: PartPoses) -> list[LinePrimitive]:
        """The paths of the traced points in the last second, up to the last sample."""
        found = []
        for name, at in self._scene.traces.items():
            kept = self._traces[name]
            for time, place in zip(rows.motion_times.tolist(), poses.point(at), strict=True):
                if kept and time < kept[-1][0]:
                    kept.clear()  # the motion begins again
                kept.append((time, place))
            while kept[0][0] < kept[-1][0] - self._scene.options.trace_time:
                kept.popleft()
            color = color_of(self._colors.get(at.part, palette.JOINT))
            found.append(line(np.array([place for _, place in kept]), 0.01 * self._size, color))
        return found


def _shape(connector: Connector) -> Array | None:
    """The points along z from 0 to 1 of a connector that is stretched."""
    match connector.form:
        case "coil":
            return solids.coil(connector.radius)
        case "cylinder":
            return solids.dashpot(connector.radius)
        case "line":
            return None
        case _:
            assert_never(connector.form)


def line(through: Array, width: float, color: Color, *, pose: Pose | None = None, pairs: bool = False) -> LinePrimitive:
    """A line through points (n, 3) in m, or with `pairs` between each two of them."""
    kind = LinePrimitiveLineType.LineList if pairs else LinePrimitiveLineType.LineStrip
    return LinePrimitive(type=kind, pose=pose or UPRIGHT, thickness=width, points=points(through), color=color)


def points(values: Array) -> list[Point3]:
    """Points (n, 3)."""
    return [Point3(x=x, y=y, z=z) for x, y, z in values.tolist()]


def vector(values: Sequence[float] | Array) -> Vector3:
    """Three numbers."""
    x, y, z = (float(value) for value in values)
    return Vector3(x=x, y=y, z=z)


def quaternion(w: float, x: float, y: float, z: float) -> Quaternion:
    """A rotation by its quaternion."""
    return Quaternion(x=x, y=y, z=z, w=w)


def pose_of(pose: geometry.Pose) -> Pose:
    """A pose."""
    turned = [float(value) for value in to_quaternion(pose.rotation)]
    return Pose(position=vector(pose.position), orientation=quaternion(*turned))


def color_of(color: palette.Color) -> Color:
    """An opaque color."""
    red, green, blue = (channel / 255.0 for channel in color)
    return Color(r=red, g=green, b=blue, a=1.0)


def timestamp(time: float) -> Timestamp:
    """A time in s."""
    seconds, rest = divmod(nanoseconds(time), 1_000_000_000)
    return Timestamp(sec=seconds, nsec=rest)


def nanoseconds(time: float) -> int:
    """A time in s in whole ns; Foxglove has no times before 0."""
    return max(round(time * 1e9), 0)


UPRIGHT = Pose(position=Vector3(), orientation=Quaternion(w=1.0))
