"""The parts: their shapes in their own frames, ground's axes, and the page about the mechanism."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from mbd_sim.base.errors import counted, listed
from mbd_sim.base.geometry.rotation import quaternions
from mbd_sim.files.meshes.mesh_files import mesh_path
from mbd_sim.mechanism.elements.parts import GROUND, Mesh, Part
from mbd_sim.pictures.rerun import scene as entity_paths
from mbd_sim.pictures.rerun import shapes
from mbd_sim.pictures.rerun.forces import weight
from mbd_sim.pictures.rerun.rows import Rows
from mbd_sim.pictures.rerun.scene import Entity, LoggedItems, PartPoses, SceneDescription
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import LONG
from mbd_sim.pictures.shapes.meshes import as_glb, reason_not_to_draw, undrawn_meshes
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.solids import LINE_WIDTH, POINT_MASS_RADIUS, skeleton

RERUN_READS = (".glb", ".gltf", ".obj", ".stl")  # files of meshes


def part_entities(scene: SceneDescription) -> Iterator[Entity]:
    """Ground and all parts."""
    yield _Ground(scene)
    colors = palette.part_colors(scene.mechanism)
    for index, name in enumerate(scene.part_names):
        yield _Part(scene, scene.mechanism.parts[name], index, colors[name])


class _Ground:
    """The axes of ground."""

    def __init__(self, scene: SceneDescription) -> None:
        self._size = scene.extent.size

    def static(self) -> LoggedItems:
        size, colors = self._size, [palette.AXIS_X, palette.AXIS_Y, palette.AXIS_Z]
        axes = rr.Arrows3D(vectors=0.12 * size * np.eye(3), radii=0.003 * size, colors=colors)
        yield f"{entity_paths.part(GROUND)}/axes", axes

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from ()


class _Part:
    """A part: its shapes, logged once, and its pose in each sample."""

    def __init__(self, scene: SceneDescription, part: Part, index: int, color: Color) -> None:
        self._part, self._index, self._color, self._size = part, index, color, scene.extent.size
        self._source = scene.mechanism.source.file
        self._path = entity_paths.part(part.name)

    def static(self) -> LoggedItems:
        part, path = self._part, self._path
        meshes = [(mesh, asset) for mesh in part.meshes if (asset := _asset(mesh, self._source, self._color))]
        for index, (mesh, asset) in enumerate(meshes):
            yield f"{path}/mesh_{index}", asset
            yield f"{path}/mesh_{index}", shapes.placed(mesh.pose, mesh.scale)
        if meshes:
            return
        for index, shape in enumerate(part.shapes):
            own = palette.from_hex(shape.color) if shape.color else palette.lit(self._color)
            yield f"{path}/{index}_{shape.kind}", shapes.solid(shape, own)
            if not shape.hole and (mark := shapes.mark(shape, own)) is not None:
                yield f"{path}/{index}_{shape.kind}/mark", mark
        if not part.shapes and part.mass:
            yield (
                f"{path}/center",
                shapes.sphere(part.center, POINT_MASS_RADIUS * self._size, palette.lit(self._color)),
            )
            if lines := skeleton(part):
                yield f"{path}/points", rr.LineStrips3D(lines, radii=LINE_WIDTH * self._size, colors=[self._color])

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        turned = quaternions(rows.rotations[:, self._index])
        moved = rr.Transform3D.columns(translation=rows.positions[:, self._index], quaternion=turned)
        yield self._path, moved


def _asset(mesh: Mesh, source: str, color: Color) -> rr.Asset3D | None:
    """The mesh as Rerun loads it; None if its file is missing, or cannot be read."""
    path = mesh_path(mesh.file, source)
    if path is None:
        return None
    kind = path.suffix.lower()
    if kind in RERUN_READS:
        own = palette.from_hex(mesh.color) if mesh.color else palette.lit(color)
        return rr.Asset3D(path=path, albedo_factor=own if kind == ".stl" else None)
    if reason_not_to_draw(path):
        return None
    return rr.Asset3D(contents=as_glb(path), media_type="model/gltf-binary")


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
