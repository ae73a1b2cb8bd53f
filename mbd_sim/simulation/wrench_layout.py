"""The labels and numbers of an `applied_wrenches` message: a wrench in the layout of the equations' inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.geometry.pose import Array

VECTORS = ("force", "couple", "own_force", "own_couple", "point")  # in the order of `ExternalWrench`


@dataclass(frozen=True, slots=True)
class PublishedWrench:
    """A force (3,) in N and a couple (3,) in N·m on a part, in the arguments of `Simulation.set_wrench`.

    `point` (3,) is in m in the part's frame; `axes` is "ground", or "part" for axes that turn with the part.
    """

    part: str
    force: Array
    couple: Array
    point: Array
    axes: str


def wrench_labels(part: str) -> tuple[str, ...]:
    """Return the labels of the numbers (15,) of a wrench on a part."""
    return tuple(f"{part}.{vector}.{axis}" for vector in VECTORS for axis in "xyz")


def parse_wrench(labels: Sequence[str], numbers: Array) -> PublishedWrench:
    """Return the wrench with these labels and numbers (15,).

    :raises ValueError: there are not 15 numbers.
    """
    part = labels[0].rsplit(".", 2)[0] if labels else ""
    force, couple, own_force, own_couple, point = numbers.reshape(len(VECTORS), 3)
    if np.any(own_force) or np.any(own_couple):
        return PublishedWrench(part, own_force, own_couple, point, "part")
    return PublishedWrench(part, force, couple, point, "ground")
