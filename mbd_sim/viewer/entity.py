"""The interface of everything that is drawn: each entity is logged once, and changes by columns."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.sample_rows import Rows

LoggedItems = Iterator[tuple[str, Any]]  # the path of an entity, and the archetype or columns logged there


class Entity(Protocol):
    """Something in the scene, or the curves of a plot."""

    def static(self) -> LoggedItems:
        """The archetypes that do not change: shapes, styles, names."""

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        """The columns that change, one row for each sample."""
