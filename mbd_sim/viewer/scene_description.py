"""The description of a mechanism that the viewer's process receives before the samples, as plain records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.appearance.extent import Extent, extent_of
from mbd_sim.appearance.trace_points import default_traces, tip_of
from mbd_sim.errors import InputError, nearest
from mbd_sim.geometry.pose import Array, Pose, identity_pose, unpack_poses
from mbd_sim.mechanism.attachments import split_reference
from mbd_sim.mechanism.constraints import Surface
from mbd_sim.mechanism.one_sided import is_one_sided
from mbd_sim.mechanism.records import GROUND, Attachment, Mechanism
from mbd_sim.mechanism.source import Location
from mbd_sim.viewer.sample_rows import RowLayout

if TYPE_CHECKING:
    from mbd_sim.simulation.compiled_model import Model

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
        contacts=model.placed_contacts,
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
            from mbd_sim.appearance.implicit_curves import curve_lines, section_lines, surface_lines

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
