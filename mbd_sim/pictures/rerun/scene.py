"""The scene that the viewer's process draws: its description, its entities, and their states for many samples at once.

The process receives the description of a mechanism before the samples, as plain records. Everything that is drawn has
the same interface: each entity is logged once, at its path in the recording, and changes by columns. Points and
directions of parts are computed in ground's frame, and the coordinates of joints with them. Plotted values have units.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose, unpack_poses
from mbd_sim.base.geometry.rotation import quaternions
from mbd_sim.mechanism.elements.constraints import Surface, is_one_sided
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.mechanism.values.source import Location
from mbd_sim.pictures.rerun.rows import RowLayout, Rows
from mbd_sim.pictures.shapes.extent import Extent, extent_of
from mbd_sim.pictures.shapes.joints import default_traces, tip_of

if TYPE_CHECKING:
    from mbd_sim.simulation.model.model import Model


TRACE_TIME = 1.0  # s
TOWARD_EYE = np.array([0.55, -1.0, 0.5])  # the direction from which the outline of a surface is found


@dataclass(frozen=True)
class DisplayOptions:
    """The user's choice of what is shown.

    `traces` are points (`part` or `part.point`; None: the ends of the chains) that leave a trace for `trace_time` s of
    simulated time; `reactions` shows the forces through the joints. `measurements` shows plots of sensors, whose data
    come with `RerunStream.send_measurements`.
    """

    traces: tuple[str, ...] | None = None
    trace_time: float = TRACE_TIME
    reactions: bool = False
    measurements: bool = False


@dataclass(frozen=True, eq=False)
class ConstraintLines:
    """Lines (n, 3) in a part's frame by which a curve or a surface is drawn."""

    name: str
    part: str
    lines: tuple[Array, ...]
    surface: bool


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """A mechanism prepared for display.

    `q` and `u` are the slices of each joint's coordinates and speeds in the state, `wrenches` the slice of the
    commanded wrench on each part in the inputs, and `quaternions` the index in the state at which that of a joint
    begins. `contacts` are the elements of the contacts that have a place, each with the index in the inputs that is 1
    while it is closed, or None for compliant ones.
    """

    mechanism: Mechanism
    extent: Extent
    rows: RowLayout
    nq: int
    nv: int
    wrenches: Mapping[str, slice]
    q: Mapping[str, slice]
    u: Mapping[str, slice]
    quaternions: Mapping[str, int]
    contacts: tuple[tuple[Location, int | None], ...]
    part_names: tuple[str, ...]
    start: Array
    traces: Mapping[str, Attachment]
    constraint_lines: tuple[ConstraintLines, ...]
    method: str
    options: DisplayOptions

    @property
    def start_poses(self) -> Mapping[str, Pose]:
        """The poses of the parts and of ground at the start."""
        poses = (Pose(*pose) for pose in zip(*unpack_poses(self.start), strict=True))
        return {GROUND: identity_pose(), **dict(zip(self.part_names, poses, strict=True))}

    def at_start(self, attachment: Attachment) -> Array:
        """A point (3,) in ground's frame at the start."""
        pose = self.start_poses[attachment.part]
        return pose.position + pose.rotation @ attachment.point


def describe_scene(model: Model, rows: RowLayout, options: DisplayOptions) -> SceneDescription:
    """Describe a model to the viewer.

    :raises ValueError: a trace names a part or point that does not exist.
    """
    mechanism, extent = model.mechanism, extent_of(model)
    return SceneDescription(
        mechanism=mechanism,
        extent=extent,
        rows=rows,
        nq=model.layout.nq,
        nv=model.layout.nv,
        wrenches=dict(model.input_layout.wrenches),
        q=model.layout.q,
        u=model.layout.u,
        quaternions=dict(model.quaternions),
        contacts=model.contact_readings.placed,
        part_names=tuple(model.part_names),
        start=model.pose_array(0.0, model.start),
        traces=_traces(mechanism, options.traces),
        constraint_lines=tuple(_constraint_lines(model, extent.normal)),
        method=model.method_name,
        options=options,
    )


def _traces(mechanism: Mechanism, chosen: Sequence[str] | None) -> Mapping[str, Attachment]:
    if chosen is None:
        return default_traces(mechanism)
    points = {name: part.points for name, part in mechanism.parts.items()}
    traces: dict[str, Attachment] = {}
    for text in chosen:
        try:
            part, name = split_reference(text, points)
        except InputError as error:
            raise ValueError(f"traces: {error.message}. {error.remedy or nearest(text, points)}") from error
        point = points[part][name].position if name else tip_of(mechanism.parts[part])
        traces[text] = Attachment(part, np.array(point))
    return traces


def _constraint_lines(model: Model, plane: Array | None) -> list[ConstraintLines]:
    """The curves and surfaces on which points are constrained to lie, as they are at the start.

    In a plane mechanism, surfaces that are touched from one side are outlines in its `plane` with this normal (3,).
    """
    found: list[ConstraintLines] = []
    for constraint in model.mechanism.constraints:
        if isinstance(constraint, Surface):
            from mbd_sim.pictures.shapes.curves import curve_lines, section_lines, surface_lines

            poses = {GROUND: identity_pose(), **model.poses(0.0, model.start)}
            point = poses[constraint.point.part] @ Pose(constraint.point.point, np.eye(3))
            start = (poses[constraint.base.part].inverse() @ point).position
            base = Pose(constraint.base.point, constraint.axes)
            is_surface = len(constraint.equations) == 1
            if is_one_sided(constraint) and plane is not None:
                drawn = section_lines(constraint, start, base, poses[constraint.base.part].rotation.T @ plane)
            elif is_surface:
                drawn = surface_lines(constraint, start, base, TOWARD_EYE)
            else:
                drawn = curve_lines(constraint, start, base)
            lines = tuple(line.points for line in drawn if line.kind != "outline" and len(line.points) > 1)
            found.append(ConstraintLines(constraint.name, constraint.base.part, lines, surface=is_surface))
    return found


MIN_LENGTH = 1e-9  # m, below which two points count as one


class PartPoses:
    """The poses of the parts in each of n samples."""

    def __init__(self, scene: SceneDescription, rows: Rows) -> None:
        self._index = {name: index for index, name in enumerate(scene.part_names)}
        self._rows = rows

    def point(self, at: Attachment) -> Array:
        """A point of a part in ground's frame, (n, 3)."""
        if at.part == GROUND:
            return np.broadcast_to(at.point, (len(self._rows), 3))
        index = self._index[at.part]
        return np.asarray(self._rows.positions[:, index] + self._rows.rotations[:, index] @ at.point)

    def direction(self, part: str, direction: Array) -> Array:
        """A direction (3,) or (n, 3) in the frame of a part, in ground's axes (n, 3)."""
        along = np.broadcast_to(direction, (len(self._rows), 3))
        if part == GROUND:
            return along
        rotated: Array = np.einsum("nij,nj->ni", self._rows.rotations[:, self._index[part]], along)
        return rotated

    def rotations(self, part: str) -> Array:
        """The rotation matrices (n, 3, 3) of a part."""
        if part == GROUND:
            return np.broadcast_to(np.eye(3), (len(self._rows), 3, 3))
        return self._rows.rotations[:, self._index[part]]


def line_transforms(starts: Array, stops: Array, across: Array) -> tuple[Array, Array]:
    """Lengths (n,) of the lines from start to stop, and quaternions (n, 4) x, y, z, w that rotate z onto them.

    x is as close to `across` (3,) as possible, so that a drawn object does not spin about its line.
    """
    line = stops - starts
    length = np.linalg.norm(line, axis=1)
    nonzero = length > MIN_LENGTH
    z = np.where(nonzero[:, None], line / np.where(nonzero, length, 1.0)[:, None], [0.0, 0.0, 1.0])
    x = across - (z @ across)[:, None] * z
    short = np.linalg.norm(x, axis=1) < 1e-3
    if np.any(short):
        other = np.eye(3)[int(np.argmin(np.abs(across)))]
        x[short] = other - (z[short] @ other)[:, None] * z[short]
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return length, quaternions(np.stack([x, np.cross(z, x), z], axis=2))


def transverse_direction(scene: SceneDescription, direction: Array) -> Array:
    """A direction (3,) across a line along `direction` (3,): the normal of the plane of motion where there is one."""
    normal = scene.extent.normal
    if normal is not None:
        return normal
    return np.asarray(np.eye(3)[int(np.argmin(np.abs(direction)))])


LoggedItems = Iterator[tuple[str, Any]]  # the path of an entity, and the archetype or columns logged there


class Entity(Protocol):
    """Something in the scene, or the curves of a plot."""

    def static(self) -> LoggedItems:
        """The archetypes that do not change: shapes, styles, names."""

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        """The columns that change, one row for each sample."""


TIMELINE = "sim_time"
WORLD = "world"
ABOUT = "about"
CONTACTS = f"{WORLD}/contact_forces"
EVENTS = "events/log"
STATES = "events/states"
JOINTS = "joints"
POSITION, VELOCITY, EFFORT = (f"{JOINTS}/{kind}" for kind in ("position", "velocity", "effort"))
REACTION = f"{JOINTS}/reaction"
ACCOUNT = "energy/account"
STACK = "energy/stack"
RESIDUAL = "energy/residual"
RESIDUAL_PJ = "energy/residual_pJ"  # Rerun's plots label axes without exponents: in J they would show zeros
PICO = 1e-12

ANGULAR, LINEAR = "angular", "linear"
UNITS = {  # of the plots, by the paths of their entities
    f"{POSITION}/{ANGULAR}": "rad",
    f"{POSITION}/{LINEAR}": "m",
    f"{VELOCITY}/{ANGULAR}": "rad/s",
    f"{VELOCITY}/{LINEAR}": "m/s",
    f"{EFFORT}/{ANGULAR}": "N·m",
    f"{EFFORT}/{LINEAR}": "N",
}


def word(name: str) -> str:
    """A name as one step of a path, as Rerun escapes it."""
    return re.sub(r"[^\w.-]", lambda found: _escaped(found[0]), name)


def _escaped(letter: str) -> str:
    return f"\\{letter}" if letter.isascii() else f"\\u{{{ord(letter):04X}}}"


def in_world(kind: str, name: str) -> str:
    """An entity of a kind in ground's frame."""
    return f"{WORLD}/{kind}/{word(name)}"


def part(name: str) -> str:
    """The entity that moves with a part; ground's does not move."""
    return f"{WORLD}/ground" if name == GROUND else in_world("parts", name)


def trace(name: str) -> str:
    """The trace that a point leaves, in ground's frame."""
    return in_world("traces", name)


def sensor(name: str, quantity: str) -> str:
    """The measurements of a quantity by a sensor."""
    return f"sensors/{word(name)}/{quantity}"


def kinds(joint: Joint) -> list[str]:
    """Whether each of a joint's coordinates is an angle or a displacement, in the order of `Joint.motion_names`."""
    return [ANGULAR if coordinate.rotation else LINEAR for coordinate in joint.kind.coordinates]


def free_kinds(mechanism: Mechanism) -> list[str]:
    """The kind of each generalized speed u."""
    return [kind for joint in mechanism.joints.values() if not joint.drive for kind in kinds(joint)]


def driven_kinds(mechanism: Mechanism) -> list[str]:
    """The kind of each driven coordinate."""
    return [kind for joint in mechanism.joints.values() if joint.drive for kind in kinds(joint)]


def coordinates(scene: SceneDescription, rows: Rows) -> Array:
    """A position for each generalized speed, (n, nv), as `Model.coordinates` gives it for one state."""
    y = rows.of("y")
    parts = [np.empty((len(rows), 0))]
    for name, where in scene.q.items():
        values = y[:, where]
        if name in scene.quaternions:
            offset = scene.quaternions[name] - where.start
            values = np.hstack([values[:, :offset], rotation_vectors(values[:, offset:])])
        parts.append(values)
    return np.hstack(parts)


def rotation_vectors(quaternions: Array) -> Array:
    """Rotation vectors (n, 3), at most π long, of unit quaternions (n, 4) in the order (w, x, y, z)."""
    turned = np.where(quaternions[:, :1] >= 0.0, quaternions, -quaternions)
    w, v = turned[:, 0], turned[:, 1:]
    sine = np.linalg.norm(v, axis=1)
    safe = np.where(sine > 1e-9, sine, 1.0)
    factor = np.where(sine > 1e-9, 2.0 * np.arctan2(sine, w) / safe, 2.0)
    return np.asarray(v * factor[:, None])
