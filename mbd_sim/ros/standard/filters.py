"""Which entities a request selects: by a pattern of their names, by their kinds, tags, and by what they overlap."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.ros.standard.messages import array

_CLASSES = {  # of POSIX, within brackets
    "alpha": "a-zA-Z", "digit": "0-9", "alnum": "a-zA-Z0-9", "upper": "A-Z", "lower": "a-z", "space": r"\s",
    "punct": r"!-/:-@\[-`{-~", "xdigit": "0-9A-Fa-f", "word": r"\w",
}  # fmt: skip
_LONGEST, _MOST_REPETITIONS = 200, 3  # beyond which a pattern might take for ever


class UnsupportedError(InputError):
    """A kind of filter that is not supported."""


def name_filter(pattern: str) -> Callable[[str], bool]:
    """Whether a name matches a POSIX extended regular expression anywhere; every name matches an empty one.

    :raises InputError: it is none, or might take too long.
    """
    if (
        len(pattern) > _LONGEST
        or len(re.findall(r"[*+{]", pattern)) > _MOST_REPETITIONS
        or re.search(r"\)[*+{]", pattern)
    ):
        limits = f"Use at most {_LONGEST} characters and {_MOST_REPETITIONS} of *, + and {{}}, and none after a group."
        raise InputError("the filter is too complicated", limits)
    text = re.sub(r"\[:(\w+):\]", lambda match: _CLASSES.get(match[1], match[0]), pattern)
    try:
        compiled = re.compile(text)
    except re.error as error:
        raise InputError(f"the filter is not a regular expression: {error}", "Correct it.") from error
    return lambda name: compiled.search(name) is not None


def tags_allow(tags: Any) -> bool:
    """Whether something without tags passes: only where none are asked for."""
    return not tags.tags


@dataclass(frozen=True, eq=False)
class EntityBox:
    """A box with half sizes (3,) around a center in the axes of a pose."""

    pose: Pose
    half: Array


def overlap_filter(bounds: Any, kinds: ModuleType) -> Callable[[EntityBox], bool] | None:
    """Whether a box overlaps the bounds of a request, in ground's axes; None if these are empty.

    :raises InputError: the points do not fit the type of the bounds; `UnsupportedError` for a convex hull.
    """
    known = kinds.Bounds
    points = np.array([array(point) for point in bounds.points]).reshape(-1, 3)
    if bounds.type == known.TYPE_EMPTY:
        return None
    if bounds.type not in (known.TYPE_SPHERE, known.TYPE_BOX):
        raise UnsupportedError("bounds of this type are not supported", "Use a box or a sphere.")
    if len(points) != 2 or not np.all(np.isfinite(points)):
        raise InputError("the bounds need two points of finite numbers", "Give them.")
    if bounds.type == known.TYPE_SPHERE:
        center, radius = points[0], float(points[1, 0])
        return lambda box: _distance(box, center) <= radius
    lower, upper = points.min(axis=0), points.max(axis=0)
    given = EntityBox(Pose(0.5 * (lower + upper), np.eye(3)), 0.5 * (upper - lower))
    return lambda box: _overlap(box, given)


def _distance(box: EntityBox, point: Array) -> float:
    """From a point to a box; 0 inside."""
    local = box.pose.rotation.T @ (point - box.pose.position)
    return float(np.linalg.norm(np.maximum(np.abs(local) - box.half, 0.0)))


def _overlap(one: EntityBox, other: EntityBox) -> bool:
    """Whether two boxes overlap: no normal of a face, and no product of two edges, separates them."""
    axes = [*one.pose.rotation.T, *other.pose.rotation.T]
    axes += [np.cross(a, b) for a in one.pose.rotation.T for b in other.pose.rotation.T]
    between = other.pose.position - one.pose.position
    return all(
        abs(axis @ between) <= sum(float(np.abs(axis @ box.pose.rotation) @ box.half) for box in (one, other)) + 1e-12
        for axis in axes
    )
