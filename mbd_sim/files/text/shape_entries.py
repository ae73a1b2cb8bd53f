"""The shapes of other formats as entries of a mechanism file: those that are drawn, and those that touch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.text.xml import rows

Entry = TypeVar("Entry")


def capsule(pose: Pose, radius: float, length: float) -> dict[str, Any]:
    """A cylinder of a `length` in m along z with half a ball at each end: a rod with round ends."""
    arm = pose.rotation @ np.array([0.0, 0.0, 0.5 * length])
    return {"type": "rod", "from": rows(pose.position - arm), "to": rows(pose.position + arm), "radius": radius}


def hull(mesh: dict[str, Any]) -> dict[str, Any]:
    """What touches of a mesh: the convex hull of its file."""
    return {"type": "hull", **{key: value for key, value in mesh.items() if key != "color"}}


def with_collisions(found: dict[str, list[Entry]], kind_of: Callable[[Entry], str]) -> dict[str, list[Entry]]:
    """The keys of a part for its `meshes`, its `shapes` and what touches, its `collisions`.

    A part without shapes to draw is drawn as what touches, but for hulls. Only shapes that are drawn and touch nothing
    need an empty list of collisions.

    :param kind_of: the type of a shape.
    """
    plain = [entry for entry in found["collisions"] if kind_of(entry) != "hull"]
    if not found["shapes"]:
        same = len(plain) == len(found["collisions"])
        found = {**found, "shapes": plain, "collisions": [] if same else found["collisions"]}
        return {kind: entries for kind, entries in found.items() if entries}
    return {kind: entries for kind, entries in found.items() if entries or kind == "collisions"}
