"""What the equations take from outside while they are integrated: efforts, wrenches on parts, and values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from mbd_sim.geometry.pose import Array

WRENCH = 15  # numbers of a wrench: see `ExternalWrench`


@dataclass(frozen=True, eq=False)
class ExternalWrench:
    """A force (3,) in N and a couple (3,) in N·m in ground's axes, then both in the part's own, which turn with it.

    Both forces act at the `point` (3,) of the part, in its frame. The inputs hold them in this order.
    """

    force: ca.SX
    couple: ca.SX
    own_force: ca.SX
    own_couple: ca.SX
    point: ca.SX


@dataclass(frozen=True)
class InputLayout:
    """Where each input stands: first the efforts (nv,), then `WRENCH` numbers for each loaded part, then values."""

    nv: int
    loaded: tuple[str, ...] = ()
    values: int = 0

    @property
    def efforts(self) -> slice:
        """Of the efforts."""
        return slice(0, self.nv)

    @cached_property
    def wrenches(self) -> Mapping[str, slice]:
        """Of the wrench on each loaded part."""
        starts = range(self.nv, self.nv + WRENCH * len(self.loaded), WRENCH)
        return {part: slice(start, start + WRENCH) for part, start in zip(self.loaded, starts, strict=True)}

    @property
    def of_values(self) -> slice:
        """Of the values."""
        return slice(self.size - self.values, self.size)

    @property
    def size(self) -> int:
        """How many there are."""
        return self.nv + WRENCH * len(self.loaded) + self.values

    def external(self, inputs: ca.SX) -> Mapping[str, ExternalWrench]:
        """The wrench on each loaded part."""
        return {part: ExternalWrench(*ca.vertsplit(inputs[place], 3)) for part, place in self.wrenches.items()}

    def at_rest(self, centers: Sequence[Array], values: Array) -> Array:
        """Inputs with which nothing is commanded; the points of the wrenches are the `centers` of mass."""
        inputs = np.zeros(self.size)
        for place, center in zip(self.wrenches.values(), centers, strict=True):
            inputs[place.stop - 3 : place.stop] = center
        inputs[self.of_values] = values
        return inputs
