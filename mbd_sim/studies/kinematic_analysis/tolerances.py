"""How tolerances of lengths add up in a motion: worst case, root sum of squares, and random samples.

Sensitivities and tolerances are given as columns of a table and as lines of a report.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, get_args

import numpy as np

from mbd_sim.base.errors import InputError, counted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion
from mbd_sim.studies.kinematic_analysis.parametric import MotionSensitivity
from mbd_sim.studies.kinematic_analysis.system import is_rotation
from mbd_sim.studies.kinematic_analysis.text import drive_at, grounded_outputs, row

Distribution = Literal["normal", "uniform"]
DEVIATIONS = 3.0  # standard deviations in a tolerance, for normal distributions


@record
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
                raise InputError(
                    f"{motion.mechanism.name}: the mechanism cannot be assembled at {drives.tolist()} with lengths "
                    "within the tolerances",
                    "Give a range farther from dead points, or smaller tolerances.",
                )
            rows.append(np.full_like(nominal, np.nan) if q is None else q)
        return np.array(rows)


def sensitivity_columns(sensitivity: MotionSensitivity, points: Sequence[str]) -> dict[str, Array]:
    """The derivatives (n,) of positions by each parameter, such as `rocker.position_rad.by_l`, in SI units."""
    found = {}
    for name in _coordinates(sensitivity.motion):
        slopes = sensitivity.coordinate(name).position
        for index, key in enumerate(sensitivity.keys):
            found[f"{_column(sensitivity.motion, name)}.by_{key}"] = slopes[:, index]
    for name in points:
        slopes = sensitivity.point(name).position
        for index, key in enumerate(sensitivity.keys):
            found |= {f"{name}.{axis}_m.by_{key}": slopes[:, k, index] for k, axis in enumerate("xyz")}
    return found


def tolerance_columns(tolerances: ToleranceAnalysis, points: Sequence[str]) -> dict[str, Array]:
    """The deviations (n,) of positions, such as `rocker.position_rad.worst_case`; those of samples if there are any."""
    motion, found = tolerances.motion, dict[str, Array]()
    for name in _coordinates(motion):
        found |= _deviation_columns(_column(motion, name), tolerances, tolerances.coordinate(name), None)
    for name in points:
        deviation = tolerances.point(name)
        for index, axis in enumerate("xyz"):
            found |= _deviation_columns(f"{name}.{axis}_m", tolerances, deviation, index)
    return found


def sensitivity_lines(sensitivity: MotionSensitivity, points: Sequence[str]) -> Iterator[str]:
    """The largest derivatives of outputs and points by each parameter, with where they occur."""
    motion = sensitivity.motion
    for index, key in enumerate(sensitivity.keys):
        texts = []
        for name in grounded_outputs(motion):
            if name in motion.names:
                slopes = sensitivity.coordinate(name).position[:, index]
                texts.append(f"{name} {_peak(motion, slopes)}")
        for name in points:
            slopes = np.linalg.norm(sensitivity.point(name).position[:, :, index], axis=1)
            texts.append(f"{name} {_peak(motion, slopes)}")
        yield row("Sensitivity", f"by {key} (SI units): {'; '.join(texts)}")


def tolerance_lines(tolerances: ToleranceAnalysis, points: Sequence[str]) -> Iterator[str]:
    """The largest deviations of outputs and points."""
    motion = tolerances.motion
    for name in grounded_outputs(motion):
        if name in motion.names:
            unit = "rad" if is_rotation(motion.mechanism, name) else "m"
            yield from _deviation_lines(motion, name, tolerances.coordinate(name), unit)
    for name in points:
        deviation = tolerances.point(name)
        for index, axis in enumerate("xyz"):
            if np.nanmax(deviation.worst_case[:, index], initial=0.0) > 0.0:
                one = Deviation(*(getattr(deviation, key)[:, index] for key in Deviation.__dataclass_fields__))
                yield from _deviation_lines(motion, f"{name} {axis}", one, "m")


def _deviation_lines(motion: DrivenMotion, name: str, deviation: Deviation, unit: str) -> Iterator[str]:
    text = f"worst case ±{_peak(motion, deviation.worst_case)}, root sum of squares ±"
    text += f"{np.nanmax(deviation.root_sum_square):.4g} {unit}"
    if np.any(np.isfinite(deviation.deviation)):
        text += f", standard deviation of samples up to {np.nanmax(deviation.deviation):.4g} {unit}"
    yield row("Tolerances", f"{name}: {text}")


def _peak(motion: DrivenMotion, values: Array) -> str:
    if not np.any(np.isfinite(values)):
        return "undefined"
    index = int(np.nanargmax(np.abs(values)))
    return f"{values[index]:.4g} at {drive_at(motion, motion.drive[index])}"


def _deviation_columns(
    column: str, tolerances: ToleranceAnalysis, deviation: Deviation, index: int | None
) -> dict[str, Array]:
    names = ["worst_case", "root_sum_square"]
    if len(tolerances.samples):
        names += ["mean", "deviation", "least", "greatest"]
    values = {name: getattr(deviation, name) for name in names}
    return {f"{column}.{name}": one if index is None else one[:, index] for name, one in values.items()}


def _coordinates(motion: DrivenMotion) -> list[str]:
    return [name for name in motion.outputs if name in motion.names]


def _column(motion: DrivenMotion, name: str) -> str:
    return f"{name}.position_{'rad' if is_rotation(motion.mechanism, name) else 'm'}"
