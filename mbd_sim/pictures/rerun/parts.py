"""The parts and all that is fixed in them: the primitives as archetypes of Rerun, and the page about the mechanism."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, assert_never

import numpy as np
import rerun as rr

from mbd_sim.base.errors import counted, listed
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import quaternions
from mbd_sim.files.text.mesh_files import mesh_path
from mbd_sim.mechanism.elements.parts import GROUND, Mesh
from mbd_sim.pictures.rerun import paths
from mbd_sim.pictures.rerun.forces import weight
from mbd_sim.pictures.rerun.scene import Entity, LoggedItems, PartPoses, Rows, SceneDescription
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import LONG
from mbd_sim.pictures.shapes.meshes import as_glb, reason_not_to_draw, undrawn_meshes
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.primitives import Lines, Primitive, primitives
from mbd_sim.pictures.shapes.solids import Box, Cylinder, Ring, Rod, Sphere

RERUN_READS = (".glb", ".gltf", ".obj", ".stl")  # files of meshes
THIN = -1.0  # radius of a thin line: negative ones are in points on the screen, which no transform stretches


def part_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All that is fixed in ground or in parts, and the parts, which move it."""
    yield _Fixed(scene)
    for index, name in enumerate(scene.part_names):
        yield _Part(name, index)


class _Fixed:
    """The axes of ground, and all primitives in the frames of their parts."""

    def __init__(self, scene: SceneDescription) -> None:
        self._scene, self._source = scene, scene.mechanism.source.file

    def static(self) -> LoggedItems:
        scene, size = self._scene, self._scene.extent.size
        colors = [palette.AXIS_X, palette.AXIS_Y, palette.AXIS_Z]
        yield (
            f"{paths.part(GROUND)}/axes",
            rr.Arrows3D(vectors=0.12 * size * np.eye(3), radii=0.003 * size, colors=colors),
        )
        for primitive in (*primitives(scene.mechanism, scene.extent, self._draws), *scene.wires):
            steps = primitive.path if primitive.kind == "parts" else (primitive.kind, *primitive.path)
            path = "/".join([paths.part(primitive.part), *map(paths.word, steps)])
            yield path, archetype(primitive, self._source)
            if isinstance(mesh := primitive.form, Mesh):
                turned = rr.Quaternion(xyzw=_xyzw(mesh.pose))
                yield path, rr.Transform3D(translation=mesh.pose.position, quaternion=turned, scale=list(mesh.scale))

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from ()

    def _draws(self, mesh: Mesh) -> bool:
        path = mesh_path(mesh.file, self._source)
        return path is not None and (path.suffix.lower() in RERUN_READS or not reason_not_to_draw(path))


class _Part:
    """The pose of a part in each sample."""

    def __init__(self, name: str, index: int) -> None:
        self._path, self._index = paths.part(name), index

    def static(self) -> LoggedItems:
        yield from ()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        turned = quaternions(rows.rotations[:, self._index])
        yield self._path, rr.Transform3D.columns(translation=rows.positions[:, self._index], quaternion=turned)


def archetype(primitive: Primitive, source: str = "") -> Any:
    """A primitive in the frame of its part; holes are wireframes.

    :param source: the file of the mechanism, from whose folder the paths of meshes count.
    """
    pose, color, form = primitive.pose, primitive.color, primitive.form
    fill = rr.components.FillMode.MajorWireframe if primitive.hole else rr.components.FillMode.Solid
    look: dict[str, Any] = {"colors": [color], "fill_mode": fill}
    placed = {"centers": [pose.position], "quaternions": [_xyzw(pose)]}
    match form:
        case Rod(length, radius):
            start = pose.position - pose.rotation[:, 2] * length / 2.0
            where = {"translations": [start], "quaternions": [_xyzw(pose)]}
            return rr.Capsules3D(lengths=[length], radii=[radius], **where, **look)
        case Cylinder(length, radius):
            return rr.Cylinders3D(lengths=[length], radii=[radius], **placed, **look)
        case Ring():
            return _torus(pose, form, color)
        case Box(size):
            return rr.Boxes3D(sizes=[size], **placed, **look)
        case Sphere(radius):
            return rr.Ellipsoids3D(half_sizes=[[radius] * 3], centers=[pose.position], **look)
        case Lines(strips, radius):
            moved = [pose.position + points @ pose.rotation.T for points in strips]
            return rr.LineStrips3D(moved, radii=[radius or THIN], colors=[color])
        case Mesh():
            return _asset(form, source, color)
        case _:
            assert_never(form)


def _asset(mesh: Mesh, source: str, color: Color) -> rr.Asset3D:
    """A mesh as Rerun loads it, in the axes of its file."""
    path = mesh_path(mesh.file, source)
    assert path is not None
    kind = path.suffix.lower()
    if kind in RERUN_READS:
        return rr.Asset3D(path=path, albedo_factor=color if kind == ".stl" else None)
    return rr.Asset3D(contents=as_glb(path), media_type="model/gltf-binary")


def _xyzw(pose: Pose) -> Array:
    """The quaternion of a pose in Rerun's order (x, y, z, w)."""
    return np.roll(rot.to_quaternion(pose.rotation), -1)


def _torus(pose: Pose, ring: Ring, color: Color, around: int = 64, across: int = 12) -> rr.Mesh3D:
    """A torus about z of `pose`, as a mesh of `around` times `across` quadrilaterals."""
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)
    tube_centers = np.stack([np.cos(u), np.sin(u), 0.0 * u], axis=-1).reshape(-1, 3) * ring.radius
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    corner, next_around = i * across + j, (i + 1) % around * across + j
    next_across, opposite = i * across + (j + 1) % across, (i + 1) % around * across + (j + 1) % across
    triangles = np.vstack(
        [np.column_stack([corner, next_around, opposite]), np.column_stack([corner, opposite, next_across])]
    )
    return rr.Mesh3D(
        vertex_positions=pose.position + (tube_centers + ring.tube * normals) @ pose.rotation.T,
        vertex_normals=normals @ pose.rotation.T,
        triangle_indices=triangles,
        albedo_factor=color,
    )


def about(scene: SceneDescription) -> rr.TextDocument:
    """The page that explains the scene, its colors and the scale of its arrows."""
    mechanism = scene.mechanism
    free = len(mechanism.coordinate_names)
    lines = [
        f"# {mechanism.name}",
        mechanism.description.strip(),
        f"{counted(len(mechanism.parts), 'part')}, {mechanism.mass:.4g} kg in all, {counted(free, 'coordinate')}, "
        f"{len(mechanism.closures) + len(mechanism.constraints)} loops and constraints; "
        f"by default {scene.method} with a step of {1e3 * mechanism.step:g} ms.",
        "| color | meaning |\n|---|---|\n"
        "| yellow | driven joints |\n| pink | joints and rods that close loops |\n| gray, white | other joints |\n"
        "| red arrows | forces of the file |\n| green arrows | commanded efforts and wrenches |\n"
        "| blue arrows | forces through joints, if requested |",
        f"An arrow of {LONG * scene.extent.size:.3g} m represents {weight(scene):.3g} N. A force that has an "
        "expression or an effort limit is scaled by its largest value instead.",
    ]
    if missing := undrawn_meshes(mechanism, RERUN_READS):
        lines.append(f"Meshes that are not drawn: {listed(missing)}.")
    return rr.TextDocument("\n\n".join(lines), media_type=rr.MediaType.MARKDOWN)
