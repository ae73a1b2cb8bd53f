"""The noise of one sensor: white noise, walking biases and lost samples as functions of the sample's number."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.sensing.random_numbers import RandomNumbers

BLOCK = 64  # samples that are generated together, a power of two
KEPT = 8  # blocks that are kept of each kind
_WHITE, _WALK_INSIDE, _WALK_BETWEEN, _LOST = range(4)  # purposes of random numbers


class Noise:
    """Noise of several components, in units of its standard deviation; see `ErrorModel`.

    A walk W is Brownian motion with W(0) = 0 and steps of variance 1 from one sample to the next. Its value at a
    sample is found by Lévy's construction: from its values at powers of two blocks by repeated halving, each time with
    a normal number of its own. So it takes a time that grows like the logarithm of the sample's number.
    """

    def __init__(self, seed: int, name: str, components: int, drop_out: float) -> None:
        """Select the noise of a sensor by its name; samples are lost with the probability `drop_out`."""
        self._numbers, self._components = RandomNumbers(seed, name), components
        self._threshold = round(drop_out * 2.0**64)
        self._white = _Blocks(self._white_block)
        self._walks = _Blocks(self._walk_block)
        self._lost = _Blocks(self._lost_block)
        self._bounds: dict[int, Array] = {0: np.zeros(components)}

    @property
    def loses_samples(self) -> bool:
        """Whether any samples are lost."""
        return self._threshold > 0

    def white(self, sample: int) -> Array:
        """(components,) independent normal numbers."""
        return self._white.at(sample)

    def walk(self, sample: int) -> Array:
        """(components,) values of independent walks."""
        return self._walks.at(sample)

    def is_lost(self, sample: int) -> bool:
        """Whether a sample is lost."""
        return self._threshold > 0 and bool(self._lost.at(sample)[0])

    def _white_block(self, block: int) -> Array:
        count = BLOCK * self._components
        return self._numbers.normals(_WHITE, block, count).reshape(BLOCK, self._components)

    def _lost_block(self, block: int) -> Array:
        integers = self._numbers.integers(_LOST, block, BLOCK)
        return np.array([[float(integer < self._threshold)] for integer in integers.tolist()])

    def _walk_block(self, block: int) -> Array:
        """The walk at the samples of a block, between its values at the ends of the block."""
        count = BLOCK * self._components
        normals = self._numbers.normals(_WALK_INSIDE, block, count).reshape(BLOCK, self._components)
        values = np.empty((BLOCK + 1, self._components))
        values[0], values[BLOCK] = self._bound(block), self._bound(block + 1)
        half = BLOCK // 2
        while half:
            middle = slice(half, BLOCK, 2 * half)
            ends = values[: BLOCK - half : 2 * half] + values[2 * half :: 2 * half]
            values[middle] = 0.5 * ends + math.sqrt(0.5 * half) * normals[middle]
            half //= 2
        return values[:BLOCK]

    def _bound(self, block: int) -> Array:
        """The walk at the first sample of a block."""
        if block not in self._bounds:
            lowest = block & -block
            normals = self._numbers.normals(_WALK_BETWEEN, block, self._components)
            if block == lowest:
                before, variance = self._bound(block // 2), float(block - block // 2)
            else:
                before = 0.5 * (self._bound(block - lowest) + self._bound(block + lowest))
                variance = lowest / 2
            self._bounds[block] = before + math.sqrt(BLOCK * variance) * normals
            self._forget(block)
        return self._bounds[block]

    def _forget(self, block: int) -> None:
        """Keep the values at powers of two, and the latest others."""
        if len(self._bounds) > 4096:
            kept = [one for one in self._bounds if one & (one - 1) == 0 or abs(one - block) < 2048]
            self._bounds = {one: self._bounds[one] for one in kept}


class _Blocks:
    """The values of the latest blocks."""

    def __init__(self, make: Callable[[int], Array]) -> None:
        self._make = make
        self._kept: dict[int, Array] = {}

    def at(self, sample: int) -> Array:
        """The row of a sample."""
        block, row = divmod(sample, BLOCK)
        values = self._kept.get(block)
        if values is None:
            if len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            values = self._kept[block] = self._make(block)
        return np.asarray(values[row])
