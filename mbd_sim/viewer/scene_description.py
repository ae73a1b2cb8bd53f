"""All that the viewer's side has to know of a mechanism before the motion begins, as plain records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.appearance.extent import Extent, extent_of, tip_of
from mbd_sim.errors import InputError, nearest
from mbd_sim.geometry.pose import Array, Pose, identity_pose, unpack_poses
from mbd_sim.mechanism.attachments import end_of
from mbd_sim.mechanism.constraints import Surface
from mbd_sim.mechanism.records import GROUND, Attachment, Mechanism
from mbd_sim.viewer import entity_paths
from mbd_sim.viewer.sample_rows import RowLayout

if TYPE_CHECKING:
    from mbd_sim.simulation.compiled_model import Model

TRACE_TIME = 1.0  # s


@dataclass(frozen=True)
class DisplayOptions:
    """What a person may choose.

    `traces` of points (`part` or `part.point`; None: the ends of the chains), how long they stay in s of simulated
    time, and whether the forces through the joints are shown.
    """

    traces: tuple[str, ...] | None = None
    trace_time: float = TRACE_TIME
    reactions: bool = False


@dataclass(frozen=True, eq=False)
class ConstraintLines:
    """Lines (n, 3) in a part's frame that a curve or a surface is drawn with."""

    name: str
    part: str
    lines: tuple[Array, ...]
    surface: bool


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """A mechanism made ready to be shown.

    `q` and `u` say where the coordinates and speeds of each joint stand in the state, `wrenches` where the commanded
    wrench on each part stands among the inputs, and `quaternions` where that of a joint begins in the state.
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
    part_names: tuple[str, ...]
    start: Array
    traces: Mapping[str, Attachment]
    constraint_lines: tuple[ConstraintLines, ...]
    method: str
    options: DisplayOptions

    @property
    def start_poses(self) -> Mapping[str, Pose]:
        """Where the parts are at the start, and ground."""
        poses = (Pose(*pose) for pose in zip(*unpack_poses(self.start), strict=True))
        return {GROUND: identity_pose(), **dict(zip(self.part_names, poses, strict=True))}

    def at_start(self, at: Attachment) -> Array:
        """A point (3,) in ground's frame at the start."""
        pose = self.start_poses[at.part]
        return pose.position + pose.rotation @ at.point


def describe_scene(model: Model, rows: RowLayout, options: DisplayOptions) -> SceneDescription:
    """Look at a model.

    :raises ValueError: a trace names a part or point that does not exist.
    """
    mechanism = model.mechanism
    return SceneDescription(
        mechanism=mechanism,
        extent=extent_of(model),
        rows=rows,
        nq=model.layout.nq,
        nv=model.layout.nv,
        wrenches=dict(model.equations.inputs.wrenches),
        q=model.layout.q,
        u=model.layout.u,
        quaternions=dict(model.quaternions),
        part_names=tuple(model.part_names),
        start=model.pose_array(0.0, model.start),
        traces=_traces(mechanism, options.traces),
        constraint_lines=tuple(_wires(model)),
        method=model.method.name,
        options=options,
    )


def _traces(mechanism: Mechanism, wanted: Sequence[str] | None) -> Mapping[str, Attachment]:
    if wanted is None:
        return {name: Attachment(name, tip_of(mechanism.parts[name])) for name in entity_paths.ends(mechanism)}
    slices = {name: part.points for name, part in mechanism.parts.items()}
    found: dict[str, Attachment] = {}
    for text in wanted:
        try:
            part, pose = end_of(text, slices)
        except InputError as error:
            raise ValueError(f"traces: {error.message}. {error.remedy or nearest(text, slices)}") from error
        point = pose.position if "." in text else tip_of(mechanism.parts[part])
        found[text] = Attachment(part, np.array(point))
    return found


def _wires(model: Model) -> list[ConstraintLines]:
    """The curves and surfaces that points keep to, as they are at the start."""
    found: list[ConstraintLines] = []
    for record in model.mechanism.constraints:
        if isinstance(record, Surface):
            from mbd_sim.appearance.implicit_curves import curve_lines, surface_lines

            poses = {GROUND: identity_pose(), **model.poses(0.0, model.start)}
            point = poses[record.point.part] @ Pose(record.point.point, np.eye(3))
            on = (poses[record.base.part].inverse() @ point).position
            base = Pose(record.base.point, record.axes)
            one = len(record.equations) == 1
            drawn = (
                surface_lines(record, on, base, np.array([0.55, -1.0, 0.5])) if one else curve_lines(record, on, base)
            )
            lines = tuple(wire.points for wire in drawn if wire.kind != "outline" and len(wire.points) > 1)
            found.append(ConstraintLines(record.name, record.base.part, lines, surface=one))
    return found
