"""Sensitivities and tolerances of a motion as columns of a table and as lines of a report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion
from mbd_sim.kinematic_analysis.motion_table import grounded_outputs
from mbd_sim.kinematic_analysis.prescribed_drives import is_rotation
from mbd_sim.kinematic_analysis.reach import shown
from mbd_sim.kinematic_analysis.sensitivity import MotionSensitivity
from mbd_sim.kinematic_analysis.tolerances import Deviation, ToleranceAnalysis

HEAD = 20  # width of the first column


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
            found |= {f"{name}.{axis}_m.by_{key}": slopes[:, row, index] for row, axis in enumerate("xyz")}
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
        yield f"{'Sensitivity':<{HEAD}}by {key} (SI units): {'; '.join(texts)}"


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
    yield f"{'Tolerances':<{HEAD}}{name}: {text}"


def _peak(motion: DrivenMotion, values: Array) -> str:
    if not np.any(np.isfinite(values)):
        return "undefined"
    row = int(np.nanargmax(np.abs(values)))
    place = shown(motion.mechanism, motion.drive_name, float(motion.drive[row]))
    return f"{values[row]:.4g} at {motion.drive_name} = {place}"


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
