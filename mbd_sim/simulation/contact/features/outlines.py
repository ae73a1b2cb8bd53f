"""Pairs of outlines in one plane, for `compiled.features.outlines`."""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.contact.feature_rows import SLOT_SIZE
from mbd_sim.mechanism.elements.contacts import PlanarBody
from mbd_sim.mechanism.outlines.table import POINT, PieceTable, table_of
from mbd_sim.simulation.contact.compiled.features.outlines import Outlines
from mbd_sim.simulation.contact.compiled.features.pieces import Pieces
from mbd_sim.simulation.contact.features.narrow_phase import Bounds, CompiledPhase, FoundFeatures


class OutlinePair(CompiledPhase):
    """Two outlines: see `NarrowPhase`.

    :param names: those of both bodies, for people.
    """

    def __init__(self, first: PlanarBody, second: PlanarBody, slots: int, names: tuple[str, str]) -> None:
        self._names = names
        tables = table_of(first.outline), table_of(second.outline)
        samples = [np.array(body.outline.pieces[0].start) for body in (first, second)]
        frames = [np.concatenate([body.origin, *body.axes.T]) for body in (first, second)]
        record = Outlines(
            pieces_of(tables[0], samples[0]),
            pieces_of(tables[1], samples[1]),
            pieces_of(POINT, np.zeros(2)),
            frames[0],
            frames[1],
            min(table.size for table in tables),
            any(len(table) == 1 for table in tables),
            slots,
        )
        bounds = _sphere(first, *_circle(tables[0])), _sphere(second, *_circle(tables[1]))
        super().__init__("outline", record, bounds, slots, SLOT_SIZE, iterates=False)

    def touching(self, one: Pose, other: Pose, tolerance: float) -> list[FoundFeatures]:
        """See `NarrowPhase`.

        :raises DivergedError: they touch in more points than they have slots.
        """
        slots, count = self.found(one, other, tolerance)
        if count > len(slots):
            raise DivergedError(
                f"'{self._names[0]}' and '{self._names[1]}' touch in {count} points at once, of which a pair of "
                f"outlines can have {len(slots)}",
                "Divide one of them into several shapes.",
            )
        return [FoundFeatures(numbers.copy()) for numbers in slots[:count]]


def pieces_of(table: PieceTable, sample: Array) -> Pieces:
    """The numbers of an outline for compiled code; the sample is a point of it."""
    center, radius = _circle(table)
    return Pieces(
        len(table),
        table.straight.astype(np.int64),
        table.centers.ravel(),
        table.halves,
        table.starts.ravel(),
        table.along.ravel(),
        table.lows.ravel(),
        table.highs.ravel(),
        table.bisectors.ravel(),
        table.wide.astype(np.int64),
        table.full.astype(np.int64),
        table.hollow.astype(np.int64),
        table.corners.astype(np.int64),
        table.radii,
        table.growths,
        table.middles.ravel(),
        table.spreads,
        len(table.dents),
        table.dents.ravel(),
        table.size,
        table.shortest,
        table.thin,
        center,
        radius,
        sample,
    )


def _circle(table: PieceTable) -> tuple[Array, float]:
    """The center (2,) and the radius in m of a circle around an outline."""
    low = np.min(table.middles - table.spreads[:, None], axis=0)
    high = np.max(table.middles + table.spreads[:, None], axis=0)
    center = 0.5 * (low + high)
    return center, float(np.max(np.hypot(*(table.middles - center).T) + table.spreads))


def _sphere(body: PlanarBody, center: Array, radius: float) -> Bounds:
    """Around an outline, higher than that: both need not be at one place across their plane."""
    x, y = center.tolist()
    return Bounds(body.origin + x * body.axes[:, 0] + y * body.axes[:, 1], math.sqrt(2.0) * radius)
