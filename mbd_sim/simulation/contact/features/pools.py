"""What is read from the slots of pools, whose parts are known at an instant only."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.base.short_repr import short_repr
from mbd_sim.dynamics.one_sided_functions import OneSidedFunctions

PLACE = 12  # the last values of a slot: see `mbd_sim.dynamics.contact.rows.slots.Slot`


class PoolReadings:
    """The places of the slots in use, and the wrenches on parts, from the values of all slots and the modes."""

    __repr__ = short_repr

    def __init__(self, functions: OneSidedFunctions) -> None:
        self._slots, self._layout = functions.slots, functions.equations.layout

    def places(self, values: Array, modes: Array, forces: Array) -> Array:
        """The points in m, the forces in N and the normals (pooled, 3, 3), in ground's frame; zero where not in use.

        :param forces: the multipliers (rows,).
        """
        found = np.zeros((self._layout.pooled, 3, 3))
        for index, rows, own, _ in self._used(values, modes):
            point, *directions = own[-PLACE:].reshape(4, 3)
            parts = [forces[row] * direction for row, direction in zip(rows, directions, strict=False)]
            total = [added(column) for column in zip(*(part.tolist() for part in parts), strict=True)]
            found[index] = point, total, directions[0]
        return found

    def wrenches(self, values: Array, modes: Array, forces: Array) -> Array:
        """What the forces of rows exert on the parts (6 parts,), in ground's axes."""
        found = np.zeros((self._layout.parts + 1, 6))  # with those on ground
        for _, rows, own, pair in self._used(values, modes):
            k = len(rows)
            factors = own[1 + 2 * k : 1 + 14 * k].reshape(k, 2, 6)
            for row, both in zip(rows, factors, strict=True):
                for part, factor in zip(pair, both, strict=True):
                    found[part] += forces[row] * factor
        return found[:-1].ravel()

    def _used(self, values: Array, modes: Array) -> Iterator[tuple[int, tuple[int, ...], Array, tuple[int, int]]]:
        """Of each slot in use: its number, its rows, its values, and its parts."""
        index, layout = 0, self._layout
        for call in self._slots.pools:
            size, stride = call.function.nnz_in(2), call.function.nnz_out(0)
            for slot in range(call.pool.slots):
                key = layout.features.start + call.numbers + size * (slot + 1) - 1
                if modes[key] != 0.0:
                    first = call.values + slot * stride
                    pair = call.pairs[int(modes[layout.holders.start + index])]
                    yield index, self._slots.rows_of_pools[index], values[first : first + stride], pair
                index += 1
