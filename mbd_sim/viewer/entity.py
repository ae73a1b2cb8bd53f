"""What stands on the stage besides the parts: each prop is logged once, and moves by columns."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.sample_rows import Rows

LoggedItems = Iterator[tuple[str, Any]]  # an entity, and what of Rerun goes there


class Entity(Protocol):
    """Something in the scene, or a line in a plot."""

    def static(self) -> LoggedItems:
        """What does not change: shapes, styles, names."""

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        """What changes, a row for each sample."""
