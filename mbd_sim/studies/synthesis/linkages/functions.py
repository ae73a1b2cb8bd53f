"""Four-bars whose follower turns as a function of the driver: exact at three, four or five positions, or least squares.

With crank a, coupler b, follower c and base d = 1, the angles θ of the crank and φ of the follower satisfy

    K1 cos φ - K2 cos θ + K3 = cos(θ - φ),  K1 = 1/a, K2 = 1/c, K3 = (a² - b² + c² + 1)/(2 a c)   (Freudenstein 1955).

Three pairs of angles determine the lengths. With four pairs the zero of φ is free as well, for which a quadratic
remains. With five pairs both zeros are free: the coupler joins points of crank and follower that keep their distance in
five relative poses, so that Burmester's pairs give all solutions; the pair of the fixed pivots is one of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.studies.synthesis.linkages.dyads import Complexes, Displacements, dyads_of_five
from mbd_sim.studies.synthesis.linkages.four_bars import POSITIONS

SAME = 1e-6
EXACT = 1e-7  # rad
LONGEST = 1e3  # ratio of lengths


@record
class FunctionFourBar:
    """A four-bar on a base of 1 m: `crank`, `coupler`, `follower` in m.

    `theta` and `phi` (n,) are the absolute angles in rad of crank and follower at the wanted positions, measured from
    the base; `deviations` (n,) are those of the follower in rad in the branch `mode` (1 or -1) of the first position.
    `defects` says why the crank does not pass through the positions; `transmission` is the least angle in rad between
    them.
    """

    crank: float
    coupler: float
    follower: float
    theta: Array
    phi: Array
    mode: float
    deviations: Array
    defects: str
    transmission: float

    @property
    def rank(self) -> tuple[int, float]:
        """By which they are sorted."""
        return (1 if self.defects else 0, -self.transmission)


def chebyshev_positions(start: float, stop: float, count: int) -> Array:
    """Precision positions of a range with Chebyshev's spacing."""
    places = np.cos(np.pi * (2.0 * np.arange(count, 0, -1) - 1.0) / (2.0 * count))
    return np.asarray(0.5 * (start + stop) + 0.5 * (stop - start) * places)


def function_four_bars(theta: Sequence[float], phi: Sequence[float]) -> list[FunctionFourBar]:
    """All four-bars whose follower is at angles phi where the crank is at angles theta, in rad, sorted.

    With three pairs both are absolute. With four, the zero of phi is free, and with five or more both zeros. With more
    than five, the deviations of the follower are least squares.

    :raises InputError: there are less than three pairs, or not as many of both.
    """
    given = np.asarray(theta, dtype=float), np.asarray(phi, dtype=float)
    if given[0].shape != given[1].shape or given[0].ndim != 1 or len(given[0]) < 3:
        raise InputError(
            f"{len(given[0])} angles of the crank and {len(given[1])} of the follower do not make a function",
            "Give as many of both, at least three.",
        )
    match len(given[0]):
        case 3:
            found = _of_three(*given)
        case 4:
            found = _of_four(*given)
        case 5:
            found = _of_five(*given)
        case _:
            return _least_squares(*given)
    return sorted(found, key=lambda one: one.rank)


def _coefficients(theta: Array, phi: Array) -> Array:
    return np.column_stack([np.cos(phi), -np.cos(theta), np.ones(len(theta))])


def _of_three(theta: Array, phi: Array) -> list[FunctionFourBar]:
    matrix = _coefficients(theta, phi)
    if abs(np.linalg.det(matrix)) < 1e-14:
        return []
    return _from_constants(np.asarray(np.linalg.solve(matrix, np.cos(theta - phi)), dtype=float), theta, phi)


def _of_four(theta: Array, phi: Array) -> list[FunctionFourBar]:
    """The determinant of the four equations is a quadratic form in the cosine and sine of the zero of φ."""

    def determinant(first: float, last: float) -> float:  # the zeros in the first and in the last column
        columns = [np.cos(phi + first), -np.cos(theta), np.ones(4), np.cos(theta - phi - last)]
        return float(np.linalg.det(np.column_stack(columns)))

    quarter = 0.5 * np.pi
    form = [determinant(quarter, quarter), determinant(0.0, quarter) + determinant(quarter, 0.0), determinant(0.0, 0.0)]
    found = []
    for root in np.roots(form):  # the tangent of the zero
        if abs(root.imag) < SAME * max(1.0, abs(root)):
            zero = float(np.arctan(root.real))
            matrix = _coefficients(theta, phi + zero)
            constants = np.linalg.lstsq(matrix, np.cos(theta - phi - zero), rcond=None)[0]
            found += _from_constants(np.asarray(constants, dtype=float), theta, phi + zero)
    return found


def _from_constants(constants: Array, theta: Array, phi: Array) -> list[FunctionFourBar]:
    """The four-bar of K1, K2, K3; a negative length is a link that points the other way."""
    if np.min(np.abs(constants[:2])) < 1.0 / LONGEST:
        return []
    a, c = 1.0 / constants[0], 1.0 / constants[1]
    square = a * a + c * c + 1.0 - 2.0 * a * c * constants[2]
    if square <= 0.0:
        return []
    return [_four_bar(a * np.exp(1j * theta), c * np.exp(1j * phi), float(np.sqrt(square)))]


def _of_five(theta: Array, phi: Array) -> list[FunctionFourBar]:
    """The follower as seen from the crank, in five poses."""
    turns = np.exp(1j * (phi - phi[0] - theta + theta[0]))
    shifts = np.exp(-1j * (theta - theta[0])) - turns  # of the follower's pivot at 1, in the crank's axes
    motion = Displacements(turns, shifts)
    found = []
    for dyad in dyads_of_five(motion):
        trivial = abs(dyad.center) + abs(dyad.point - 1.0) < SAME
        if dyad.kind != "RR" or trivial or abs(dyad.center) < SAME or abs(dyad.point - 1.0) < SAME:
            continue
        crank = dyad.center * np.exp(1j * (theta - theta[0]))
        follower = (dyad.point - 1.0) * np.exp(1j * (phi - phi[0]))
        if max(abs(crank[0]), abs(follower[0])) < LONGEST:
            found.append(_four_bar(crank, follower, dyad.length))
    return found


def _four_bar(crank: Complexes, follower: Complexes, coupler: float) -> FunctionFourBar:
    """The four-bar with these pins (n,) of crank and follower, as seen from their pivots."""
    a, c = float(abs(crank[0])), float(abs(follower[0]))
    angles, wanted = np.unwrap(np.angle(crank)), np.unwrap(np.angle(follower))
    signs = np.sign(np.imag(np.conj(1.0 + follower - crank) * follower))
    mode = float(signs[0]) or 1.0
    found = follower_angles(angles, a, coupler, c, mode)
    deviations = np.angle(np.exp(1j * (found - wanted)))
    path = np.linspace(angles[0], angles[-1], POSITIONS)
    reached = follower_angles(path, a, coupler, c, mode)
    if np.any(signs != mode):
        groups = [" ".join(str(k + 1) for k in np.flatnonzero(signs == one)) for one in (mode, -mode)]
        defects = f"branch: positions {' and '.join(groups)}"
    elif not np.all(np.isfinite(reached)):
        defects = "a dead point between the positions"
    else:
        defects = ""
    places = angles if defects else path
    far = 1.0 + c * np.exp(1j * follower_angles(places, a, coupler, c, mode))
    ratio = (far - a * np.exp(1j * places)) / (far - 1.0)
    least = np.arctan2(np.abs(ratio.imag), np.abs(ratio.real))
    transmission = float(np.min(np.where(np.isfinite(least), least, 0.0)))
    return FunctionFourBar(a, coupler, c, angles, wanted, mode, deviations, defects, transmission)


def follower_angles(theta: Array, a: float, b: float, c: float, mode: float) -> Array:
    """The angles (n,) of the follower; nan where the linkage cannot be assembled."""
    across = 1.0 - a * np.exp(1j * theta)
    reach = np.abs(across)
    with np.errstate(invalid="ignore"):
        angle = np.arccos((c * c + reach**2 - b * b) / (2.0 * c * reach))
    return np.asarray(np.angle(-across) - mode * angle)


def _least_squares(theta: Array, phi: Array) -> list[FunctionFourBar]:
    """The best four-bars that the search finds from the exact ones at five of the positions."""
    from scipy.optimize import least_squares

    found: list[FunctionFourBar] = []
    for places in _fives(len(theta)):
        for start in _of_five(theta[places], phi[places]):
            zeros = start.theta[0] - theta[places[0]], start.phi[0] - phi[places[0]]

            def deviations(x: Array, mode: float = start.mode) -> Array:
                angles = follower_angles(theta + x[3], x[0], x[1], x[2], mode)
                apart = np.angle(np.exp(1j * (angles - phi - x[4])))
                return np.asarray(np.where(np.isfinite(apart), apart, 10.0))

            first = np.array([start.crank, start.coupler, start.follower, *zeros])
            if np.max(np.abs(deviations(first))) >= 1.0:
                continue
            x = least_squares(deviations, first, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
            if np.min(x[:3]) <= 0.0:
                continue
            one = _four_bar(x[0] * np.exp(1j * (theta + x[3])), x[2] * np.exp(1j * (phi + x[4])), x[1])
            if one.defects == "" and not any(abs(one.crank - other.crank) < SAME for other in found):
                found.append(one)
    return sorted(found, key=lambda one: float(np.sum(one.deviations**2)))


def _fives(count: int) -> list[Array]:
    """Some choices of five positions of many, spread over them."""
    spread = np.unique(np.round(chebyshev_positions(0.0, count - 1.0, 5)).astype(int))
    even = np.unique(np.round(np.linspace(0.0, count - 1.0, 5)).astype(int))
    return [one for one in (spread, even) if len(one) == 5]
