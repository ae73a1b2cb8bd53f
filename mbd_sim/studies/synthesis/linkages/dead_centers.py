"""Crank-rockers and slider-cranks for a given swing or stroke and time ratio.

In its dead centers the crank is in line with the coupler, so that the follower's pin B is at the distances b - a and
b + a from the crank's pivot. Between them the crank turns by 180 deg + α one way and 180 deg - α the other way, which
gives the time ratio Q = (180 + α)/(180 - α), and α is the angle at which the pivot sees the chord s of both pins. The
law of cosines leaves a family of linkages (Alt 1932; Hall 1961; Norton 2020, ch. 3):

    s² = 4 b² sin²(α/2) + 4 a² cos²(α/2)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record

SAMPLES = 2001  # members of the family
LONGEST = 10.0  # ratio of the longest to the shortest link, at most, by default
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class DeadCenterFourBar:
    """A crank-rocker: `crank`, `coupler`, `rocker` and `base` in m, and its least `transmission` angle in rad."""

    crank: float
    coupler: float
    rocker: float
    base: float
    transmission: float

    @property
    def longest(self) -> float:
        """The ratio of its longest to its shortest link."""
        lengths = (self.crank, self.coupler, self.rocker, self.base)
        return max(lengths) / min(lengths)


@dataclass(frozen=True)
class DeadCenterSlider:
    """A slider-crank: `crank`, `coupler`, `offset` of the guide in m, and its least `transmission` angle in rad."""

    crank: float
    coupler: float
    offset: float
    transmission: float

    @property
    def longest(self) -> float:
        """The ratio of its coupler to its crank."""
        return self.coupler / self.crank


DeadCenterLinkage = DeadCenterFourBar | DeadCenterSlider


@record
class DeadCenterFamily:
    """The `best` linkage by its transmission angle, and the `family` from which it was chosen."""

    best: DeadCenterLinkage
    family: tuple[DeadCenterLinkage, ...]


def crank_rockers(
    swing: float, time_ratio: float = 1.0, rocker: float = 1.0, *, longest: float = LONGEST, crank: float | None = None
) -> DeadCenterFamily:
    """Crank-rockers whose rocker swings by an angle in rad, with a ratio of the times of its strokes.

    :param rocker: its length in m.
    :param longest: the largest ratio of the longest to the shortest link.
    :param crank: its length in m, if it is given.
    :raises InputError: there is no such linkage.
    """
    if not 0.0 < swing < np.pi:
        raise InputError(f"a swing of {np.degrees(swing):.6g} deg is not possible", "Give 0 to 180 deg.")
    chord = 2.0 * rocker * np.sin(0.5 * swing)

    def members(a: float, b: float) -> Iterator[DeadCenterFourBar]:
        yield from _four_bars(a, b, rocker, swing)

    return _best(chord, time_ratio, members, longest, crank, f"a swing of {np.degrees(swing):.6g} deg")


def slider_cranks(
    stroke: float, time_ratio: float = 1.0, *, longest: float = LONGEST, crank: float | None = None
) -> DeadCenterFamily:
    """Slider-cranks with a stroke in m and a ratio of the times of both strokes; see `crank_rockers`.

    :raises InputError: there is no such linkage.
    """
    if not 0.0 < stroke < np.inf:
        raise InputError(f"a stroke of {stroke:.6g} m is not possible", "Give a positive length.")
    alpha = imbalance(time_ratio)

    def members(a: float, b: float) -> Iterator[DeadCenterSlider]:
        offset = float((b * b - a * a) * np.sin(alpha) / stroke)
        if a + offset < b:
            yield DeadCenterSlider(a, b, offset, float(np.arccos((a + offset) / b)))

    return _best(stroke, time_ratio, members, longest, crank, f"a stroke of {stroke:.6g} m")


def imbalance(time_ratio: float) -> float:
    """The angle α in rad of a time ratio, of the slow to the fast stroke.

    :raises InputError: the ratio is not at least 1.
    """
    if not 1.0 <= time_ratio < np.inf:
        raise InputError(
            f"a time ratio of {time_ratio:.6g} is not possible", "Give that of the slow to the fast stroke."
        )
    return float(np.pi * (time_ratio - 1.0) / (time_ratio + 1.0))


def _best(
    chord: float, time_ratio: float, members: Callable[[float, float], Iterator[DeadCenterLinkage]], longest: float,
    crank: float | None, what: str,
) -> DeadCenterFamily:  # fmt: skip
    """The member with the largest least transmission angle, and samples of the family."""
    alpha = imbalance(time_ratio)

    def at(places: Array) -> list[DeadCenterLinkage]:
        pairs = [_lengths(chord, alpha, float(place), longest) for place in places]
        return [one for pair in pairs for one in members(*pair) if one.longest <= longest * (1.0 + ROUND_OFF)]

    if crank is not None and alpha > 0.0:
        square = chord**2 - 4.0 * crank**2 * np.cos(0.5 * alpha) ** 2
        family = [*members(crank, float(np.sqrt(square)) / (2.0 * np.sin(0.5 * alpha)))] if square > 0.0 else []
    elif crank is not None:
        raise InputError("with equal times, half the chord is the length of the crank", "Leave the crank out.")
    else:
        places = np.linspace(0.0, 1.0, SAMPLES)[1:-1]
        family = at(places)
        for _ in range(6):  # closer and closer samples around the best place
            if not family:
                break
            quality = [
                max((one.transmission for one in at(places[k : k + 1])), default=-1.0) for k in range(len(places))
            ]
            index = int(np.argmax(quality))
            places = np.linspace(places[max(index - 1, 0)], places[min(index + 1, len(places) - 1)], 41)
            family += at(places)
    if not family:
        raise InputError(
            f"there is no linkage for {what} and a time ratio of {time_ratio:.6g}",
            "Give a smaller time ratio, another swing, or a larger ratio of the links.",
        )
    return DeadCenterFamily(max(family, key=lambda one: one.transmission), tuple(family))


def _lengths(chord: float, alpha: float, place: float, longest: float) -> tuple[float, float]:
    """Crank and coupler of a member of the family, at a place between 0 and 1."""
    if alpha == 0.0:
        a = 0.5 * chord
        return a, a * (1.0 + place * (longest - 1.0))
    a = place * 0.5 * chord  # beyond half the chord, the coupler is shorter than the crank
    b = np.sqrt(chord**2 - 4.0 * a * a * np.cos(0.5 * alpha) ** 2) / (2.0 * np.sin(0.5 * alpha))
    return float(a), float(b)


def _four_bars(a: float, b: float, c: float, swing: float) -> Iterator[DeadCenterFourBar]:
    """Crank-rockers of these lengths with this swing: the pivot of the crank is on either side of the chord."""
    low, high = c * np.exp(1j * (0.5 * np.pi + 0.5 * swing)), c * np.exp(1j * (0.5 * np.pi - 0.5 * swing))
    near, far, chord = b - a, b + a, abs(high - low)
    if near <= 0.0 or near + chord < far * (1.0 - ROUND_OFF):
        return
    along = (near**2 - far**2 + chord**2) / (2.0 * chord)
    height = np.sqrt(max(near**2 - along**2, 0.0))
    for side in (-1.0, 1.0):
        pivot = low + (along + side * height * 1j) * (high - low) / chord
        base = float(abs(pivot))
        if not _is_crank(a, b, c, base) or np.imag(np.conj(pivot) * low) * np.imag(np.conj(pivot) * high) <= 0.0:
            continue
        cosines = [(b * b + c * c - (base + sign * a) ** 2) / (2.0 * b * c) for sign in (-1.0, 1.0)]
        yield DeadCenterFourBar(a, b, c, base, float(np.arccos(max(map(abs, cosines)))))
        if height == 0.0:
            return


def _is_crank(a: float, b: float, c: float, d: float) -> bool:
    """Whether the shortest link is the crank, which can turn fully."""
    lengths = sorted((a, b, c, d))
    return a == lengths[0] and lengths[0] + lengths[3] < lengths[1] + lengths[2]
