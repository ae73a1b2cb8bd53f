"""Motors and gears as data, read from YAML or CSV files to which users add lines.

A YAML file has the sections `motors` and `gears`, whose entries have a name each. A CSV file has one of both, with the
column `name` and a column for each key; a curve is written as `0: 2 N*m; 3000 rpm: 1.5 N*m`. Values may have units.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, MechanismError, Problem, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import short_repr
from mbd_sim.files.text.library import read_text
from mbd_sim.files.text.units import parse_value, split_unit
from mbd_sim.files.text.yaml_text import parse_source
from mbd_sim.mechanism.values.source import Source

Curve = tuple[tuple[float, float], ...]
WARM = 25.0  # °C, at which resistances are given
COPPER = 0.00393  # 1/K, of the resistance of copper, relative to that at 20 °C
AMBIENT = 40.0  # °C


@dataclass(frozen=True)
class MotorType:
    """A motor of a catalog, in SI units and °C.

    `continuous_torque` and `peak_torque` in N·m are pairs of a speed in rad/s and the largest torque at it, linear
    between them and constant beyond; up to `max_speed`. If one was given as a single number, it also ends at the line
    of the `voltage`. Without `torque_constant` in N·m/A and `resistance` in Ω at 25 °C, currents, losses and
    temperatures are not known. `coulomb` in N·m and `viscous` in N·m·s are the friction of the rotor. The winding has
    the `thermal_resistance` in K/W to the surroundings, and warms up with the time constant `thermal_time` in s.
    """

    name: str
    rotor_inertia: float
    continuous_torque: Curve
    peak_torque: Curve
    max_speed: float
    torque_constant: float = math.nan
    resistance: float = math.nan
    inductance: float = 0.0
    voltage: float = math.inf
    coulomb: float = 0.0
    viscous: float = 0.0
    thermal_resistance: float = math.nan
    thermal_time: float = math.nan
    max_temperature: float = math.inf
    temperature_coefficient: float = COPPER
    mass: float = math.nan

    __repr__ = short_repr

    def __eq__(self, other: object) -> bool:
        """Whether all values are the same, unknown ones included: data classes of Python 3.13 tell NaN from itself."""
        return isinstance(other, MotorType) and vars(self) == vars(other)

    @property
    def is_electric(self) -> bool:
        """Whether its currents are known."""
        return not (math.isnan(self.torque_constant) or math.isnan(self.resistance))

    @property
    def resistance_slope(self) -> float:
        """The change in 1/K of the resistance, relative to that at 25 °C."""
        return self.temperature_coefficient / (1.0 + self.temperature_coefficient * (WARM - 20.0))

    def continuous(self, speed: Array) -> Array:
        """The largest torque (n,) in N·m that it can exert for ever at speeds (n,) in rad/s."""
        return self._limit(self.continuous_torque, speed)

    def peak(self, speed: Array) -> Array:
        """The largest torque (n,) in N·m at speeds (n,) in rad/s."""
        return self._limit(self.peak_torque, speed)

    def _limit(self, curve: Curve, speed: Array) -> Array:
        size = np.abs(speed)
        found = np.interp(size, [v for v, _ in curve], [torque for _, torque in curve])
        if len(curve) == 1 and self.is_electric and math.isfinite(self.voltage):
            left = self.voltage - self.torque_constant * size
            found = np.minimum(found, self.torque_constant * np.maximum(left, 0.0) / self.resistance)
        return np.where(size <= self.max_speed * (1.0 + 1e-12), found, 0.0)


@dataclass(frozen=True)
class GearType:
    """A gear, a belt or a screw. `ratio` is the speed of the rotor in rad/s for a load at 1 rad/s, or at 1 m/s.

    `inertia` in kg·m² is that at the rotor, `max_effort` in N·m or N the largest one of the load. `linear` says that
    the load moves along a line.
    """

    name: str
    ratio: float
    efficiency: float = 1.0
    inertia: float = 0.0
    max_effort: float = math.inf
    linear: bool = False

    __repr__ = short_repr


DIRECT = GearType("direct", 1.0)


@dataclass(frozen=True)
class Catalog:
    """Motors and gears by name."""

    motors: Mapping[str, MotorType]
    gears: Mapping[str, GearType]

    __repr__ = short_repr

    def __or__(self, other: Catalog) -> Catalog:
        """Both; of two entries with one name, that of the other."""
        return Catalog({**self.motors, **other.motors}, {**self.gears, **other.gears})

    def motor(self, name: str) -> MotorType:
        """:raises InputError: there is none of this name."""
        if name not in self.motors:
            raise InputError(f"there is no motor '{name}' in the catalog", nearest(name, self.motors))
        return self.motors[name]

    def gear(self, text: str, linear: bool) -> GearType:
        """A gear by its name, or by its ratio or lead: `12`, `lead=10mm`.

        :raises InputError: there is none of this name, or it does not fit the motion.
        """
        found = self.gears.get(text) or _gear_of_text(text)
        if found is None:
            known = [name for name, gear in self.gears.items() if gear.linear == linear]
            raise InputError(
                f"there is no gear '{text}' in the catalog",
                f"Write a ratio, lead=10mm, or a name. {nearest(text, known)}",
            )
        if found.linear != linear and found.name in self.gears:
            moves = "along a line" if linear else "about an axis"
            raise InputError(
                f"'{text}' does not fit a load that moves {moves}", "Choose a screw for motion along a line."
            )
        return replace(found, linear=linear)


def _gear_of_text(text: str) -> GearType | None:
    lead = text.startswith("lead=")
    try:
        value = parse_value(text.removeprefix("lead="), {}, "m" if lead else "")
    except InputError:
        if lead:
            raise
        return None
    if value <= 0.0:
        raise InputError(f"a gear of '{text}' is not possible", "Give a positive number.")
    return GearType(text, 2.0 * math.pi / value if lead else value, linear=lead)


@dataclass(frozen=True)
class _Key:
    """A key: its unit, whether it must be given, and the range of its values."""

    unit: str
    required: bool = False
    least: float = 0.0
    most: float = math.inf
    may_be_least: bool = False


_CURVES = ("continuous_torque", "peak_torque")
_MOTOR_KEYS = {
    "rotor_inertia": _Key("kg*m**2", required=True, may_be_least=True),
    "continuous_torque": _Key("N*m", required=True),
    "peak_torque": _Key("N*m", required=True),
    "max_speed": _Key("rad/s", required=True),
    "torque_constant": _Key("N*m/A"),
    "resistance": _Key("ohm"),
    "inductance": _Key("H", may_be_least=True),
    "voltage": _Key("V"),
    "coulomb": _Key("N*m", may_be_least=True),
    "viscous": _Key("N*m*s/rad", may_be_least=True),
    "thermal_resistance": _Key("K/W"),
    "thermal_time": _Key("s"),
    "max_temperature": _Key("degC", least=-273.15),
    "temperature_coefficient": _Key("1/K", may_be_least=True),
    "mass": _Key("kg"),
}
_GEAR_KEYS = {
    "ratio": _Key(""),
    "lead": _Key("m"),
    "efficiency": _Key("", most=1.0),
    "inertia": _Key("kg*m**2", may_be_least=True),
    "max_effort": _Key(""),
}
_THERMAL = ("K/W", "degC", "1/K")  # units of temperature, which mechanism files do not have


def read_catalog(path: str | Path) -> Catalog:
    """Read a catalog of motors and gears, .yaml or .csv.

    :raises MechanismError: with all problems of the file.
    :raises InputError: the file is of another kind.
    """
    path = Path(path)
    if path.suffix not in (".yaml", ".yml", ".csv"):
        raise InputError(f"{path} is not a catalog of motors", "Use a .yaml or .csv file.")
    text = read_text(path)
    return catalog_of(text if path.suffix != ".csv" else _yaml_of_csv(text, str(path)), str(path))


@cache
def shipped_catalog() -> Catalog:
    """The generic motors and gears."""
    text = files("mbd_sim.studies.sizing").joinpath("motors.yaml").read_text(encoding="utf-8")
    return catalog_of(text, "motors.yaml")


def catalog_of(text: str | Source, file: str = "<text>") -> Catalog:
    """The catalog of a YAML text.

    :raises MechanismError: with all problems of the text.
    """
    source = parse_source(text, file) if isinstance(text, str) else text
    problems = source.problems
    data = source.data if isinstance(source.data, dict) else {}
    if not data:
        problems.append(
            source.problem((), "has neither motors nor gears", "Write the sections 'motors:' and 'gears:'.")
        )
    sections = ("motors", "gears")
    for section in (key for key in data if key not in sections):
        problems.append(source.problem((section,), "is not a section of a catalog", nearest(section, sections)))
    found: dict[str, dict[str, Any]] = {}
    builders: dict[str, tuple[dict[str, _Key], Callable[..., Any]]] = {
        "motors": (_MOTOR_KEYS, MotorType),
        "gears": (_GEAR_KEYS, _gear),
    }
    for section, (keys, build) in builders.items():
        entries = data.get(section) or {}
        if not isinstance(entries, dict):
            problems.append(source.problem((section,), "must have names", "Write 'name: {…}' for each."))
            entries = {}
        found[section] = {}
        for name, entry in entries.items():
            before = len(problems)
            values = _values(source, (section, name), entry, keys)
            if len(problems) == before:
                found[section][name] = build(name, **values)
    if problems:
        raise MechanismError(sorted(problems, key=lambda one: one.line))
    return Catalog(found["motors"], found["gears"])


def _gear(name: str, ratio: float = math.nan, lead: float = math.nan, **values: float) -> GearType:
    screw = not math.isnan(lead)
    return GearType(name, 2.0 * math.pi / lead if screw else ratio, linear=screw, **values)


def _values(source: Source, at: tuple[str, str], entry: Any, keys: Mapping[str, _Key]) -> dict[str, Any]:
    """The values of an entry; what is wrong is added to the problems of the source."""
    problems = source.problems
    if not isinstance(entry, dict):
        problems.append(source.problem(at, "must have keys and values", f"Write {at[1]}: {{{next(iter(keys))}: …}}."))
        return {}
    found: dict[str, Any] = {}
    for key, value in entry.items():
        if key not in keys:
            problems.append(source.problem((*at, key), "is not a key of a catalog", nearest(key, keys)))
            continue
        try:
            found[key] = _curve(value, keys[key]) if key in _CURVES else _number(value, keys[key])
        except InputError as error:
            problems.append(source.problem((*at, key), error.message, error.remedy, value))
    for key, described in keys.items():
        if described.required and key not in entry:
            problems.append(source.problem(at, f"lacks '{key}'", f"Write {key}: with a value in {described.unit}."))
    if keys is _GEAR_KEYS and len(entry.keys() & {"ratio", "lead"}) != 1:
        problems.append(source.problem(at, "needs either a ratio or a lead", "Write ratio: 5, or lead: 10 mm."))
    return found


def _number(value: Any, key: _Key) -> float:
    if key.unit in _THERMAL:
        text = str(value).replace("°C", "degC").strip()
        number = parse_value(plain(text.removesuffix(key.unit).strip()), {}, "")
    elif not key.unit and isinstance(value, str) and split_unit(value)[1]:
        number = parse_value(value, {}, None)  # an effort in N or N·m
    else:
        number = parse_value(value, {}, key.unit)
    if number > key.most or number < key.least or (number == key.least and not key.may_be_least):
        limits = f"from {key.least:g}" if key.may_be_least else f"above {key.least:g}"
        raise InputError(f"must be {limits}" + (f" and up to {key.most:g}" if math.isfinite(key.most) else ""))
    return number


def plain(text: str) -> float | str:
    """A text as a number, where it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def _curve(value: Any, key: _Key) -> Curve:
    if isinstance(value, str) and ":" in value:
        value = [pair.split(":") for pair in value.split(";") if pair.strip()]
    if not isinstance(value, list):
        return ((0.0, _number(value, key)),)
    pairs = []
    for pair in value:
        if not isinstance(pair, list) or len(pair) != 2:
            raise InputError(
                "must be a torque, or pairs of speed and torque", "Write [[0, 2 N*m], [3000 rpm, 1.5 N*m]]."
            )
        speed, torque = (plain(one.strip()) if isinstance(one, str) else one for one in pair)
        pairs.append((parse_value(speed, {}, "rad/s"), parse_value(torque, {}, key.unit)))
    if any(later[0] <= earlier[0] for earlier, later in pairwise(pairs)) or not pairs:
        raise InputError("speeds of a curve must increase", "Sort the pairs by speed.")
    if min(min(pair) for pair in pairs) < 0.0:
        raise InputError("a curve has no negative numbers", "Give magnitudes.")
    if len(pairs) == 1:  # a curve that was given as such does not end at the line of the voltage
        pairs.append((pairs[0][0] + 1.0, pairs[0][1]))
    return tuple(pairs)


def _yaml_of_csv(text: str, file: str) -> Source:
    """The rows of a CSV file as the section that they are of: motors, or gears where there is a ratio or a lead."""
    rows = [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text))]
    header = rows[0] if rows else []
    source = Source(data={}, file=file, text=text)
    if "name" not in header:
        source.problems.append(Problem("has no column 'name'", "The first row has the names of the keys.", file=file))
        raise MechanismError(source.problems)
    section = "gears" if {"ratio", "lead"} & set(header) else "motors"
    entries = source.data[section] = {}
    for line, row in enumerate(rows[1:], start=2):
        cells = {key: plain(cell) for key, cell in zip(header, row, strict=False) if cell and not cell.startswith("#")}
        name = str(cells.pop("name", ""))
        if name in entries:
            message = f"is given twice, first on line {source.lines[section, name]}"
            source.problems.append(Problem(message, "Remove one of them.", f"{section}.{name}", file=file, line=line))
        elif name:
            entries[name] = cells
            source.lines[section, name] = line
    return source
