"""References to parts and to their points, written as `part` or `part.point`."""

from __future__ import annotations

from collections.abc import Mapping

from mbd_sim.errors import InputError, may_suggest, nearest, quoted
from mbd_sim.geometry.pose import Pose, identity_pose

GROUND_WORDS = ("world", "earth", "environment", "inertial")
PointsByPart = Mapping[str, Mapping[str, Pose] | None]  # None: the part's points are unknown, any name is accepted


def resolve_reference(text: str, points_by_part: PointsByPart) -> tuple[str, Pose]:
    """The part that a reference names, and the pose of the point in the part's frame (the identity without a point).

    :raises InputError: there is no such part or point.
    """
    part, dot, point = (word.strip() for word in text.partition("."))
    if not part:
        raise InputError(f"no part is named before the '.' of {quoted(text)}", "Write part.point.")
    if part not in points_by_part:
        raise InputError(f"there is no part {quoted(part)}", _known_part(part, points_by_part, may_be_point=not dot))
    points = points_by_part[part]
    if not dot or points is None:
        return part, identity_pose()
    if point not in points:
        known = nearest(point, points) or f"'{part}' has no points: add one under its 'points'."
        missing = (
            f"'{part}' has no point {quoted(point)}" if point else f"no point is named after the '.' of {quoted(text)}"
        )
        raise InputError(missing, known)
    return part, points[point]


def _known_part(name: str, points_by_part: PointsByPart, may_be_point: bool) -> str:
    """A remedy for the unknown name of a part, which may be that of a point."""
    if may_be_point and may_suggest():
        for part, points in points_by_part.items():
            if name in (points or {}):
                return f"Did you mean its point '{part}.{name}'?"
    return "Did you mean 'ground'?" if name.lower() in GROUND_WORDS else nearest(name, points_by_part)
