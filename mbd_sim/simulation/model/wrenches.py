"""External forces and couples on parts, as commands that are checked as a whole, and as messages.

An `applied_wrenches` message has the labels and numbers of a wrench in the layout of the equations' inputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mbd_sim.base.errors import CommandError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from mbd_sim.dynamics.layouts.inputs import InputLayout


AXES = ("ground", "part")


def require_parts(names: Sequence[str], mechanism: Mechanism) -> None:
    """Refuse parts that do not exist.

    :raises CommandError: with the nearest name.
    """
    for name in names:
        if name not in mechanism.parts:
            raise CommandError(f"there is no part '{name}'", nearest(name, mechanism.parts))


class WrenchMap:
    """Wrenches on the loaded parts of a mechanism, as inputs of its equations."""

    __repr__ = short_repr

    def __init__(self, mechanism: Mechanism, layout: InputLayout) -> None:
        self._parts, self._layout = mechanism.parts, layout

    @property
    def slices(self) -> Mapping[str, slice]:
        """The slice of the inputs that holds the wrench on each loaded part."""
        return self._layout.wrenches

    def numbers(
        self,
        part: str,
        force: Sequence[float] | Array,
        couple: Sequence[float] | Array,
        at: str | Sequence[float] | Array | None,
        axes: str,
    ) -> Array:
        """The inputs (15,) of a wrench on a part, see `ExternalWrench`; for the arguments see `Simulation.set_wrench`.

        :raises CommandError: the part takes no wrench, a point or axes do not exist, or a vector is not three finite
            numbers.
        """
        if part not in self.slices:
            raise self._unknown(part)
        if axes not in AXES:
            raise CommandError(f"the axes of a wrench are 'ground' or 'part', not {axes!r}")
        wrench = np.concatenate([_vector(force, "force"), _vector(couple, "couple")])
        in_ground, in_part = (wrench, np.zeros(6)) if axes == "ground" else (np.zeros(6), wrench)
        return np.concatenate([in_ground, in_part, self._point(part, at)])

    def _point(self, part: str, at: str | Sequence[float] | Array | None) -> Array:
        record = self._parts[part]
        if at is None:
            return record.center
        if not isinstance(at, str):
            return _vector(at, "point")
        if at not in record.points:
            raise CommandError(f"part '{part}' has no point '{at}'", nearest(at, record.points))
        return record.points[at].position

    def _unknown(self, part: str) -> CommandError:
        if part in self._parts:
            remedy = f"Build the simulation with wrenches=['{part}']."
            return CommandError(f"part '{part}' does not accept wrenches", remedy)
        return CommandError(f"there is no part '{part}'", nearest(part, self.slices))


def _vector(values: Sequence[float] | Array, name: str) -> Array:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise CommandError(f"the {name} is not three numbers ({error})") from error
    if array.shape != (3,):
        raise CommandError(f"the {name} has the shape {array.shape}", "Give three numbers.")
    if not np.all(np.isfinite(array)):
        raise CommandError(f"the {name} contains a number that is not finite", "Give finite numbers.")
    return array


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
