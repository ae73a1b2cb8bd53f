"""Springs that balance a load: with the least RMS effort, or the least peak, left for the drive.

A linear spring of the length l exerts -k (l - l0) dl/dx along the coordinate x. The effort that is left,
F + k (l - l0) dl/dx, is linear in k and k l0: the least RMS follows from linear equations, the least peak from a linear
program.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion, PointFunctions
from mbd_sim.studies.sizing.cycle import CLOSE, LoadCycle
from mbd_sim.studies.sizing.laws import MotionLaw

Aim = Literal["rms", "peak"]


@record
class BalancingSpring:
    """A spring: `stiffness` k in N·m/rad or N/m, and `rest` l0 in rad or m, at which it exerts nothing.

    `load` is the cycle of the drive with the spring, `spring` (n,) its effort along the coordinate.
    """

    stiffness: float
    rest: float
    spring: Array
    load: LoadCycle


def balancing_spring(
    load: LoadCycle,
    aim: Aim = "rms",
    *,
    length: Array | None = None,
    rate: Array | None = None,
    rest: float | None = None,
) -> BalancingSpring:
    """The best spring for a load.

    :param aim: what is to be least: the "rms" or the "peak" of the effort that is left.
    :param length: (n,) of the spring in m or rad, and its `rate` (n,) dl/dx; by default the spring is at the coordinate
        itself. See `spring_between`.
    :param rest: where the spring exerts nothing, if it is given: 0 between points is a spring of zero free length.
    :raises InputError: the aim is unknown; no spring helps; or the coordinate does not return in a cycle.
    :raises MissingPackageError: the least peak needs SciPy, which is not installed.
    """
    if aim not in ("rms", "peak"):
        raise InputError(f"a spring of least '{aim}' is unknown", "Write rms or peak.")
    moved = abs(load.position[-1] - load.position[0])
    if length is None and load.cyclic and moved > 1e-9 * np.ptp(load.position):
        message = f"'{load.name}' does not return to its start, so that a spring would be wound up in each cycle"
        raise InputError(message, "Take a motion there and back, or a spring between two points.")
    place = load.position if length is None else np.asarray(length, dtype=float)
    slope = np.ones(len(load)) if rate is None else np.asarray(rate, dtype=float)
    between = length is not None
    columns = [place * slope, -slope] if rest is None else [(place - rest) * slope]
    size = np.array([float(np.max(np.abs(column))) or 1.0 for column in columns])
    matrix = np.stack(columns, axis=1) / size  # of k and k l0, in natural units
    # Lengths between points cannot be negative at rest; that of a coordinate may have any sign.
    signs = (True, between)[: len(columns)]
    found = (_least_rms(load, matrix, signs) if aim == "rms" else _least_peak(load, matrix, signs)) / size
    if found[0] <= 0.0:
        raise InputError(f"no spring makes the {aim} effort of '{load.name}' smaller", "Place it elsewhere.")
    at_rest = rest if rest is not None else float(found[1] / found[0])
    effort = -found[0] * (place - at_rest) * slope
    return BalancingSpring(float(found[0]), at_rest, effort, load.with_effort(load.effort - effort))


def _least_rms(load: LoadCycle, matrix: Array, signs: tuple[bool, ...]) -> Array:
    """The factors of the columns, those of `signs` not negative, with which F + matrix @ factors has the least RMS."""
    samples, count = load.samples, matrix.shape[1]
    square = np.array([[samples.mean(matrix[:, i] * matrix[:, j]) for j in range(count)] for i in range(count)])
    linear = np.array([samples.mean(matrix[:, i] * load.effort) for i in range(count)])
    best, least = np.zeros(count), 0.0
    for kept in ([*range(count)], *([one] for one in range(count) if count > 1)):
        found = np.zeros(count)
        found[kept] = np.linalg.lstsq(square[np.ix_(kept, kept)], -linear[kept], rcond=None)[0]
        value = float(found @ square @ found + 2.0 * linear @ found)
        if all(x >= 0.0 for x, sign in zip(found, signs, strict=True) if sign) and value < least:
            best, least = found, value
    return best


def _least_peak(load: LoadCycle, matrix: Array, signs: tuple[bool, ...]) -> Array:
    """The same for the least largest magnitude, by a linear program."""
    require_packages("scipy", purpose="The spring of least peak", otherwise="or look for the least RMS effort.")
    from scipy.optimize import linprog

    scale = load.peak or 1.0
    ones = np.ones((len(load), 1))
    above = np.hstack([matrix, -ones])
    below = np.hstack([-matrix, -ones])
    bounds = [*((0.0 if sign else None, None) for sign in signs), (0.0, None)]
    limits = np.concatenate([-load.effort, load.effort]) / scale
    found = linprog([*[0.0] * matrix.shape[1], 1.0], A_ub=np.vstack([above, below]), b_ub=limits, bounds=bounds)
    if not found.success:
        raise InputError(f"no spring of least peak was found for '{load.name}': {found.message}", "Choose least RMS.")
    return np.asarray(found.x[:-1]) * scale


def spring_between(
    motion: DrivenMotion, drive: str, first: str, second: str, law: MotionLaw | None = None
) -> tuple[Array, Array]:
    """The length (n,) in m of a spring between two points, and its rate dl/dx by a drive.

    :param first: a point `part.point`, a part, or `ground.point`.
    :param law: that of the cycle, with which the rows are those of the cycle.
    :raises InputError: there is no such point or drive.
    """
    if drive not in motion.system.drives:
        raise InputError(f"'{drive}' is not a drive of this motion", "Name one of its drives.")
    one, other = (PointFunctions(motion.system, GROUND if name == GROUND else name) for name in (first, second))
    index = motion.index(drive)
    lengths, rates = [], []
    for q, ratios in zip(motion.q, motion.ratios, strict=True):
        line = other.pose(q).position - one.pose(q).position
        length = float(np.linalg.norm(line))
        speed = (other.jacobian(q)[:3] - one.jacobian(q)[:3]) @ ratios
        lengths.append(length)
        rates.append(float(line @ speed) / length / float(ratios[index]) if length else 0.0)
    rows = np.arange(len(motion)) if law is None else np.searchsorted(motion.s, law.s - 0.5 * CLOSE)
    rows = rows.clip(max=len(motion) - 1)
    return np.array(lengths)[rows], np.array(rates)[rows]
