"""External forces and couples on parts, as commanded: checked as a whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbd_sim.dynamics.input_layout import InputLayout
from mbd_sim.errors import CommandError, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism

AXES = ("ground", "part")


class WrenchMap:
    """Wrenches on the loaded parts of a mechanism, in the order in which the equations take them."""

    def __init__(self, mechanism: Mechanism, layout: InputLayout) -> None:
        self._parts, self._layout = mechanism.parts, layout

    @property
    def places(self) -> Mapping[str, slice]:
        """Where the wrench on each loaded part stands among the inputs."""
        return self._layout.wrenches

    def numbers(
        self,
        part: str,
        force: Sequence[float] | Array,
        couple: Sequence[float] | Array,
        at: str | Sequence[float] | Array | None,
        axes: str,
    ) -> Array:
        """The inputs of a wrench on a part; see `Simulation.set_wrench`.

        :raises CommandError: the part takes none, an unknown point or axes, or what is not three finite numbers.
        """
        if part not in self.places:
            raise CommandError(self._unknown(part))
        if axes not in AXES:
            raise CommandError(f"the axes of a wrench are 'ground' or 'part', not {axes!r}.")
        pair = np.concatenate([_three(force, "force"), _three(couple, "couple")])
        none = np.zeros(6)
        halves = (pair, none) if axes == "ground" else (none, pair)
        return np.concatenate([*halves, self._point(part, at)])

    def _point(self, part: str, at: str | Sequence[float] | Array | None) -> Array:
        record = self._parts[part]
        if at is None:
            return record.center
        if not isinstance(at, str):
            return _three(at, "point")
        if at not in record.points:
            raise CommandError(f"part '{part}' has no point '{at}'. {nearest(at, record.points)}")
        return record.points[at].position

    def _unknown(self, part: str) -> str:
        if part in self._parts:
            return f"part '{part}' takes no wrench. Build the simulation with wrenches=['{part}']."
        return f"there is no part '{part}'. {nearest(part, self.places)}"


def _three(values: Sequence[float] | Array, what: str) -> Array:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise CommandError(f"the {what} is not three numbers ({error}).") from error
    if array.shape != (3,):
        raise CommandError(f"the {what} has the shape {array.shape}. Give three numbers.")
    if not np.all(np.isfinite(array)):
        raise CommandError(f"the {what} holds a number that is not finite.")
    return array
