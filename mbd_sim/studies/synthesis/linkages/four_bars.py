"""Linkages of two dyads that carry a body: how they move when one dyad is driven, and the defects of this motion.

The driver turns a link ("RR") or moves a slider ("PR"); its value u is the angle of the link in rad or the
displacement of the slider in m from the first pose. For each u the body has at most two positions, which differ in a
sign. Where they exist is a condition on the cosine of the link's angle, or on the square of the displacement, so that
intervals are known exactly. Two signs over one interval meet at dead points: they are branches of one circuit. Over a
full turn they are circuits of their own, between which the linkage would have to be taken apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.studies.synthesis.linkages.dyads import Complexes, Displacements, Dyad

POSITIONS = 181  # of the driver, at which transmission angles are determined
ROUND_OFF = 1e-9


@record
class PoseLinkage:
    """Two dyads that lead a body through poses; the first one is driven.

    `defects` says in words why the body does not pass through the poses in their order; "" if it does. `transmission`
    is the least transmission angle in rad between the first and the last pose, of the poses alone where there is a
    defect. `drives` (n,) are the values of the driver at the poses.
    """

    motion: Displacements
    driver: Dyad
    follower: Dyad
    kind: str
    defects: str
    transmission: float
    drives: Array

    @property
    def size(self) -> float:
        """The largest distance of two of its four points in the first pose, in m."""
        points = [self.driver.center, self.driver.point, self.follower.center, self.follower.point]
        return max(abs(one - other) for one in points for other in points)

    @property
    def rank(self) -> tuple[int, float]:
        """By which linkages are sorted: those without defects first, then by the transmission angle."""
        return (1 if self.defects else 0, -self.transmission)


@dataclass(frozen=True)
class _Interval:
    """Values of the cosine of the driver's angle, or of the square of its displacement, between which a body exists."""

    lower: float
    upper: float


class DrivenLinkage:
    """The motion of a body on two dyads, the first of them driven."""

    def __init__(self, motion: Displacements, driver: Dyad, follower: Dyad) -> None:
        self.motion, self.driver, self.follower = motion, driver, follower
        self._arm = driver.point - driver.center
        self._other = follower.point - driver.point  # in the body, as it is in the first pose

    @cached_property
    def drives(self) -> Array:
        """The values u (n,) at the poses; angles unwrapped from pose to pose."""
        points = self.motion.of(self.driver.point)
        if self.driver.kind == "PR":
            return np.asarray(np.real((points - self.driver.point) / self.driver.direction))
        return np.unwrap(np.angle(points - self.driver.center))

    def points(self, u: Array) -> Complexes:
        """The driven point of the body (n,)."""
        if self.driver.kind == "PR":
            return np.asarray(self.driver.point + u * self.driver.direction)
        return np.asarray(self.driver.center + self.driver.length * np.exp(1j * u))

    @cached_property
    def signs(self) -> Array:
        """The sign (n,) of the body's position at each pose."""
        near = self.motion.of(self.driver.point)
        match self.follower.kind:
            case "RR":
                far = self.motion.of(self.follower.point)
                values = np.imag(np.conj(far - near) * (far - self.follower.center))
            case "PR":
                values = np.real((self.motion.of(self.follower.point) - near) / self.follower.direction)
            case _:
                values = np.real((self.follower.center - near) / (self.motion.turns * self.follower.direction))
        return np.sign(values)

    def turns(self, u: Array, sign: float) -> Complexes:
        """The unit numbers (n,) of the turn of the body from the first pose; nan where it cannot be assembled."""
        near = self.points(u)
        with np.errstate(invalid="ignore", divide="ignore"):
            match self.follower.kind:
                case "RR":
                    across, b, c = self.follower.center - near, abs(self._other), self.follower.length
                    reach = np.abs(across)
                    cosine = (b * b + reach**2 - c * c) / (2.0 * b * reach)
                    return np.asarray(across / reach * np.exp(1j * sign * np.arccos(cosine)) * b / self._other)
                case "PR":
                    along, b = self.follower.direction, abs(self._other)
                    height = np.imag((self.follower.point - near) / along) / b
                    return np.asarray((sign * np.sqrt(1.0 - height**2) + 1j * height) * along * b / self._other)
                case _:
                    across = (self.follower.center - near) / self.follower.direction
                    offset = np.imag((self.follower.point - self.driver.point) / self.follower.direction)
                    slid = sign * np.sqrt(np.abs(across) ** 2 - offset**2)
                    return np.asarray(across / (slid + 1j * offset))

    def transmission(self, u: Array, sign: float) -> Array:
        """The transmission angles (n,) in rad; 0 where the linkage cannot be assembled."""
        near, turns = self.points(u), self.turns(u, sign)
        match self.follower.kind:
            case "RR":
                far = near + turns * self._other
                ratio = (far - near) / (far - self.follower.center)
            case "PR":
                ratio = 1j * turns * self._other / self.follower.direction
            case _:
                ratio = turns * self.follower.direction / (1j * (near - self.follower.center))
        with np.errstate(invalid="ignore"):
            found = np.arctan2(np.abs(ratio.imag), np.abs(ratio.real))
        return np.where(np.isfinite(found), found, 0.0)

    @cached_property
    def _interval(self) -> _Interval:
        """Of cos(u - middle), of (u - middle)², or of the plain u where both dyads are sliders."""
        driver, follower = self.driver, self.follower
        b, offset = abs(self._other), 0.0
        if follower.kind == "RP":
            offset = float(np.imag((follower.point - driver.point) / follower.direction))
        low, high = (abs(offset), np.inf) if follower.kind == "RP" else (abs(b - follower.length), b + follower.length)
        if driver.kind == "RR":
            a = driver.length
            if follower.kind == "PR":
                start = float(np.imag((driver.center - follower.point) / follower.direction))
                return _Interval((-b - start) / a, (b - start) / a)
            d = abs(follower.center - driver.center)
            if d == 0.0:
                return _Interval(-np.inf, np.inf)
            return _Interval((a * a + d * d - high**2) / (2 * a * d), (a * a + d * d - low**2) / (2 * a * d))
        if follower.kind == "PR":
            return _Interval(
                -1.0, 1.0
            )  # one stretch, between the places where the coupler is normal to the other guide
        height = float(np.imag((follower.center - driver.point) / driver.direction))
        return _Interval(low**2 - height**2, high**2 - height**2)

    @cached_property
    def _middle(self) -> float:
        driver, follower = self.driver, self.follower
        if driver.kind == "RR":
            if follower.kind == "PR":
                return float(np.angle(1j * follower.direction))
            return float(np.angle(follower.center - driver.center)) if follower.center != driver.center else 0.0
        return float(np.real((follower.center - driver.point) / driver.direction))

    @property
    def turns_fully(self) -> bool:
        """Whether the driver can make a full turn, or go along its whole line."""
        if self.driver.kind == "RR":
            return self._interval.lower <= -1.0 + ROUND_OFF and self._interval.upper >= 1.0 - ROUND_OFF
        return self._interval.lower <= 0.0 and self._interval.upper == np.inf

    @cached_property
    def pieces(self) -> Array:
        """Of which connected interval of the driver each pose (n,) is: 0, or -1 and 1 where there are two."""
        if self.driver.kind == "RR":
            two = self._interval.lower > -1.0 and self._interval.upper < 1.0
            return np.sign(np.sin(self.drives - self._middle)) if two else np.zeros(len(self.drives))
        two = self._interval.lower > 0.0
        return np.sign(self.drives - self._middle) if two else np.zeros(len(self.drives))

    def defects(self) -> str:
        """Why the body does not pass through the poses in their order; "" if it does."""
        if self.driver.kind == self.follower.kind == "PR" and self._lines_meet_nowhere():
            return "the guides are parallel"
        signs, pieces = self.signs, self.pieces
        if self.turns_fully and np.any(signs != signs[0]):
            return f"circuit: poses {_groups(signs)}"
        if np.any(pieces != pieces[0]):
            return f"circuit: poses {_groups(pieces)}"
        if np.any(signs != signs[0]):
            return f"branch: a dead point between poses {_groups(signs)}"
        return "" if self._in_order() else f"order: the driver reaches the poses as {self._order()}"

    def _lines_meet_nowhere(self) -> bool:
        return abs(np.imag(self.driver.direction / self.follower.direction)) < ROUND_OFF

    def _unwrapped(self) -> Array:
        """The drives at the poses, without a jump within their interval, or in the turning direction that suits."""
        u = self.drives
        if self.driver.kind == "PR":
            return u
        if not self.turns_fully:
            around = self._middle + (np.pi if self._interval.upper < 1.0 and self._interval.lower <= -1.0 else 0.0)
            if self._interval.upper < 1.0 and self._interval.lower > -1.0:
                around = self._middle + 0.5 * np.pi * float(self.pieces[0])
            return np.asarray(around + np.angle(np.exp(1j * (u - around))))
        forward = np.mod(u - u[0], 2.0 * np.pi)
        backward = -np.mod(u[0] - u, 2.0 * np.pi)
        goes_back = np.all(np.diff(backward) < 0.0) and not np.all(np.diff(forward) > 0.0)
        return np.asarray(u[0] + (backward if goes_back else forward))

    def _in_order(self) -> bool:
        steps = np.diff(self._unwrapped())
        return bool(np.all(steps > 0.0) or np.all(steps < 0.0))

    def _order(self) -> str:
        return " ".join(str(index + 1) for index in np.argsort(self._unwrapped(), kind="stable"))

    def kind(self) -> str:
        """What the linkage is called, the driver first."""
        if self.driver.kind == self.follower.kind == "RR":
            return self._four_bar_kind()
        names = {"RR": "crank" if self.turns_fully else "rocker", "PR": "slider", "RP": "swinging block"}
        other = {"RR": "rocker", "PR": "slider", "RP": "swinging block"}[self.follower.kind]
        return "double slider" if self.driver.kind == self.follower.kind else f"{names[self.driver.kind]}-{other}"

    def _four_bar_kind(self) -> str:
        ground, a = abs(self.follower.center - self.driver.center), self.driver.length
        lengths = {"ground": ground, "driver": a, "coupler": abs(self._other), "follower": self.follower.length}
        ordered = sorted(lengths.values())
        if ordered[0] + ordered[3] > ordered[1] + ordered[2]:
            return "triple rocker"
        shortest = min(lengths, key=lambda name: lengths[name])
        names = {"ground": "double crank", "driver": "crank-rocker", "coupler": "double rocker"}
        return names.get(shortest, "rocker-crank")

    def result(self) -> PoseLinkage:
        """The linkage with its defects and its least transmission angle."""
        defects, u = self.defects(), self._unwrapped()
        if defects:
            angles = np.array([self.transmission(u[k : k + 1], sign)[0] for k, sign in enumerate(self.signs)])
        else:
            path = np.linspace(u[0], u[-1], POSITIONS)
            angles = self.transmission(np.concatenate([path, u]), float(self.signs[0]))
        least = float(np.min(angles))
        return PoseLinkage(self.motion, self.driver, self.follower, self.kind(), defects, least, u)


def best_linkage(motion: Displacements, one: Dyad, other: Dyad) -> PoseLinkage | None:
    """The linkage of two dyads, driven by the one that suits better; None if they make none.

    A swinging block is not driven. Two dyads with a common point of the body, or a common center, make no linkage.
    """
    near = 1e-6 * motion.size
    if abs(one.point - other.point) < near or (abs(one.center - other.center) < near):
        return None
    pairs = [(one, other), (other, one)]
    found = [DrivenLinkage(motion, *pair).result() for pair in pairs if pair[0].kind != "RP"]
    return min(found, key=lambda linkage: linkage.rank, default=None)


def _groups(values: Array) -> str:
    """The numbers of the poses with the same values, such as "1 2 and 3"."""
    groups = [" ".join(str(k + 1) for k in np.flatnonzero(values == one)) for one in dict.fromkeys(values.tolist())]
    return " and ".join(groups)
