"""References to parts and to their points, written as `part` or `part.point`."""

from __future__ import annotations

from collections.abc import Mapping

from mbd_sim.errors import InputError, may_suggest, nearest, quoted
from mbd_sim.geometry.pose import Pose, identity_pose
from mbd_sim.mechanism.names import in_quotes, readings

GROUND_WORDS = ("world", "earth", "environment", "inertial")
PointsByPart = Mapping[str, Mapping[str, Pose] | None]  # None: the part's points are unknown, any name is accepted


def resolve_reference(text: str, points_by_part: PointsByPart) -> tuple[str, Pose]:
    """The part that a reference names, and the pose of the point in the part's frame (the identity without a point).

    :raises InputError: there is no such part or point, or there are two.
    """
    part, point = split_reference(text, points_by_part)
    points = points_by_part[part]
    return part, identity_pose() if point is None or points is None else points[point]


def split_reference(
    text: str, names_by_part: Mapping[str, Mapping[str, object] | None], what: str = "point"
) -> tuple[str, str | None]:
    """The part that a reference names, and `what` of the part it names, if it does.

    :raises InputError: there is no such part or name, or there are two.
    """
    possible = [(part, name) for part, name in readings(text) if part in names_by_part]
    valid = [one for one in possible if one[1] is None or _has(names_by_part[one[0]], one[1])]
    if len(valid) > 1:
        written = " or ".join(f"{in_quotes(part)}.{name}" if name else in_quotes(part) for part, name in valid)
        raise InputError(f"{quoted(text)} can mean two things", f"Put the name of the part in quotes: {written}.")
    if valid:
        return valid[0]
    if possible:
        part, name = possible[-1]
        known = nearest(name or "", names_by_part[part] or ()) or f"'{part}' has no points: add one under its 'points'."
        missing = (
            f"'{part}' has no {what} {quoted(name)}" if name else f"no {what} is named after the '.' of {quoted(text)}"
        )
        raise InputError(missing, known)
    part, dot, _ = (word.strip() for word in text.partition("."))
    if not part:
        raise InputError(f"no part is named before the '.' of {quoted(text)}", "Write part.point.")
    raise InputError(f"there is no part {quoted(part)}", _known_part(part, names_by_part, may_be_point=not dot))


def _has(names: Mapping[str, object] | None, name: str) -> bool:
    return names is None or name in names


def _known_part(name: str, names_by_part: Mapping[str, Mapping[str, object] | None], may_be_point: bool) -> str:
    """A remedy for the unknown name of a part, which may be that of a point."""
    if may_be_point and may_suggest():
        for part, points in names_by_part.items():
            if name in (points or {}):
                return f"Did you mean its point '{part}.{name}'?"
    return "Did you mean 'ground'?" if name.lower() in GROUND_WORDS else nearest(name, names_by_part)
