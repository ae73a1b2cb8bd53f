"""The scene that the viewer's process draws: its description, the samples of its motion, and its entities.

The process receives the description of a mechanism first, as plain records, and then rows of numbers, one for each
sample of the motion. Everything that is drawn has the same interface: each entity is logged once, at its path in the
recording, and changes by columns. Points and directions of parts are computed in ground's frame, and the coordinates of
joints with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose, identity_pose, unpack_poses
from mbd_sim.base.geometry.rotation import quaternions
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.source import Location
from mbd_sim.pictures.shapes import joints
from mbd_sim.pictures.shapes.extent import Extent, extent_of
from mbd_sim.pictures.shapes.joints import default_traces, traced_points
from mbd_sim.pictures.shapes.primitives import Primitive, wires
from mbd_sim.simulation.run.events import EventKind

if TYPE_CHECKING:
    from mbd_sim.simulation.model.model import Model
    from mbd_sim.simulation.model.state_records import Energies


ENERGY_NUMBERS = 7  # numbers of `Energies`
FIELDS = ("times", "energies", "y", "inputs", "poses", "drives", "contacts", "reactions")


@dataclass(frozen=True)
class RowLayout:
    """The layout of a row; SI units throughout.

    `times` are the time on the timeline and the mechanism's own; `energies` the fields of `Energies`; `poses` the
    position and the rotation matrix, column by column, of each of `parts`; `drives` the positions, speeds and forces of
    the driven coordinates; `contacts` the point, the force and the normal of each contact that has a place; `reactions`
    the force and moment through each joint, those of the tree first.
    """

    state: int
    inputs: int
    parts: int
    driven: int
    contacts: int
    joints: int

    @cached_property
    def slices(self) -> Mapping[str, slice]:
        """The slice of a row that each of `FIELDS` occupies."""
        sizes = (
            *(2, ENERGY_NUMBERS, self.state, self.inputs, 12 * self.parts),
            *(3 * self.driven, 9 * self.contacts, 6 * self.joints),
        )
        stops = np.cumsum(sizes).tolist()
        return {name: slice(stop - size, stop) for name, size, stop in zip(FIELDS, sizes, stops, strict=True)}

    @cached_property
    def width(self) -> int:
        """The number of columns."""
        return int(self.slices[FIELDS[-1]].stop)


class RowMaker:
    """Makes rows from the states of a model with as little work as possible: the simulation may be waiting."""

    def __init__(self, model: Model, reactions: bool = False) -> None:
        joints = len(model.mechanism.all_joints) if reactions else 0
        contacts = len(model.contact_readings.placed)
        self.layout = RowLayout(
            len(model.start), len(model.inputs), len(model.part_names), len(model.driven_names), contacts, joints
        )
        self._model, self._reactions = model, reactions
        self._energies, self._y, self._inputs, self._poses, self._drives, self._contacts, self._forces = (
            self.layout.slices[name] for name in FIELDS[1:]
        )

    def row(self, time: float, motion_time: float, y: Array, inputs: Array, energies: Energies) -> Array:
        """A row (width,); `inputs` may end after the efforts where nothing else is commanded."""
        model, row = self._model, np.empty(self.layout.width)
        if len(inputs) < len(model.inputs):
            inputs = np.concatenate([inputs, model.inputs[len(inputs) :]])
        row[0], row[1] = time, motion_time
        row[self._energies] = energies
        row[self._y], row[self._inputs] = y, inputs
        row[self._poses] = model.pose_array(motion_time, y, inputs).ravel()
        if self.layout.driven:
            row[self._drives] = model.drives(motion_time, y, inputs).ravel()
        if self.layout.contacts:
            row[self._contacts] = model.contact_readings.places(motion_time, y, inputs).ravel()
        if self._reactions:
            found = model.reactions(motion_time, y, inputs).values()
            row[self._forces] = np.concatenate([part for reaction in found for part in reaction])
        return row


class Rows:
    """Samples (n, width), accessed by field."""

    def __init__(self, layout: RowLayout, values: Array) -> None:
        self._layout, self.values = layout, values

    def __len__(self) -> int:
        return len(self.values)

    def of(self, field: str) -> Array:
        """A field, (n, its size)."""
        return self.values[:, self._layout.slices[field]]

    @property
    def times(self) -> Array:
        """The times on the timeline, (n,), s."""
        return self.values[:, 0]

    @property
    def motion_times(self) -> Array:
        """The mechanism's own times, (n,), s."""
        return self.values[:, 1]

    @cached_property
    def positions(self) -> Array:
        """The positions of the parts in ground's frame, (n, parts, 3), m."""
        return unpack_poses(self.of("poses").reshape(len(self), -1, 12))[0]

    @cached_property
    def rotations(self) -> Array:
        """The rotation matrices of the parts in ground's frame, (n, parts, 3, 3)."""
        return unpack_poses(self.of("poses").reshape(len(self), -1, 12))[1]


TRACE_TIME = 1.0  # s


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
    wires: tuple[Primitive, ...]
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

    :raises InputError: a trace names a part or point that does not exist.
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
        wires=tuple(wires(model, extent)),
        method=model.method_name,
        options=options,
    )


def _traces(mechanism: Mechanism, chosen: Sequence[str] | None) -> Mapping[str, Attachment]:
    if chosen is None:
        return default_traces(mechanism)
    return {name: Attachment(*at) for name, at in zip(chosen, traced_points(mechanism, chosen), strict=True)}


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


def is_closed(scene: SceneDescription, owner: Location, rows: Rows) -> Array:
    """In which of the n samples (n,) the contact of an element is closed; always if it is not one-sided."""
    own = [index for other, index in scene.contacts if other == owner and index is not None]
    if not own:
        return np.ones(len(rows), dtype=bool)
    return np.asarray((rows.of("inputs")[:, own] > 0.0).any(axis=1))


def weight(scene: SceneDescription) -> float:
    """The force in N that an arrow of full length stands for by default."""
    return joints.weight(scene.mechanism, scene.extent.size)


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """An event at a time (s) on the timeline, with its text."""

    time: float
    kind: EventKind
    text: str
