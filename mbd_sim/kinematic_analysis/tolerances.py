"""How tolerances of lengths add up in a motion: worst case, root sum of squares, and random samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from mbd_sim.errors import InputError, MbdSimError, counted
from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion
from mbd_sim.kinematic_analysis.sensitivity import MotionSensitivity
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.short_repr import short_repr

Distribution = Literal["normal", "uniform"]
DEVIATIONS = 3.0  # standard deviations in a tolerance, for normal distributions


@dataclass(frozen=True, eq=False)
class Deviation:
    """The deviation of a quantity from its nominal value, in each row of a motion: (n,) or (n, 3).

    `worst_case` is Σ |S| t, and `root_sum_square` √Σ (S t)², with sensitivities S and tolerances t: to first order. Of
    random samples, computed without linearization: `mean`, standard deviation `deviation`, `least` and `greatest`; nan
    without samples.
    """

    worst_case: Array
    root_sum_square: Array
    mean: Array
    deviation: Array
    least: Array
    greatest: Array

    __repr__ = short_repr


class ToleranceAnalysis:
    """The effect of tolerances ±t on a motion, at the same drives."""

    __repr__ = short_repr

    def __init__(
        self,
        mechanism: Mechanism,
        motion: DrivenMotion,
        tolerances: Mapping[str, float],
        *,
        samples: int = 0,
        seed: int = 0,
        distribution: Distribution = "normal",
    ) -> None:
        """Determine the sensitivities, and assemble the mechanism with random lengths.

        :param mechanism: that of the motion, as it was loaded.
        :param tolerances: half the width t of the tolerance of each key of the file, in SI units.
        :param samples: of random lengths, independent of each other, the same for the same `seed`.
        :param distribution: "normal", with three standard deviations in t, or "uniform" between -t and t.
        :raises InputError: a tolerance is not positive, or there is none.
        :raises MechanismError: a key does not exist, or cannot be a parameter.
        :raises MbdSimError: the mechanism cannot be assembled with lengths within the tolerances.
        """
        if not tolerances or not all(np.isfinite(value) and value > 0.0 for value in tolerances.values()):
            raise InputError("tolerances must be positive numbers", "Give at least one, such as 0.1e-3 for 0.1 mm.")
        if distribution not in get_args(Distribution):
            raise InputError(
                f"there is no distribution {distribution!r}", f"Valid: {', '.join(get_args(Distribution))}."
            )
        if samples < 0 or samples == 1:
            message = f"{counted(samples, 'sample')} cannot have a standard deviation"
            raise InputError(message, "Give 0, or at least 2.")
        self.tolerances = np.array(list(tolerances.values()), dtype=float)
        self.sensitivity = MotionSensitivity(mechanism, motion, list(tolerances))
        self.motion = motion
        random = np.random.default_rng(seed)
        shape = (samples, len(self.tolerances))
        drawn = random.normal(size=shape) / DEVIATIONS if distribution == "normal" else random.uniform(-1.0, 1.0, shape)
        self.samples = drawn * self.tolerances
        self._configurations = [self._assembled(change) for change in self.samples]

    def coordinate(self, name: str) -> Deviation:
        """Of a coordinate in rad or m: (n,)."""
        index = self.motion.index(name)
        column = self.motion.columns[index]
        found = [q[:, column] - self.motion.q[:, column] for q in self._configurations]
        return self._deviation(self.sensitivity.coordinate(name).position, found)

    def point(self, name: str) -> Deviation:
        """Of the position of a point in m: (n, 3)."""
        nominal, place = self.motion.point(name).position, self.sensitivity.parametric.place(name)
        found = [
            np.array([place(row, self.sensitivity.values + change) for row in q]) - nominal
            for change, q in zip(self.samples, self._configurations, strict=True)
        ]
        return self._deviation(self.sensitivity.point(name).position, found)

    def _deviation(self, slopes: Array, found: Sequence[Array]) -> Deviation:
        effects = slopes * self.tolerances
        worst, likely = np.sum(np.abs(effects), axis=-1), np.sqrt(np.sum(effects**2, axis=-1))
        if not found:
            return Deviation(worst, likely, *np.full((4, *worst.shape), np.nan))
        every = np.array(found)
        spread = np.std(every, axis=0, ddof=1)
        return Deviation(worst, likely, every.mean(axis=0), spread, every.min(axis=0), every.max(axis=0))

    def _assembled(self, change: Array) -> Array:
        """The configurations (n, nq) with changed lengths, from those of the linear theory."""
        parametric, motion = self.sensitivity.parametric, self.motion
        values = self.sensitivity.values + change
        system = parametric.at(values)
        rows = []
        for nominal, drives, moved in zip(motion.q, motion.drives, self.sensitivity.displacements, strict=True):
            step = moved @ change
            guess = system.displaced(nominal, np.where(np.isfinite(step), step, 0.0))
            q = system.closed_at(guess, drives)
            if q is None and np.all(np.isfinite(step)):
                raise MbdSimError(
                    f"{motion.mechanism.name}: the mechanism cannot be assembled at {drives.tolist()} with lengths "
                    "within the tolerances. Give a range farther from dead points, or smaller tolerances."
                )
            rows.append(np.full_like(nominal, np.nan) if q is None else q)
        return np.array(rows)
