"""Columns of a prescribed motion that are chosen by name, and limits of their magnitudes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

import numpy as np

from mbd_sim.errors import InputError, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion
from mbd_sim.kinematic_analysis.reach import shown
from mbd_sim.mechanism.names import split_assignment


def chosen_columns(columns: Mapping[str, Array], patterns: Sequence[str]) -> dict[str, Array]:
    """The columns whose names match patterns, such as `reaction.*.force_N`, in the order of the patterns.

    :raises InputError: none matches a pattern; a similar one is suggested.
    """
    found: dict[str, Array] = {}
    for pattern in patterns:
        names = [name for name in columns if fnmatchcase(name, pattern)]
        if not names:
            remedy = nearest(pattern, list(columns)) or "Write a name or a pattern such as 'reaction.*.force_N'."
            raise InputError(f"no column is called '{pattern}'", remedy)
        found |= {name: columns[name] for name in names}
    return found


def column_limit(text: str) -> tuple[str, float]:
    """The name or pattern, and the limit of the magnitude, of `NAME=VALUE`.

    :raises InputError: the text cannot be read, or the limit is not a positive number.
    """
    name, value = split_assignment(text)
    try:
        limit = float(value)
    except ValueError:
        limit = 0.0
    if not name or not 0.0 < limit < np.inf:
        message = f"'{text}' gives no limit"
        raise InputError(
            message, "Write the name of a column and a positive number in its unit: reaction.pin.force_N=500."
        )
    return name, limit


def exceeded_limits(
    motion: DrivenMotion, columns: Mapping[str, Array], limits: Sequence[tuple[str, float]]
) -> tuple[list[str], bool]:
    """A line for each column with a limit, and whether one is exceeded; numbers that are undefined do not count.

    :raises InputError: there is no such column.
    """
    lines, exceeded = [], False
    for pattern, limit in limits:
        for name, values in chosen_columns(columns, [pattern]).items():
            sizes = np.abs(np.nan_to_num(values, nan=0.0))
            row, beyond = int(np.argmax(sizes)), int(np.sum(sizes > limit))
            place = shown(motion.mechanism, motion.drive_name, float(motion.drive[row]))
            verdict = f"exceeded in {beyond} of {len(motion)} positions" if beyond else "kept"
            largest = f"at most {limit:.6g}, {verdict}: {values[row]:.6g} at {motion.drive_name} = {place}"
            lines.append(f"{'Limit':<20}{name}: {largest}")
            exceeded = exceeded or beyond > 0
    return lines, exceeded
