"""Columns of a run at equally spaced times, each by an interpolation that fits it.

| columns | between two states |
|---|---|
| positions that have velocities | cubic Hermite: through both positions with both velocities |
| quaternions of poses | linear, then of unit length, on the shorter way |
| measurements of sensors, and steps | held: the last one before |
| all others | linear; where a topic has no value at a state, from its neighbors that have one |

Nothing is extrapolated: before the first value of a column and after its last one it is empty.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from mbd_sim.base.errors import InputError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.views.table import RunTable, columns

HERMITE, UNIT, HELD, LINEAR = "cubic", "linear, unit length", "held", "linear"
_POSITION = re.compile(r"(.*)\.position(_rad|_m)?")
_QUATERNION = re.compile(r"(.*)(\.q|_q)[xyzw]")


def resampled(table: RunTable, rate: float) -> tuple[dict[str, Array | np.ndarray], dict[str, str]]:
    """The columns at `rate` in Hz, from the first state on, and how each is interpolated.

    :raises InputError: the run has one state, or was reset, so that its times repeat.
    """
    given = columns(table)
    times = table.times
    if len(times) < 2 or times[-1] <= times[0]:
        raise InputError("a run of one state cannot be resampled", "Export it without --rate.")
    if np.any(np.diff(times) <= 0.0):
        repeated = [f"{times[row]:g}" for row in np.flatnonzero(np.diff(times) <= 0.0) + 1]
        message = f"the times of the run do not increase at {listed(repeated)} s, as after a reset"
        raise InputError(message, "Export it without --rate.")
    count = int(np.floor((times[-1] - times[0]) * rate * (1.0 + 1e-12) + 1e-9)) + 1
    wanted = times[0] + np.arange(count) / rate
    wanted = np.minimum(wanted, times[-1])
    found: dict[str, Array | np.ndarray] = {"time_s": wanted}
    ways = {name: _way(name, given) for name in given if name != "time_s"}
    for name, way in ways.items():
        values = np.asarray(given[name])
        if way == HELD:
            found[name] = values[np.searchsorted(times, wanted, side="right") - 1]
        elif way == HERMITE:
            found[name] = _hermite(times, values, np.asarray(given[_velocity_of(name, given)]), wanted)
        else:
            found[name] = _linear(times, values, wanted)
    _make_unit(found, [name for name, way in ways.items() if way == UNIT], given, times, wanted)
    return found, ways


def interpolation_table(ways: Mapping[str, str]) -> dict[str, list[object]]:
    """The interpolations and the columns that have them, as a table."""
    kinds = dict.fromkeys(ways.values())
    names = {kind: [name for name, way in ways.items() if way == kind] for kind in kinds}
    return {"interpolation": list(kinds), "columns": [listed(names[kind], 6) for kind in kinds]}


def _way(name: str, given: Mapping[str, object]) -> str:
    if name == "step" or name.startswith("sensor."):
        return HELD
    if _velocity_of(name, given):
        return HERMITE
    return UNIT if name.startswith("pose.") and _QUATERNION.fullmatch(name) else LINEAR


def _velocity_of(name: str, given: Mapping[str, object]) -> str:
    """The column of the velocity of a position, or ""."""
    matched = _POSITION.fullmatch(name)
    if matched is None:
        return ""
    velocity = f"{matched[1]}.velocity{matched[2] or ''}{'_s' if matched[2] else ''}"
    return velocity if velocity in given else ""


def _linear(times: Array, values: Array, wanted: Array) -> Array:
    known = np.isfinite(values)
    if not np.any(known):
        return np.full(len(wanted), np.nan)
    return np.asarray(np.interp(wanted, times[known], values[known], left=np.nan, right=np.nan))


def _hermite(times: Array, positions: Array, velocities: Array, wanted: Array) -> Array:
    """The cubic with the positions and velocities at both ends."""
    row = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(times) - 2)
    step = times[row + 1] - times[row]
    s = (wanted - times[row]) / step
    p, q, v, w = positions[row], positions[row + 1], step * velocities[row], step * velocities[row + 1]
    found = p + s * (v + s * (3.0 * (q - p) - 2.0 * v - w + s * (2.0 * (p - q) + v + w)))
    found = np.where(s <= 0.0, p, np.where(s >= 1.0, q, found))  # also beside states without a value
    return np.asarray(found)


def _make_unit(
    found: dict[str, Array | np.ndarray],
    names: list[str],
    given: Mapping[str, Array | np.ndarray],
    times: Array,
    wanted: Array,
) -> None:
    """Interpolate quaternions on the shorter way, and scale them to unit length."""
    for prefix in dict.fromkeys(name[:-1] for name in names):
        members = [f"{prefix}{letter}" for letter in "xyzw" if f"{prefix}{letter}" in given]
        quaternions = np.stack([np.asarray(given[name]) for name in members], axis=1)
        known = np.all(np.isfinite(quaternions), axis=1)
        if np.count_nonzero(known) < 2:
            continue
        kept = quaternions[known]
        signs = np.cumprod(np.append(1.0, np.where(np.sum(kept[1:] * kept[:-1], axis=1) < 0.0, -1.0, 1.0)))
        kept = kept * signs[:, None]
        mixed = np.stack([np.interp(wanted, times[known], kept[:, i], np.nan, np.nan) for i in range(4)], axis=1)
        mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
        for index, name in enumerate(members):
            found[name] = mixed[:, index]
