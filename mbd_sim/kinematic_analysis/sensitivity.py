"""How positions, velocities, accelerations and efforts of a motion change with parameters of the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion
from mbd_sim.kinematic_analysis.parametric_motion import ParametricMotion, Quantity, StateDerivatives, States
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.short_repr import short_repr


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives by the parameters, for each row of a motion: (n, ..., np); nan at dead points and change points."""

    position: Array
    velocity: Array
    acceleration: Array

    __repr__ = short_repr


class MotionSensitivity:
    """The exact derivatives of a motion by parameters, at the same drives. `keys` (np,) are those of the file."""

    __repr__ = short_repr

    def __init__(
        self, mechanism: Mechanism, motion: DrivenMotion, keys: Sequence[str], *, with_forces: bool = False
    ) -> None:
        """Differentiate.

        :param mechanism: that of the motion, as it was loaded.
        :param with_forces: also what `efforts` needs.
        :raises MechanismError: a key does not exist, or cannot be a parameter: see `ParametricMotion`.
        """
        self.motion = motion
        self.parametric = ParametricMotion(mechanism, motion.system.drives, keys, with_forces=with_forces)
        self.keys, self.values = self.parametric.keys, self.parametric.values
        self._regular = np.flatnonzero(np.all(np.isfinite(motion.ratios), axis=1))
        rows = self._regular
        self._states = States(motion.q[rows], motion.u[rows], motion.u_rates[rows])
        self._derivatives: StateDerivatives = self.parametric.derivatives(self.values, self._states)

    @property
    def displacements(self) -> Array:
        """The displacements along the speeds for unit changes of the parameters: (n, nv, np)."""
        return self._in_rows(self._derivatives.q)

    def coordinate(self, name: str) -> Sensitivity:
        """Of a coordinate of the spanning tree: (n, np) each.

        :raises InputError: there is no such coordinate, or it is a component of a rotation in space.
        """
        slopes = self._slopes(self.parametric.coordinate(name))
        return Sensitivity(slopes[:, 0], slopes[:, 1], slopes[:, 2])

    def point(self, name: str) -> Sensitivity:
        """Of a point: (n, 3, np) each.

        :raises InputError: there is no such point.
        """
        slopes = self._slopes(self.parametric.point(name))
        return Sensitivity(slopes[:, :3], slopes[:, 3:6], slopes[:, 6:])

    def efforts(self) -> Array:
        """Of the efforts of the drives: (n, drives, np)."""
        return self._slopes(self.parametric.efforts)

    def _slopes(self, quantity: Quantity) -> Array:
        _, slopes = quantity(self._states, self._derivatives, self.values)
        return self._in_rows(slopes)

    def _in_rows(self, slopes: Array) -> Array:
        found = np.full((len(self.motion), *slopes.shape[1:]), np.nan)
        found[self._regular] = slopes
        return found
