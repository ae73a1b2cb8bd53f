"""Parts and points by their names, as `part` or `part.point`."""

from __future__ import annotations

from collections.abc import Mapping

from mbd_sim.errors import InputError, nearest, quoted
from mbd_sim.geometry.pose import Pose, identity_pose


def end_of(text: str, places: Mapping[str, Mapping[str, Pose] | None]) -> tuple[str, Pose]:
    """The part that a text names, and the frame on it: the part's own where no point is named.

    :param places: the points of each part, or None where any name may stand.
    :raises InputError: there is no such part or point.
    """
    part, dot, point = (word.strip() for word in text.partition("."))
    if not part:
        raise InputError(f"no part is named before the '.' of {quoted(text)}", "Write part.point.")
    if part not in places:
        owners = [f"{name}.{part}" for name, points in places.items() if not dot and part in (points or {})]
        remedy = f"Did you mean its point '{owners[0]}'?" if owners else nearest(part, places)
        raise InputError(f"there is no part {quoted(part)}", remedy)
    points = places[part]
    if not dot or points is None:
        return part, identity_pose()
    if point not in points:
        known = nearest(point, points) or f"'{part}' has no points: add one under its 'points'."
        missing = (
            f"'{part}' has no point {quoted(point)}" if point else f"no point is named after the '.' of {quoted(text)}"
        )
        raise InputError(missing, known)
    return part, points[point]
