"""Random numbers by their address: the same on every machine, in any order, and from the middle of a run.

Philox 4x64-10 (Salmon et al. 2011) is a counter-based generator: a block of numbers is a function of a key and a
counter, without a state. Normal numbers come from uniform ones by the inverse of the distribution function (Wichura
1988, AS 241, algorithm PPND16), with additions, multiplications, divisions and square roots only, which are the same
to the last bit on all machines; logarithms of libraries are not.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from mbd_sim.geometry.pose import Array

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
    """The normal numbers (n,) that are exceeded from below with these probabilities, to a relative error of 1e-15."""
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
