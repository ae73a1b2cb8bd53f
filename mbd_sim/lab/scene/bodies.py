"""The parts, joints and wires of a mechanism: forms fixed in the frames of parts, which follow changed lengths."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, assert_never

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, unpack_poses
from mbd_sim.base.geometry.rotation import quaternions, to_quaternion
from mbd_sim.files.text.mesh_files import mesh_path
from mbd_sim.mechanism.elements.parts import GROUND, Mesh, Polyhedron
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.meshes import reason_not_to_draw, triangles
from mbd_sim.pictures.shapes.primitives import Form, Lines, Primitive, primitives, wires
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
    triangles_of,
)
from mbd_sim.simulation.model.model import Model

THIN = 0.25  # of the width of a line, for lines as thin as they can be seen

Dragged = Callable[[int, str, str, Array, Array], None]  # page, phase, part, point in its frame, pointer in ground's


class Bodies:
    """The nodes of viser's scene that move with parts.

    In a file (`in_file`), forms that are not shown any more stay as hidden nodes: its player shows a node that is
    replaced only after the parts have moved, whereas it shows and hides those that it has drawn at once.
    """

    def __init__(
        self, scene: Any, model: Model, extent: Extent, dragged: Dragged | None, *, in_file: bool = False
    ) -> None:
        self._hidden: dict[str, list[tuple[Primitive, Any]]] | None = {} if in_file else None
        self._scene, self._extent, self._dragged = scene, extent, dragged
        self._names = (*model.part_names, GROUND)
        self._source = model.mechanism.source.file
        self._frames = [scene.add_frame(f"/parts/{name}", show_axes=False) for name in self._names]
        self._forms: dict[str, Primitive] = {}
        self.reshape(model.mechanism)
        for number, one in enumerate(wires(model, extent)):
            self._add(f"/parts/{one.part}/wire_{number}", one)

    def move(self, poses: Array) -> None:
        """Move everything to the poses (parts and ground, 12)."""
        self._poses = poses
        for handle, position, xyzw in zip(self._frames, *_places(poses), strict=True):
            handle.position = position
            handle.wxyz = np.roll(xyzw, 1)

    def reshape(self, mechanism: Mechanism) -> None:
        """Draw the forms of a mechanism that are not drawn so yet, such as a rod that has another length."""
        before, self._forms = self._forms, {}
        for new in primitives(mechanism, self._extent, self._can_draw):
            if not new.hole:
                path = f"/parts/{new.part}/{new.kind}_{'_'.join(new.path)}"
                old, self._forms[path] = before.pop(path, None), new
                if old is None or not _same(old, new):
                    self._draw(path, new)
        for gone in before:
            if self._hidden is None:
                self._scene.remove_by_name(gone)
            else:
                _show_only(None, self._hidden[gone])

    def _draw(self, path: str, primitive: Primitive) -> None:
        """Draw a primitive in place of the one of this path."""
        if self._hidden is None:
            self._add(path, primitive)  # it takes the place of a node of this name
            return
        drawn = self._hidden.setdefault(path, [])
        if not any(_same(one, primitive) for one, _ in drawn):
            drawn.append((primitive, self._add(f"{path}_{len(drawn)}", primitive)))
        _show_only(primitive, drawn)

    def _can_draw(self, mesh: Mesh) -> bool:
        path = mesh_path(mesh.file, self._source)
        return path is not None and not reason_not_to_draw(path)

    def _add(self, path: str, primitive: Primitive) -> Any:
        """Add the nodes of a primitive; returns the first, which has the others below it."""
        handles = self._nodes(path, primitive)
        if self._dragged is not None and primitive.part != GROUND and not isinstance(primitive.form, Lines):
            for handle in handles:
                handle.on_drag("left")(self._drag_of(primitive.part, self._dragged))
        return handles[0]

    def _nodes(self, path: str, primitive: Primitive) -> list[Any]:
        """Add the nodes of a primitive."""
        pose, add = primitive.pose, self._scene
        place = {"position": pose.position, "wxyz": to_quaternion(pose.rotation), "color": primitive.color}
        match primitive.form:
            case Rod(length, radius):
                ends = [
                    add.add_icosphere(
                        f"{path}/{end}", radius=radius, position=(0.0, 0.0, end * length), color=primitive.color
                    )
                    for end in (-0.5, 0.5)
                ]
                return [add.add_cylinder(path, radius=radius, height=length, **place), *ends]
            case Cylinder(length, radius):
                return [add.add_cylinder(path, radius=radius, height=length, radial_segments=48, **place)]
            case Ring(radius, tube):
                import trimesh

                mesh = trimesh.creation.torus(radius, tube, major_sections=64, minor_sections=12)
                return [add.add_mesh_simple(path, mesh.vertices, mesh.faces, **place)]
            case Box(size):
                return [add.add_box(path, dimensions=size, **place)]
            case Sphere(radius):
                return [add.add_icosphere(path, radius=radius, **place)]
            case Ellipsoid(radii):
                import trimesh

                ball = trimesh.creation.icosphere(subdivisions=3)
                return [add.add_mesh_simple(path, ball.vertices * np.array(radii), ball.faces, **place)]
            case Cone() | Polyhedron() | Prism() as solid:
                corners = triangles_of(solid).reshape(-1, 3)
                faces = np.arange(len(corners)).reshape(-1, 3)
                return [add.add_mesh_simple(path, corners, faces, flat_shading=True, **place)]
            case Lines(strips, radius):
                segments = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in strips])
                color, width = place.pop("color"), 2.0 * radius or THIN * LINE_WIDTH * self._extent.size
                return [add.add_line_segments(path, segments.astype(np.float32), color, thickness=width, **place)]
            case Mesh() as mesh:
                file = mesh_path(mesh.file, self._source)
                assert file is not None
                corners = triangles(file) * np.array(mesh.scale)
                faces = np.arange(3 * len(corners)).reshape(-1, 3)
                return [add.add_mesh_simple(path, corners.reshape(-1, 3), faces, side="double", **place)]
            case _ as unknown:
                assert_never(unknown)

    def _drag_of(self, part: str, dragged: Dragged) -> Callable[[Any], None]:
        """Passes on the drags of a part, with the grabbed point in its frame."""
        held: dict[int, Array] = {}

        def on_drag(event: Any) -> None:
            if event.phase == "start":
                position, rotation = unpack_poses(self._poses[self._names.index(part)])
                held[event.client_id] = rotation.T @ (np.array(event.start_position) - position)
            point = held.get(event.client_id)
            if point is not None:
                dragged(event.client_id, event.phase, part, point, np.array(event.end_position))

        return on_drag


def _places(poses: Array) -> tuple[Array, Array]:
    positions, rotations = unpack_poses(poses)
    return positions, quaternions(rotations)


def _show_only(primitive: Primitive | None, drawn: list[tuple[Primitive, Any]]) -> None:
    for one, handle in drawn:
        handle.visible = primitive is not None and _same(one, primitive)


def _same(one: Primitive, other: Primitive) -> bool:
    return _same_form(one.form, other.form) and _same_pose(one.pose, other.pose)


def _same_pose(one: Pose, other: Pose) -> bool:
    return np.array_equal(one.position, other.position) and np.array_equal(one.rotation, other.rotation)


def _same_form(one: Form, other: Form) -> bool:
    if isinstance(one, Lines) and isinstance(other, Lines):
        return one.radius == other.radius and all(map(np.array_equal, one.strips, other.strips))
    return isinstance(one, Mesh) or one == other
