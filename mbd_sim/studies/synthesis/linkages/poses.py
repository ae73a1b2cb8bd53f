"""Linkages that carry a body through three, four or five poses, sorted by their transmission angles.

Three poses leave both pivots free: each center, point of the body, direction of a guide, or direction of a line through
a swinging block gives one dyad. Where less than two are given, centers on a grid are tried. Four poses give curves of
dyads, which are sampled; five poses a finite number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from itertools import combinations

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.short_repr import record
from mbd_sim.studies.synthesis.linkages.dyads import (
    Displacements,
    Dyad,
    PlanePose,
    center_point,
    circle_point,
    displacements_of,
    dyads_of_five,
    dyads_of_four,
    passing_line,
    poles,
    straight_point,
)
from mbd_sim.studies.synthesis.linkages.four_bars import PoseLinkage, best_linkage

GRID = 7  # centers in each direction, for three poses
MOST_DYADS = 64  # of which linkages are made
REACH = 2.0  # sizes of the problem around the poses, in which pivots are searched by default
SHORTEST = 0.05  # length of a link, relative to the size, that is still searched
BOTH_GIVEN = 2


@record
class Region:
    """A rectangle in m in which fixed pivots may be."""

    left: float
    right: float
    bottom: float
    top: float

    def contains(self, point: complex) -> bool:
        """Whether a point lies in it."""
        return self.left <= point.real <= self.right and self.bottom <= point.imag <= self.top


@record
class Given:
    """What is chosen for three poses: fixed pivots, points of the body in its own axes, and directions in rad.

    `guides` are directions of fixed lines along which a point of the body moves; `lines` those of lines of the body, in
    its own axes, that pass through a fixed pivot.
    """

    centers: Sequence[complex] = ()
    points: Sequence[complex] = ()
    guides: Sequence[float] = ()
    lines: Sequence[float] = ()

    def __len__(self) -> int:
        return len(self.centers) + len(self.points) + len(self.guides) + len(self.lines)


@record
class PoseSolutions:
    """All `dyads` that were found, and `linkages` of two of them, sorted: without defects first, then by transmission.

    `poles` are those of the displacements, by the numbers of the poses from 1. `tried` is the number of pairs.
    """

    poses: Sequence[PlanePose]
    motion: Displacements
    dyads: Sequence[Dyad]
    linkages: Sequence[PoseLinkage]
    tried: int
    poles: Mapping[tuple[int, int], complex] = field(default_factory=dict)


def linkages_for_poses(
    poses: Sequence[PlanePose], given: Given | None = None, region: Region | None = None
) -> PoseSolutions:
    """Find the dyads that lead a body through poses, and the linkages of two of them.

    :param given: of three poses: what is chosen; two things give one linkage, and more give all pairs.
    :param region: in which fixed pivots must lie; of three and four poses, by default around the poses.
    :raises InputError: there are not three to five poses, or something is given that does not fit.
    """
    if not 3 <= len(poses) <= 5:
        raise InputError(
            f"{len(poses)} poses cannot be synthesized",
            "Give three, four or five; for more, let 'mbd_sim optimize' minimize the deviations of two points.",
        )
    motion = displacements_of(poses)
    given = given or Given()
    if len(given) and len(poses) != 3:
        raise InputError(
            f"with {len(poses)} poses, nothing can be chosen", "Give three poses, or leave out what was chosen."
        )
    wanted = region or (_around(poses, motion) if len(poses) < 5 else None)
    match len(poses):
        case 3:
            dyads = _of_three(poses, motion, given, _around(poses, motion) if region is None else region)
        case 4:
            dyads = dyads_of_four(motion)
        case _:
            dyads = dyads_of_five(motion)
    usable = dyads if len(given) >= BOTH_GIVEN else _usable(dyads, motion, wanted, given)
    pairs = list(combinations(usable, 2))
    found = [linkage for pair in pairs if (linkage := best_linkage(motion, *pair)) is not None]
    linkages = sorted(found, key=lambda linkage: linkage.rank)
    return PoseSolutions(tuple(poses), motion, tuple(dyads), tuple(linkages), len(pairs), poles(motion))


def _of_three(poses: Sequence[PlanePose], motion: Displacements, given: Given, region: Region) -> list[Dyad]:
    """The dyads of what is given; with less than two things, also those of centers on a grid.

    :raises InputError: something that is given has no dyad.
    """
    first = poses[0]
    tried: list[tuple[str, Dyad | None]] = [
        *((f"center {_text(one)}", circle_point(motion, one)) for one in given.centers),
        *((f"point {_text(one)}", center_point(motion, first.origin + first.turn * one)) for one in given.points),
        *((f"guide {np.degrees(one):.6g} deg", straight_point(motion, np.exp(1j * one))) for one in given.guides),
        *(
            (f"line {np.degrees(one):.6g} deg", passing_line(motion, first.turn * np.exp(1j * one)))
            for one in given.lines
        ),
    ]
    for name, dyad in tried:
        if dyad is None:
            raise InputError(f"{name}: there is no dyad for the three poses", "Choose another one.")
    dyads = [dyad for _, dyad in tried if dyad is not None]
    if len(dyads) < BOTH_GIVEN:
        for x in np.linspace(region.left, region.right, GRID):
            for y in np.linspace(region.bottom, region.top, GRID):
                dyad = circle_point(motion, complex(x, y))
                dyads += [] if dyad is None else [dyad]
    return dyads


def _usable(dyads: Sequence[Dyad], motion: Displacements, region: Region | None, given: Given) -> list[Dyad]:
    """Dyads of which linkages are made: in the region, of reasonable length, and not too many of them."""
    if region is None:
        return list(dyads)
    near, size = list(dyads[: len(given)]), motion.size
    far = REACH * (size + abs(complex(region.right - region.left, region.top - region.bottom)))
    for dyad in dyads[len(given) :]:
        long_enough = dyad.kind != "RR" or dyad.length > SHORTEST * size
        if region.contains(dyad.center) and long_enough and dyad.length < far:
            near.append(dyad)
    sliders = [dyad for dyad in near if dyad.kind != "RR"]
    links = [dyad for dyad in near if dyad.kind == "RR"]
    stride = max(1, int(np.ceil(len(links) / MOST_DYADS)))
    return [*links[::stride], *sliders]


def _around(poses: Sequence[PlanePose], motion: Displacements) -> Region:
    places = np.array([pose.origin for pose in poses])
    margin = REACH * float(max(np.ptp(places.real), np.ptp(places.imag))) or REACH * motion.size
    return Region(
        float(places.real.min() - margin),
        float(places.real.max() + margin),
        float(places.imag.min() - margin),
        float(places.imag.max() + margin),
    )


def _text(point: complex) -> str:
    return f"({point.real:.6g}, {point.imag:.6g})"
