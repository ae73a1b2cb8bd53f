"""`markers`: the mechanism as RViz draws it without TF, every marker in ground's frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from geometry_msgs.msg import Point, Pose, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from mbd_sim.appearance import palette
from mbd_sim.appearance.extent import extent_of, tip_of
from mbd_sim.geometry.pose import Array, pack_poses, unpack_poses
from mbd_sim.mechanism.records import GROUND, Attachment
from mbd_sim.ros.marker_shapes import COIL, DAMPER, Solid, coil, damper, joint_solids, part_solids, thickness
from mbd_sim.ros.message_template import STAMP, Template, slot
from mbd_sim.ros.snapshots import Snapshot
from mbd_sim.ros.state_messages import placed
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.viewer import entity_paths

TRACE = 150  # points of a trace: five seconds at 30 Hz


@dataclass(frozen=True, eq=False)
class _Line:
    """A line through points that move: its marker's kind, and where its points are written."""

    kind: str
    ends: tuple[int, ...]  # rows of `_Places`
    points: Array


class _Places:
    """Points of parts, all led to ground's frame at once."""

    def __init__(self, model: Model) -> None:
        self._index = {name: index for index, name in enumerate((*model.part_names, GROUND))}
        self._parts: list[int] = []
        self._points: list[Array] = []

    def add(self, at: Attachment) -> int:
        self._parts.append(self._index[at.part])
        self._points.append(at.point)
        return len(self._parts) - 1

    def of(self, poses: Array) -> Array:
        """(n, 3) from the poses (parts + 1, 12) of `model.pose_array` and of ground."""
        if not self._parts:
            return np.empty((0, 3))
        positions, rotations = unpack_poses(poses[self._parts])
        turned: Array = np.einsum("nij,nj->ni", rotations, np.array(self._points))
        return positions + turned


@dataclass(eq=False)
class Markers:
    """The markers of a mechanism, as a message whose numbers are written anew for each snapshot."""

    model: Model
    prefix: str = ""
    _messages: list[Marker] = field(default_factory=list)
    _lines: list[tuple[str, tuple[int, ...], int, int]] = field(default_factory=list)
    _time: float = np.inf

    def __post_init__(self) -> None:
        """Lay out shapes, joints, springs, dampers, links and traces."""
        model, mechanism = self.model, self.model.mechanism
        size = self._size = extent_of(model).size
        names = (*model.part_names, GROUND)
        self._solids: list[Solid] = [
            *(solid for part in mechanism.parts.values() for solid in part_solids(mechanism, part, size)),
            *(solid for joint in mechanism.all_joints.values() for solid in joint_solids(mechanism, joint, size)),
        ]
        for number, solid in enumerate(self._solids):
            self._messages.append(self._marker(solid.space, number, solid.kind, solid.scale, solid.color, solid.points))
        self._part_of = [names.index(solid.part) for solid in self._solids]
        self._local = np.array([solid.pose.position for solid in self._solids]).reshape(-1, 3)
        self._local_turn = np.array([solid.pose.rotation for solid in self._solids]).reshape(-1, 3, 3)
        self._places = _Places(model)
        self._lay_lines()
        template = self._template = Template(MarkerArray(markers=self._messages))
        self._poses = [template.doubles(number, 7) for number in range(len(self._solids))]
        self._moving = [
            _Line(kind, ends, template.doubles(number, 3 * count).reshape(-1, 3))
            for kind, ends, number, count in self._lines
        ]

    def payload(self, snapshot: Snapshot) -> bytes:
        """The message at a snapshot, serialized."""
        ground = pack_poses(np.zeros(3), np.eye(3))
        poses = np.vstack([self.model.pose_array(snapshot.time, snapshot.y, snapshot.inputs), ground])
        origins, rotations = unpack_poses(poses[self._part_of])
        positions = origins + np.einsum("nij,nj->ni", rotations, self._local)
        solids = pack_poses(positions, rotations @ self._local_turn)
        for view, pose in zip(self._poses, placed(solids), strict=True):
            view[:] = pose
        places = self._places.of(poses)
        anew, self._time = snapshot.time < self._time, snapshot.time
        for line in self._moving:
            self._write(line, places[list(line.ends)], anew)
        self._template.stamp(snapshot.clock_ns)
        return self._template.payload()

    def _write(self, line: _Line, ends: Array, anew: bool) -> None:
        match line.kind:
            case "coil":
                line.points[:] = coil(ends[0], ends[1], 0.03 * self._size)
            case "damper":
                line.points[:] = damper(ends[0], ends[1], 0.02 * self._size)
            case "trace":
                line.points[:-1] = line.points[1:]
                line.points[-1 if not anew else slice(None)] = ends[0]
            case _:
                line.points[:] = ends

    def _lay_lines(self) -> None:
        mechanism, width = self.model.mechanism, thickness(self._size)
        for tie in mechanism.ties:
            ends = (tie.first, tie.second)
            if getattr(tie, "elastic", False):
                self._line("coil", "springs", ends, COIL, width, palette.STEEL)
            if tie.damping:
                self._line("damper", "dampers", ends, DAMPER, width, palette.STEEL, Marker.LINE_LIST)
        for constraint in mechanism.constraints:
            if constraint.kind == "distance":
                self._line("link", "links", (constraint.first, constraint.second), 2, width, palette.JOINT)  # type: ignore[union-attr]
            elif constraint.kind == "cable":
                points = constraint.points  # type: ignore[union-attr]
                self._line("link", "cables", points, len(points), width, palette.JOINT)
        colors = palette.part_colors(mechanism)
        for name in entity_paths.ends(mechanism):
            at = Attachment(name, tip_of(mechanism.parts[name]))
            self._line("trace", "traces", (at,), TRACE, 0.5 * width, colors[name])

    def _line(
        self,
        kind: str,
        space: str,
        ends: tuple[Attachment, ...],
        count: int,
        width: float,
        color: palette.Color,
        drawn: int = Marker.LINE_STRIP,
    ) -> None:
        number = len(self._messages)
        points = [Point(x=slot(number)), *(Point() for _ in range(count - 1))]
        marker = self._marker(space, number, drawn, (width, 0.0, 0.0), color, ())
        marker.pose, marker.points = Pose(), points
        self._messages.append(marker)
        self._lines.append((kind, tuple(self._places.add(end) for end in ends), number, count))

    def _marker(
        self,
        space: str,
        number: int,
        kind: int,
        scale: tuple[float, float, float],
        color: palette.Color,
        points: tuple[tuple[float, float, float], ...],
    ) -> Marker:
        red, green, blue = (channel / 255.0 for channel in color)
        x, y, z = scale
        return Marker(
            header=Header(stamp=STAMP, frame_id=self.prefix + GROUND),
            ns=space,
            id=number,
            type=kind,
            pose=Pose(position=Point(x=slot(number))),
            scale=Vector3(x=x, y=y, z=z),
            color=ColorRGBA(r=red, g=green, b=blue, a=1.0),
            points=[Point(x=px, y=py, z=pz) for px, py, pz in points],
        )
