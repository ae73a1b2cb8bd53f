"""What a picture of a run consists of, whoever draws it: panels of lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbd_sim.appearance import palette
from mbd_sim.appearance.palette import Color, mixed
from mbd_sim.appearance.residual_scale import residual_magnitude
from mbd_sim.errors import MbdSimError, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.playback.run_table import ENERGY_NAMES, RunTable

SHOWN = ("energies", "joints", "residual", "phase")
_ENERGY_COLORS = (
    palette.KINETIC, palette.POTENTIAL, palette.DISSIPATED, palette.WORK_APPLIED, palette.WORK_DRIVES, (40, 44, 52),
)  # fmt: skip
_DARK: Color = (20, 24, 32)  # what the colours of the scene are mixed with to be seen on white


@dataclass(frozen=True, eq=False)
class Line:
    """Values over others, with a name for the legend."""

    name: str
    x: Array
    y: Array
    color: Color


@dataclass(frozen=True, eq=False)
class Panel:
    """Lines on common axes; `over_time` ones share theirs, and show the events."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    over_time: bool = True
    logarithmic: bool = False


def panels(table: RunTable, shown: Sequence[str] = ()) -> list[Panel]:
    """The panels that are asked for, or all that there is something for.

    :raises MbdSimError: one is unknown, or nothing for it is recorded.
    """
    for name in shown:
        if name not in SHOWN:
            raise MbdSimError(f"--show {name}: there is no such picture. {nearest(name, SHOWN)}")
        if not list(_MAKERS[name](table)):
            raise MbdSimError(f"{table.path}: holds nothing to show of '{name}'.")
    found = [panel for name in shown or SHOWN for panel in _MAKERS[name](table)]
    return [replace(panel, lines=tuple(_interrupted(line, table.resets) for line in panel.lines)) for panel in found]


def _interrupted(line: Line, rows: Sequence[int]) -> Line:
    """With a gap before each of some rows."""
    return replace(line, x=np.insert(line.x, rows, np.nan), y=np.insert(line.y, rows, np.nan)) if rows else line


def _energies(table: RunTable) -> Iterator[Panel]:
    if table.energies is not None:
        shown = [i for i in range(6) if ENERGY_NAMES[i] in ("kinetic", "potential", "total") or _moves(table, i)]
        lines = tuple(
            Line(ENERGY_NAMES[i].replace("_", " "), table.times, table.energies[:, i], _ENERGY_COLORS[i]) for i in shown
        )
        yield Panel("Energies", "time, s", "J", lines)


def _moves(table: RunTable, index: int) -> bool:
    assert table.energies is not None
    return bool(np.nanmax(np.abs(table.energies[:, index]), initial=0.0) > 0.0)


def _joints(table: RunTable) -> Iterator[Panel]:
    for title, values, rate in (("Position", table.position, ""), ("Velocity", table.velocity, "/s")):
        for unit in dict.fromkeys(table.units):
            lines = tuple(_lines(table, values, unit))
            if lines:
                yield Panel(title, "time, s", f"{unit}{rate}" if unit else "SI units", lines)
    for unit in dict.fromkeys(table.units):
        lines = tuple(line for line in _lines(table, table.effort, unit) if np.any(line.y != 0.0))
        if lines:
            yield Panel("Effort", "time, s", {"rad": "N·m", "m": "N", "": "SI units"}[unit], lines)


def _lines(table: RunTable, values: Array, unit: str) -> Iterator[Line]:
    for index, name in enumerate(table.names):
        if table.units[index] == unit and not np.all(np.isnan(values[:, index])):
            yield Line(name, table.times, values[:, index], _color(index))


def _phase(table: RunTable) -> Iterator[Panel]:
    for unit in dict.fromkeys(table.units):
        lines = tuple(
            Line(name, table.position[:, index], table.velocity[:, index], _color(index))
            for index, name in enumerate(table.names)
            if table.units[index] == unit and not np.all(np.isnan(table.position[:, index] + table.velocity[:, index]))
        )
        if lines:
            axes = (f"position, {unit}", f"velocity, {unit}/s") if unit else ("position", "velocity")
            yield Panel("Phase portrait", *axes, lines, over_time=False)


def _residual(table: RunTable) -> Iterator[Panel]:
    if table.energies is not None:
        line = Line("|residual|", table.times, residual_magnitude(table.energies), palette.RESIDUAL)
        yield Panel("Energy residual", "time, s", "J", (line,), logarithmic=True)


def _color(index: int) -> Color:
    return mixed(palette.PARTS[index % len(palette.PARTS)], _DARK, 0.18)


_MAKERS = {"energies": _energies, "joints": _joints, "phase": _phase, "residual": _residual}
