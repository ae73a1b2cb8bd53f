"""The motion of a mechanism as a recording of Rerun: the scene is logged once, then rows of samples follow.

The scene are the parts with all that is fixed in them, primitives as archetypes of Rerun, and a page about the
mechanism. Events are on the timeline too: a log line for each, and state lanes that show whether the run is going and
commanded.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, assert_never

import numpy as np
import rerun as rr

from mbd_sim.base.errors import counted, listed
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import quaternions
from mbd_sim.files.text.mesh_files import mesh_path
from mbd_sim.mechanism.elements.parts import GROUND, Mesh, Polyhedron
from mbd_sim.pictures.rerun import paths
from mbd_sim.pictures.rerun.constraints import constraint_entities, contact_entities, trace_entities
from mbd_sim.pictures.rerun.forces import arrow_entities, connector_entities
from mbd_sim.pictures.rerun.plots import make_blueprint, plot_entities, sensor_series
from mbd_sim.pictures.rerun.scene import Entity, LoggedEvent, LoggedItems, PartPoses, Rows, SceneDescription, weight
from mbd_sim.pictures.rerun.sinks import SinkConnection, is_live
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.joints import LONG
from mbd_sim.pictures.shapes.meshes import as_glb, reason_not_to_draw, undrawn_meshes
from mbd_sim.pictures.shapes.palette import Color
from mbd_sim.pictures.shapes.primitives import Lines, Primitive, primitives
from mbd_sim.pictures.shapes.solids import Box, Cone, Cylinder, Ellipsoid, Prism, Ring, Rod, Sphere, triangles_of
from mbd_sim.simulation.run.events import ERRORS, EventKind

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
        case Ellipsoid(radii):
            return rr.Ellipsoids3D(half_sizes=[radii], **placed, **look)
        case Cone() | Polyhedron() | Prism():
            corners = pose.position + triangles_of(form) @ pose.rotation.T
            if primitive.hole:
                return rr.LineStrips3D(corners[:, [0, 1, 2, 0]], radii=[THIN], colors=[color])
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            normals /= np.linalg.norm(normals, axis=1)[:, None]
            return rr.Mesh3D(
                vertex_positions=corners.reshape(-1, 3),
                vertex_normals=np.repeat(normals, 3, axis=0),
                albedo_factor=color,
            )
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
        "expression or an effort limit is scaled by its largest value instead, and forces at contacts by the usual "
        "largest one, if it is far from this.",
    ]
    if missing := undrawn_meshes(mechanism, RERUN_READS):
        lines.append(f"Meshes that are not drawn: {listed(missing)}.")
    return rr.TextDocument("\n\n".join(lines), media_type=rr.MediaType.MARKDOWN)


RUN, COMMANDS = f"{paths.STATES}/run", f"{paths.STATES}/commands"
STYLES = {
    RUN: {"running": (70, 130, 180), "paused": (150, 150, 160), "stopped": (229, 101, 98)},
    COMMANDS: {"none": (60, 66, 76), "taken": (96, 200, 120), "expired": (245, 166, 66)},
}
# The state that each lane enters with an event; other events leave a lane as it is.
_LANES: Mapping[str, Mapping[EventKind, str]] = {
    RUN: {
        EventKind.PAUSED: "paused",
        EventKind.RUNNING: "running",
        **dict.fromkeys(ERRORS, "stopped"),
    },
    COMMANDS: {
        EventKind.COMMAND: "taken",
        EventKind.EXPIRED: "expired",
        EventKind.RESET: "none",
        EventKind.NEW_STATE: "none",
    },
}
_WARNINGS = (EventKind.WARNING, EventKind.EXPIRED)


def level(kind: EventKind) -> str:
    """The severity of an event as Rerun shows it."""
    if kind in ERRORS:
        return str(rr.TextLogLevel.ERROR)
    return str(rr.TextLogLevel.WARN if kind in _WARNINGS else rr.TextLogLevel.INFO)


def static() -> LoggedItems:
    """The colors of the lanes."""
    for entity, styles in STYLES.items():
        yield entity, rr.StateConfiguration(values=list(styles), colors=list(styles.values()))


def event_columns(events: Sequence[LoggedEvent]) -> list[tuple[str, np.ndarray, object]]:
    """The entities that the events change, each with its times (s) and columns."""
    times = np.array([event.time for event in events])
    texts = ["commands are accepted" if event.kind is EventKind.COMMAND else event.text for event in events]
    lines = rr.TextLog.columns(text=texts, level=[level(event.kind) for event in events])
    found: list[tuple[str, np.ndarray, object]] = [(paths.EVENTS, times, lines)]
    for entity, states in _LANES.items():
        changes = [(event.time, states[event.kind]) for event in events if event.kind in states]
        if changes:
            lane = rr.StateChange.columns(state=[state for _, state in changes])
            found.append((entity, np.array([time for time, _ in changes]), lane))
    return found


APPLICATION = "mbd_sim"
FLUSH_TIMEOUT = 5.0  # s


class RerunStream:
    """One recording. `address` is where to view it: a URL, or the path of the file."""

    def __init__(self, scene: SceneDescription, sink: str, *, live: bool | None = None, footer: bool = True) -> None:
        """Open the sink and log the scene.

        :param live: follow the incoming data rather than play them in a loop; by default, loop only in files.
        :param footer: write a list of all chunks at the end of a file; it is kept in memory until then.
        :raises ViewerError: the sink cannot be opened.
        """
        self._scene = scene
        self._recording = rr.RecordingStream(APPLICATION, batcher_config=rr.ChunkBatcherConfig.LOW_LATENCY())
        self._connection = SinkConnection(
            self._recording, sink, make_blueprint(scene, live=is_live(sink) if live is None else live), footer=footer
        )
        self.address = self._connection.address
        try:
            self._recording.send_recording_name(scene.mechanism.name)
            self._recording.log(paths.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            self._recording.log(paths.ABOUT, about(scene), static=True)
            sources = (
                part_entities,
                connector_entities,
                constraint_entities,
                trace_entities,
                arrow_entities,
                contact_entities,
                plot_entities,
            )
            self._entities: list[Entity] = [item for source in sources for item in source(scene)]
            for item in self._entities:
                for path, archetype in item.static():
                    self._recording.log(path, archetype, static=True)
            for path, archetype in static():
                self._recording.log(path, archetype, static=True)
        except BaseException:
            self._connection.close()
            raise
        self._begun = False
        self._measured: set[str] = set()

    def send_samples(self, values: Array) -> None:
        """Show samples, rows (n, width) of `RowLayout` in the order of their times."""
        rows = Rows(self._scene.rows, values)
        poses = PartPoses(self._scene, rows)
        if not self._begun:
            self._begun = True
            for path, state in ((RUN, "running"), (COMMANDS, "none")):
                self._columns(path, rows.times[:1], rr.StateChange.columns(state=[state]))
        for item in self._entities:
            for path, columns in item.columns(rows, poses):
                self._columns(path, rows.times, columns)

    def send_events(self, events: Sequence[LoggedEvent]) -> None:
        """Show events."""
        for path, times, columns in event_columns(events):
            self._columns(path, times, columns)

    def send_measurements(self, sensor: str, quantity: str, times: Array, values: Array) -> None:
        """Show measurements (n, components) of a sensor over the times (n,) in s at which they arrived."""
        series = sensor_series(sensor, quantity, values.shape[1])
        if series.path not in self._measured:
            self._measured.add(series.path)
            for path, style in series.style():
                self._recording.log(path, style, static=True)
        for path, columns in series.values(values):
            self._columns(path, times, columns)

    def flush(self) -> None:
        """Send the buffered data.

        :raises ValueError: the viewer does not accept data any more.
        """
        self._recording.flush(timeout_sec=FLUSH_TIMEOUT)

    def close(self) -> None:
        """End the recording; a window stays open, a server stops."""
        self._recording.disconnect()
        self._connection.close()

    def _columns(self, path: str, times: np.ndarray, columns: Any) -> None:
        index = rr.TimeColumn(paths.TIMELINE, duration=times)
        rr.send_columns(path, indexes=[index], columns=columns, recording=self._recording, strict=True)
