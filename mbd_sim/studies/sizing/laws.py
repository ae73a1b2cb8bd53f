"""How a drive moves through its range over time.

Laws of motion from rest to rest are normalized: the way s from 0 to 1 over the time from 0 to 1 (VDI 2143; Norton,
*Cam Design and Manufacturing Handbook*, ch. 3). Trapezoidal ones have the same share of acceleration and deceleration.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.files.text.units import parse_value

_Law = Callable[[Array], tuple[Array, Array, Array]]
DIGITS = 12  # of the way s: places that differ less are the same
SHARE = 1.0 / 3.0  # of acceleration in a trapezoidal motion


@record
class MotionLaw:
    """The way `s` (n,) from 0 to 1 through the range, its rate and second derivative, at `time` in s.

    Where the acceleration jumps, a time is given twice, with the values before and after.
    """

    time: Array
    s: Array
    rate: Array
    acceleration: Array

    def __len__(self) -> int:
        return len(self.time)

    @property
    def places(self) -> Array:
        """The places s, each once and in order: the positions for `driven_motion`."""
        return np.unique(np.round(self.s, DIGITS))

    def then(self, other: MotionLaw) -> MotionLaw:
        """This motion, and another one after it."""
        return MotionLaw(
            np.concatenate([self.time, self.time[-1] + other.time - other.time[0]]),
            *(
                np.concatenate([one, two])
                for one, two in ((self.s, other.s), (self.rate, other.rate), (self.acceleration, other.acceleration))
            ),
        )

    def back(self) -> MotionLaw:
        """The motion in the opposite direction, in the same time."""
        return MotionLaw(self.time, 1.0 - self.s, -self.rate, -self.acceleration)


def constant_speed(duration: float, positions: int) -> MotionLaw:
    """Through the range at constant speed, again and again."""
    time = np.linspace(0.0, duration, positions)
    return MotionLaw(time, np.linspace(0.0, 1.0, positions), np.full(positions, 1.0 / duration), np.zeros(positions))


def motion_law(
    kind: str, duration: float, positions: int, *, share: float = SHARE, dwell: float = 0.0, returns: bool = False
) -> MotionLaw:
    """A motion from rest to rest through the range.

    :param kind: a name of `LAWS`.
    :param duration: of one way, in s.
    :param positions: of one way.
    :param share: of the time for acceleration, and for deceleration, of a trapezoidal motion: up to 1/2, a triangle.
    :param dwell: the rest in s after each way.
    :param returns: whether the drive goes back, by the same law.
    :raises InputError: there is no such law, or a number is not possible.
    """
    if kind not in LAWS:
        raise InputError(f"there is no law of motion '{kind}'", nearest(kind, LAWS))
    if not (0.0 < duration < np.inf and 0.0 <= dwell < np.inf and 0.0 < share <= 0.5 and positions >= 5):
        message = f"a motion in {duration:g} s with a rest of {dwell:g} s, {positions} positions, a share of {share:g}"
        raise InputError(f"{message} is not possible", "Give a time above 0, 5 positions, a share up to 0.5.")
    law = _trapezoid(duration, positions, share) if kind == "trapezoid" else _smooth(LAWS[kind], duration, positions)
    ways = [law, law.back()] if returns else [law]
    whole: MotionLaw | None = None
    for way in ways:
        whole = way if whole is None else whole.then(way)
        if dwell:
            end = np.full(3, whole.s[-1])
            whole = whole.then(MotionLaw(np.linspace(0.0, dwell, 3), end, np.zeros(3), np.zeros(3)))
    assert whole is not None
    return whole


def _smooth(law: _Law, duration: float, positions: int) -> MotionLaw:
    x = np.linspace(0.0, 1.0, positions)
    s, rate, acceleration = law(x)
    return MotionLaw(duration * x, s, rate / duration, acceleration / duration**2)


def _trapezoid(duration: float, positions: int, share: float) -> MotionLaw:
    """Constant acceleration, constant speed, constant deceleration."""
    speed = 1.0 / (1.0 - share)
    rate = speed / share
    parts: list[tuple[Array, Array, Array, Array]] = []
    each = max(positions // 3, 4)
    for start, stop, a in ((0.0, share, rate), (share, 1.0 - share, 0.0), (1.0 - share, 1.0, -rate)):
        if stop > start:
            x = np.linspace(start, stop, each)
            left = 1.0 - x
            match np.sign(a):
                case 1.0:
                    s, v = 0.5 * rate * x**2, rate * x
                case -1.0:
                    s, v = 1.0 - 0.5 * rate * left**2, rate * left
                case _:
                    s, v = speed * (x - 0.5 * share), np.full(each, speed)
            parts.append((duration * x, s, v / duration, np.full(each, a / duration**2)))
    return MotionLaw(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _harmonic(x: Array) -> tuple[Array, Array, Array]:
    """Simple harmonic motion: a half period of a cosine."""
    return 0.5 - 0.5 * np.cos(np.pi * x), 0.5 * np.pi * np.sin(np.pi * x), 0.5 * np.pi**2 * np.cos(np.pi * x)


def _cycloid(x: Array) -> tuple[Array, Array, Array]:
    """The acceleration is a period of a sine."""
    turn = 2.0 * np.pi * x
    return x - np.sin(turn) / (2.0 * np.pi), 1.0 - np.cos(turn), 2.0 * np.pi * np.sin(turn)


def _polynomial(x: Array) -> tuple[Array, Array, Array]:
    """The 3-4-5 polynomial."""
    return (
        x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
        30.0 * x**2 * (1.0 - x) ** 2,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x),
    )


LAWS: dict[str, _Law] = {
    "trapezoid": _harmonic,  # which is made of parts instead, see `motion_law`
    "harmonic": _harmonic,
    "cycloid": _cycloid,
    "polynomial": _polynomial,
}


def law_of_text(text: str) -> tuple[str, float]:
    """Read `KIND:TIME`, such as `trapezoid:0.5s`.

    :raises InputError: it has another form.
    """
    found = re.fullmatch(r"(\w+):(.+)", text)
    if found is None:
        raise InputError(f"'{text}' is not a law of motion", "Write KIND:TIME, such as trapezoid:0.5s.")
    if found[1] not in LAWS:
        raise InputError(f"there is no law of motion '{found[1]}'", nearest(found[1], LAWS))
    return found[1], parse_value(found[2], {}, "s")
