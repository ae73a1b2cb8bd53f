"""What a drive or a joint does over time: its speed, its effort, and what follows from them.

Efforts and loads of a prescribed motion follow by inverse dynamics. The inertia of a load is the effort of its drive
for each unit of acceleration: for a mechanism of one degree of freedom, twice the kinetic energy at unit speed.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics
from mbd_sim.base.errors import InputError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record
from mbd_sim.dynamics.equations import derive
from mbd_sim.mechanism.contents import require_two_sided
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion
from mbd_sim.studies.sizing.laws import MotionLaw
from mbd_sim.studies.sizing.samples import SampleTimes

CLOSE = 1e-11  # difference of places in a range that are the same

_ARRAYS = ("time", "position", "speed", "acceleration", "effort", "inertia")


@record
class LoadCycle:
    """The motion (n,) of a coordinate, and the effort that drives it: a cycle that repeats itself, or a single run.

    `speed` and `acceleration` are in rad/s or m/s and so on, `effort` is in N·m or N, `position` in rad or m.
    `rotation` says which. A time may be given twice, where the effort jumps. `inertia` (n,) in kg·m² or kg is that of
    the load at the coordinate, nan where it is unknown. Efforts contain no motor: neither rotor nor friction.
    """

    name: str
    rotation: bool
    time: Array
    position: Array
    speed: Array
    acceleration: Array
    effort: Array
    inertia: Array
    cyclic: bool = True

    @classmethod
    def of_arrays(
        cls,
        time: Sequence[float] | Array,
        speed: Sequence[float] | Array,
        effort: Sequence[float] | Array,
        *,
        name: str = "load",
        rotation: bool = True,
        position: Sequence[float] | Array | None = None,
        acceleration: Sequence[float] | Array | None = None,
        inertia: float | Array = np.nan,
        cyclic: bool = True,
    ) -> LoadCycle:
        """A cycle from samples; without positions and accelerations, these follow from the speed.

        :raises InputError: the lengths differ, the times do not increase, or a number is not finite.
        """
        times, speeds, efforts = (np.array(one, dtype=float) for one in (time, speed, effort))
        if not len(times) == len(speeds) == len(efforts):
            lengths = f"{len(times)}, {len(speeds)} and {len(efforts)}"
            raise InputError(f"time, speed and effort of '{name}' have {lengths} values", "Give one of each per time.")
        samples = SampleTimes(times, cyclic)
        places = samples.cumulative(speeds) if position is None else np.array(position, dtype=float)
        rates = samples.derivative(speeds) if acceleration is None else np.array(acceleration, dtype=float)
        for values in (speeds, efforts, places, rates):
            if len(values) != len(times) or not np.all(np.isfinite(values)):
                raise InputError(f"the load of '{name}' has gaps", "Give a finite number for each time.")
        inertias = np.broadcast_to(np.asarray(inertia, dtype=float), times.shape)
        return cls(name, rotation, times, places, speeds, rates, efforts, inertias, cyclic)

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def samples(self) -> SampleTimes:
        """The times, for integrals and so on."""
        return SampleTimes(self.time, self.cyclic)

    @property
    def duration(self) -> float:
        """In s."""
        return self.samples.duration

    @property
    def unit(self) -> str:
        """That of the effort."""
        return "N·m" if self.rotation else "N"

    @property
    def power(self) -> Array:
        """(n,) in W."""
        return self.speed * self.effort

    @property
    def peak(self) -> float:
        """The largest effort in magnitude, of the samples."""
        return float(np.max(np.abs(self.effort)))

    @property
    def rms(self) -> float:
        """The root of the mean square of the effort."""
        return self.samples.rms(self.effort)

    @property
    def top_speed(self) -> float:
        """The largest speed in magnitude."""
        return float(np.max(np.abs(self.speed)))

    @property
    def mean_inertia(self) -> float:
        """That of the load, mean over time; nan if it is unknown."""
        return float("nan") if np.any(np.isnan(self.inertia)) else self.samples.mean(self.inertia)

    @property
    def work(self) -> tuple[float, float]:
        """The work in J that the effort does in a cycle, and the work that flows back from the load, not negative."""
        return self.samples.positive_part(self.power), self.samples.positive_part(-self.power)

    def with_effort(self, effort: Array) -> LoadCycle:
        """The same motion with another effort."""
        return replace(self, effort=effort)

    @cached_property
    def split(self) -> LoadCycle:
        """The same cycle with the times twice at which the speed or the effort changes its sign: losses jump there."""
        samples = self.samples
        places: dict[tuple[int, float], str] = {}
        for name in ("effort", "speed"):
            places |= dict.fromkeys(samples.sign_changes(getattr(self, name)), name)
        order = sorted(places)
        arrays: dict[str, Any] = {name: samples.with_times_twice(order, getattr(self, name)) for name in _ARRAYS}
        added = 0
        for (row, s), name in ((place, places[place]) for place in order):
            first = row + added + (1 if s else 0)
            arrays[name][first : first + 2] = 0.0  # which may be round-off
            added += 2 if s else 1
        return replace(self, **arrays)

    def between(self, start: float, stop: float) -> LoadCycle:
        """The samples from `start` to `stop`, in s.

        :raises InputError: there are less than two.
        """
        step = 1e-9 * self.duration
        kept = np.flatnonzero((self.time >= start - step) & (self.time <= stop + step))
        if len(kept) < 2:
            whole = f"{self.time[0]:g} to {self.time[-1]:g} s"
            raise InputError(
                f"there is no load of '{self.name}' from {start:g} to {stop:g} s", f"It lasts from {whole}."
            )
        return replace(self, **{name: getattr(self, name)[kept] for name in _ARRAYS})


@interruptible()
def drive_cycles(motion: DrivenMotion, law: MotionLaw | None = None) -> dict[str, LoadCycle]:
    """The loads of all drives of a prescribed motion, by their names.

    :param motion: the configurations, at the `law.places`.
    :param law: how it is passed; by default at the constant speed of the motion.
    :raises MechanismError: the mechanism has no equations of motion, because a part has no mass, or it has one-sided
        elements.
    :raises InputError: the motion has dead points or change points, or no speed, or other places than the law.
    """
    if motion.singular:
        raise InputError("at dead points and change points no effort is defined", "Choose a range without them.")
    if law is None:
        if not motion.speed:
            raise InputError("a motion without speed is not a cycle", "Give a speed, or a law of motion.")
        rates = np.full(len(motion), motion.speed / abs(_travel(motion)[motion.leading]))
        law = MotionLaw(motion.time, motion.s, rates, np.zeros(len(motion)))
    rows = np.searchsorted(motion.s, law.s - 0.5 * CLOSE).clip(max=len(motion) - 1)
    if np.max(np.abs(motion.s[rows] - law.s)) > CLOSE:
        raise InputError("the motion and its law have other places", "Give driven_motion the places of the law.")
    require_two_sided(motion.mechanism, "has no loads that follow from its motion")
    efforts, inertias = _loads(motion, law, rows)
    travel = _travel(motion)
    cycles = {}
    for number, name in enumerate(motion.system.drives):
        if travel[number]:
            cycles[name] = LoadCycle(
                name,
                motion.is_rotation(name),
                law.time,
                motion.drives[rows, number],
                travel[number] * law.rate,
                travel[number] * law.acceleration,
                efforts[:, number],
                inertias[:, number] / travel[number],
            )
    return cycles


def _loads(motion: DrivenMotion, law: MotionLaw, rows: NDArray[np.intp]) -> tuple[Array, Array]:
    """The efforts (n, drives), and those for each unit of the acceleration of s, by virtual power along each drive."""
    system = motion.system
    equations = derive(motion.mechanism)
    inverse, inputs = InverseDynamics(motion.mechanism, system.drives, equations), equations.inputs_without_commands
    lead = abs(_travel(motion)[motion.leading])  # of the first moving drive, for a unit of s
    units = np.eye(len(system.drives))
    known: dict[int, tuple[Array, Array, Array]] = {}
    efforts, inertias = np.zeros((len(law), len(units))), np.zeros((len(law), len(units)))
    for index, row in enumerate(rows.tolist()):
        q = motion.q[row]
        if row not in known:
            found = motion.unit_rates(q)
            along = [system.rates(q, unit, np.zeros(len(units))) for unit in units]
            assert found is not None
            known[row] = found[0] * lead, found[1] * lead**2, np.array([one[0] for one in along if one is not None])
        ratios, bias, directions = known[row]
        u, time = ratios * law.rate[index], float(law.time[index])
        u_rates = bias * law.rate[index] ** 2 + ratios * law.acceleration[index]
        needed = inverse.of_tree(q, u, u_rates, time, inputs)
        efforts[index] = directions @ needed
        inertias[index] = directions @ (inverse.of_tree(q, u, u_rates + ratios, time, inputs) - needed)
    return efforts, inertias


def _travel(motion: DrivenMotion) -> Array:
    return np.asarray(motion.line.stop - motion.line.start, dtype=float)


_WORDS = {
    "time": ("time",),
    "speed": ("speed", "velocity"),
    "effort": ("effort", "torque", "force"),
    "position": ("position", "angle"),
    "acceleration": ("acceleration",),
}
_UNITS = {"time": "s", "speed": "rad_s", "effort": "Nm", "position": "rad", "acceleration": "rad_s2"}
_LINEAR = {"speed": "m_s", "effort": "N", "position": "m", "acceleration": "m_s2"}


def read_cycle(path: str | Path, name: str = "") -> LoadCycle:
    """Read a table, .csv, with a row for each time.

    Its columns are `time`, `speed` or `velocity`, and `effort`, `torque` or `force`, perhaps `position` and
    `acceleration`, in SI units. They may have the endings of `mbd_sim export`, such as `time_s` and
    `crank.velocity_rad_s`; then `name` is that of the coordinate.

    :raises InputError: a column is missing, or a value is not a number.
    """
    path = Path(path)
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    header = [cell.strip() for cell in rows[0]] if rows else []
    columns, rotation = _columns(path, header, name)
    values: dict[str, list[float]] = {quantity: [] for quantity in columns}
    for line, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        for quantity, index in columns.items():
            try:
                values[quantity].append(float(row[index]))
            except (ValueError, IndexError):
                cell = row[index] if index < len(row) else ""
                raise InputError(
                    f"{path}:{line}: {header[index]}: '{cell}' is not a number", "Correct the row."
                ) from None
    if not values["time"]:
        raise InputError(f"{path}: has no rows", "Give one for each time.")
    given: dict[str, Any] = {key: np.array(values[key]) for key in ("position", "acceleration") if key in values}
    return LoadCycle.of_arrays(
        values["time"], values["speed"], values["effort"], name=name or path.stem, rotation=rotation, **given
    )


def _columns(path: Path, header: Sequence[str], name: str) -> tuple[Mapping[str, int], bool]:
    """The index of each quantity that there is, and whether it is that of a rotation."""
    found, rotation = dict[str, int](), True
    for quantity, words in _WORDS.items():
        for word in words:
            prefix = f"{name}." if name and quantity != "time" else ""
            names = {word: word != "force", f"{prefix}{word}": True, f"{prefix}{word}_{_UNITS[quantity]}": True}
            names |= {f"{prefix}{word}_{_LINEAR[quantity]}": False} if quantity in _LINEAR else {}
            for column, turns in names.items():
                if column in header and quantity not in found:
                    found[quantity] = header.index(column)
                    rotation = rotation and turns
    if missing := [quantity for quantity in ("time", "speed", "effort") if quantity not in found]:
        of = f" of '{name}'" if name else ""
        remedy = f"Its columns are {listed(list(header))}." if header else "It is empty."
        joints = dict.fromkeys(one.partition(".")[0] for one in header if ".velocity" in one)
        remedy += f" Name one of {listed(list(joints))}." if joints and name not in joints else ""
        raise InputError(f"{path}: there is no column {listed(missing)}{of}", remedy)
    return found, rotation
