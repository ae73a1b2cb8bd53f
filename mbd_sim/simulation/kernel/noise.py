"""The noise of sensors: white noise, walking biases and lost samples as functions of the sample's number.

Random numbers are found by their address: they are the same on every machine, in any order, and from the middle of a
run. Philox 4x64-10 (Salmon et al. 2011) is a counter-based generator: a block of numbers is a function of a key and a
counter, without a state. Normal numbers come from uniform ones by the inverse of the distribution function (Wichura
1988, AS 241, algorithm PPND16), with additions, multiplications, divisions and square roots only, which are the same
to the last bit on all machines; logarithms of libraries are not.

Measurement errors apply the noise to a sensor's exact values.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.sensors import ErrorModel

_LN2 = 0.6931471805599453
_CENTRAL = (
    (2509.0809287301226727, 33430.575583588128105, 67265.770927008700853, 45921.953931549871457,
     13731.693765509461125, 1971.5909503065514427, 133.14166789178437745, 3.387132872796366608),
    (5226.495278852545925, 28729.085735721942674, 39307.89580009271061, 21213.794301586595867,
     5394.1960214247511077, 687.1870074920579083, 42.313330701600911252, 1.0),
)  # fmt: skip
_OUTER = (
    (7.7454501427834140764e-4, 0.0227238449892691845833, 0.24178072517745061177, 1.27045825245236838258,
     3.64784832476320460504, 5.7694972214606914055, 4.6303378461565452959, 1.42343711074968357734),
    (1.05075007164441684324e-9, 5.475938084995344946e-4, 0.0151986665636164571966, 0.14810397642748007459,
     0.68976733498510000455, 1.6763848301838038494, 2.05319162663775882187, 1.0),
)  # fmt: skip
_FAR = (
    (2.01033439929228813265e-7, 2.71155556874348757815e-5, 0.0012426609473880784386, 0.026532189526576123093,
     0.29656057182850489123, 1.7848265399172913358, 5.4637849111641143699, 6.6579046435011037772),
    (2.04426310338993978564e-15, 1.4215117583164458887e-7, 1.8463183175100546818e-5, 7.868691311456132591e-4,
     0.0148753612908506148525, 0.13692988092273580531, 0.59983220655588793769, 1.0),
)  # fmt: skip


class RandomNumbers:
    """The random numbers of one source, which a seed and a name select."""

    def __init__(self, seed: int, name: str) -> None:
        digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=16).digest()
        self._key = np.frombuffer(digest, dtype="<u8").astype(np.uint64)

    def integers(self, purpose: int, block: int, count: int) -> NDArray[np.uint64]:
        """(count,) uniform integers of 64 bits at an address; fewer than 2⁶⁴ of them are disjoint from other blocks."""
        counter = np.array([0, block, purpose, 0], dtype=np.uint64)
        return np.random.Philox(key=self._key, counter=counter).random_raw(count)

    def normals(self, purpose: int, block: int, count: int) -> Array:
        """(count,) independent normal numbers with mean 0 and standard deviation 1 at an address."""
        return normal(uniform(self.integers(purpose, block, count)))


def uniform(integers: NDArray[np.uint64]) -> Array:
    """Numbers in the middle of the 2⁵² cells between 0 and 1, neither of which is among them."""
    return ((integers >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def normal(probability: Array) -> Array:
    """The numbers (n,) below which normal ones are with these probabilities, to a relative error of 1e-15."""
    offset = probability - 0.5
    central = np.abs(offset) <= 0.425
    squared = 0.180625 - offset * offset
    values = offset * _ratio(_CENTRAL, np.where(central, squared, 0.0))
    tails = np.flatnonzero(~central)
    if len(tails):
        tail = np.where(offset[tails] < 0.0, probability[tails], 1.0 - probability[tails])
        root = np.sqrt(-natural_logarithm(tail))
        sizes = np.where(root <= 5.0, _ratio(_OUTER, root - 1.6), _ratio(_FAR, root - 5.0))
        values[tails] = np.copysign(sizes, offset[tails])
    return values


def natural_logarithm(x: Array) -> Array:
    """ln x of positive numbers: e ln 2 + 2 artanh((m - 1)/(m + 1)) with x = m 2ᵉ and m between √½ and √2."""
    mantissa, exponent = np.frexp(x)
    small = mantissa < 0.7071067811865476
    mantissa, exponent = np.where(small, 2.0 * mantissa, mantissa), np.where(small, exponent - 1, exponent)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    squared, series = s * s, np.zeros_like(s)
    for power in range(25, 0, -2):
        series = series * squared + 1.0 / power
    return exponent * _LN2 + 2.0 * s * series


def _ratio(coefficients: tuple[tuple[float, ...], tuple[float, ...]], x: Array) -> Array:
    """A rational function; its coefficients are in order of decreasing powers."""
    parts = []
    for polynomial in coefficients:
        value = np.full_like(x, polynomial[0])
        for coefficient in polynomial[1:]:
            value = value * x + coefficient
        parts.append(value)
    return np.asarray(parts[0] / parts[1])


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


class MeasurementErrors:
    """The errors of the components of a sensor's quantities, in order; see `ErrorModel`.

    `deviations` (n,) are the standard deviations of the white noise, `resolutions` (n,) those of `ErrorModel`.
    """

    def __init__(self, models: Sequence[ErrorModel], sizes: Sequence[int], period: float, noise: Noise) -> None:
        """Take an error model for each quantity, the number of its components, and the time between samples in s."""

        def each(values: Sequence[float]) -> Array:
            return np.repeat(np.array(values, dtype=float), sizes)

        self._noise = noise
        self.deviations = each([model.noise_density / math.sqrt(period) for model in models])
        self.resolutions = each([model.resolution for model in models])
        self._bias = each([model.bias for model in models])
        self._walk = each([model.bias_walk * math.sqrt(period) for model in models])
        self._limit = each([model.limit for model in models])
        self._adds = bool(np.any(self._bias) or np.any(self._walk) or np.any(self.deviations))
        self._rounded = np.flatnonzero(self.resolutions)
        self._steps = self.resolutions[self._rounded]
        self._limits = bool(np.any(np.isfinite(self._limit)))
        self._walks, self._is_noisy = bool(np.any(self._walk)), bool(np.any(self.deviations))

    def added(self, sample: int) -> Array | None:
        """(n,) what is added to the exact values; None if nothing ever is."""
        if not self._adds:
            return None
        error = self._bias.copy()
        if self._walks:
            error += self._walk * self._noise.walk(sample)
        if self._is_noisy:
            error += self.deviations * self._noise.white(sample)
        return error

    def rounded_and_limited(self, values: Array) -> Array:
        """(n,) values as multiples of the resolution, ties to even ones, within the limits."""
        if len(self._rounded):
            values = values.copy()
            values[self._rounded] = np.rint(values[self._rounded] / self._steps) * self._steps
        return np.maximum(np.minimum(values, self._limit), -self._limit) if self._limits else values
