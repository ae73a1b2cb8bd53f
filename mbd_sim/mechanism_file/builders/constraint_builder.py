"""From the constraints of a file to the records that the dynamics reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from mbd_sim.errors import InputError, Problem, nearest, quoted
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism import constraints as c
from mbd_sim.mechanism.attachments import end_of
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.records import Attachment, Joint
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism_file.schema import constraint_schema as schema

Places = Mapping[str, Mapping[str, Pose] | None]
NEVER = TimeExpression("0", {})
_ENDS = {
    "on_plane": ("point", "plane"),
    "on_line": ("point", "line"),
    "on_surface": ("point", "frame"),
    "on_curve": ("point", "frame"),
    "rolling": ("wheel", "plane"),
    "knife_edge": ("at", "plane"),
}


def constraint_records(
    records: Mapping[str, schema.AnyConstraintSpec],
    places: Places,
    joints: Mapping[str, Joint | None],
    source: Source,
    problems: list[Problem],
) -> tuple[c.Constraint, ...]:
    """The constraints of a file; what is wrong with the others is added to `problems`.

    :param joints: by name, None for those that cannot be read.
    """
    reader = _Reader(places, joints, source, problems)
    return tuple(found for name, record in records.items() if (found := reader.read(name, record)) is not None)


class _Reader:
    def __init__(
        self, places: Places, joints: Mapping[str, Joint | None], source: Source, problems: list[Problem]
    ) -> None:
        self._places, self._joints, self._source, self._problems = places, joints, source, problems

    def read(self, name: str, record: schema.AnyConstraintSpec) -> c.Constraint | None:
        where: Location = ("constraints", name)
        match record:
            case schema.GearSpec(joints=names, radii=(first, second), internal=internal):
                factors = {names[0]: first, names[1]: -second if internal else second}
                return self._coupled(name, factors, ("joints", names), "gear")
            case schema.RackSpec(pinion=pinion, rack=rack, radius=radius, reverse=reverse):
                factors = {pinion: radius if reverse else -radius, rack: 1.0}
                return self._coupled(name, factors, ("", (pinion, rack)), "rack")
            case schema.CouplingSpec(terms=terms, value=value):
                return self._coupled(name, terms, ("terms", tuple(terms)), "coupling", value)
            case schema.DistanceSpec(between=ends, length=length):
                frames = [self._frame((*where, "between", i), text) for i, text in enumerate(ends)]
                if not (points := self._apart((*where, "between"), frames)) or self._without_length(where, length):
                    return None
                return c.Distance(name, points[0], points[1], length)
            case schema.CableSpec(through=texts, length=length):
                frames = [self._frame((*where, "through", i), text) for i, text in enumerate(texts)]
                points = self._apart((*where, "through"), frames)
                if not points or self._without_length(where, length):
                    return None
                return c.Cable(name, tuple(points), length)
        return self._guided(name, record)

    def _guided(self, name: str, record: schema.AnyConstraintSpec) -> c.Constraint | None:
        """A point of one part led by a frame of another."""
        where: Location = ("constraints", name)
        ends = [(key, getattr(record, key)) for key in _ENDS[record.type]]
        frames = [self._frame((*where, key), text) for key, text in ends]
        points = self._apart((*where, ends[0][0]), frames)
        if not points or frames[0] is None or frames[1] is None:
            return None
        point, base = points
        turned, axes = frames[0][1].rotation, frames[1][1].rotation
        match record:
            case schema.OnPlaneSpec(normal=normal):
                return c.Flat(name, point, base, (axes @ rot.unit(normal))[None, :], "on_plane")
            case schema.OnLineSpec(direction=direction):
                across = rot.aligning_z(rot.unit(direction))[:, :2]
                return c.Flat(name, point, base, (axes @ across).T, "on_line")
            case schema.OnSurfaceSpec(type=kind, equation=one, equations=two):
                return c.Surface(name, point, base, axes, (one,) if one else two or (), kind)
            case schema.RollingSpec(axis=axis, radius=radius, normal=normal):
                turning = None if axis is None else turned @ rot.unit(axis)
                return c.Rolling(name, point, turning, radius, base, axes @ rot.unit(normal))
            case schema.KnifeEdgeSpec(direction=direction, normal=normal):
                return c.KnifeEdge(name, point, turned @ rot.unit(direction), base, axes @ rot.unit(normal))
        raise TypeError(record)

    def _frame(self, location: Location, text: str) -> tuple[str, Pose] | None:
        try:
            return end_of(text, self._places)
        except InputError as error:
            self._problems.append(self._source.problem_of(location, error))
            return None

    def _apart(self, location: Location, frames: Iterable[tuple[str, Pose] | None]) -> list[Attachment]:
        """The points, where all are known and not all of one part."""
        known = [frame for frame in frames if frame is not None]
        if len(known) < len(list(frames)):
            return []
        if len({part for part, _ in known}) < 2:
            message, remedy = f"connects '{known[0][0]}' with itself", "Name points of different parts."
            self._problems.append(self._source.problem(location, message, remedy))
            return []
        return [Attachment(part, np.array(pose.position)) for part, pose in known]

    def _without_length(self, where: Location, length: TimeExpression) -> bool:
        """Whether a length is not positive at the start, which is a problem then."""
        if (value := length.at(0.0)) > 0.0:
            return False
        message, remedy = (
            f"must be greater than 0, and is {value:g} at the start",
            "Let the points meet in a spherical joint.",
        )
        self._problems.append(self._source.problem((*where, "length"), message, remedy))
        return True

    def _coupled(
        self,
        name: str,
        factors: Mapping[str, float],
        written: tuple[str, tuple[str, ...]],
        kind: str,
        value: TimeExpression = NEVER,
    ) -> c.Coupling | None:
        key, names = written
        where: Location = ("constraints", name, *([key] if key else []))
        if None in self._joints.values():
            return None  # which coordinates there are is not known
        known = {label: joint for joint in self._joints.values() if joint for label in joint.motion_names}
        good = True
        if len(set(names)) < len(names):
            self._problems.append(self._source.problem(where, f"couples '{names[0]}' with itself", "Name two joints."))
            good = False
        for coordinate in dict.fromkeys(names):
            joint = known.get(coordinate)
            if joint is None:
                message = f"there is no joint coordinate {quoted(coordinate)}"
                self._problems.append(self._source.problem(where, message, nearest(coordinate, known)))
            elif joint.kind.quaternion is not None and coordinate.rsplit(".", 1)[1].startswith("r"):
                message = f"{quoted(coordinate)} is a component of an angular velocity: it has no coordinate to couple"
                remedy = "Couple joints that turn about axes: revolute, universal, cylindrical, planar or screw."
                self._problems.append(self._source.problem(where, message, remedy))
            elif not factors[coordinate]:
                self._problems.append(self._source.problem((*where, coordinate), "has the factor 0", "Leave it out."))
            else:
                continue
            good = False
        return c.Coupling(name, dict(factors), value, kind) if good else None


def coupled_joints(constraints: Iterable[c.Constraint], joints: Mapping[str, Joint]) -> list[str]:
    """The joints whose coordinates a constraint refers to."""
    owners = {label: joint.name for joint in joints.values() for label in joint.motion_names}
    return [
        owners[name] for constraint in constraints if isinstance(constraint, c.Coupling) for name in constraint.factors
    ]
