"""The shapes of other formats as entries of a mechanism file: those that are drawn, and those that touch."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.text.xml import rows

Entry = TypeVar("Entry")


def capsule(pose: Pose, radius: float, length: float) -> dict[str, Any]:
    """A cylinder of a `length` in m along z with half a ball at each end: a rod with round ends."""
    arm = pose.rotation @ np.array([0.0, 0.0, 0.5 * length])
    return {"type": "rod", "from": rows(pose.position - arm), "to": rows(pose.position + arm), "radius": radius}


def with_collisions(found: dict[str, list[Entry]]) -> dict[str, list[Entry]]:
    """The keys of a part for its `meshes`, its `shapes` and what touches, its `collisions`.

    A part without shapes to draw is drawn as what touches. Only shapes that are drawn and touch nothing need an empty
    list of collisions.
    """
    if not found["shapes"]:
        found = {**found, "shapes": found["collisions"], "collisions": []}
        return {kind: entries for kind, entries in found.items() if entries}
    return {kind: entries for kind, entries in found.items() if entries or kind == "collisions"}
