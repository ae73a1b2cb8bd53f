"""The plots of a run as data, independent of the plotting library: panels of lines, and how they look.

Width, fonts and colors are for a screen, a slide or a printed page, on a light or a dark ground.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.palette import Color, mixed, residual_magnitude
from mbd_sim.recordings.views.table import CONTACT, ENERGY_NAMES, REACTION, RunTable

_ENERGY_COLORS = {
    "kinetic": palette.KINETIC,
    "potential": palette.POTENTIAL,
    "dissipated": palette.DISSIPATED,
    "work_applied": palette.WORK_APPLIED,
    "work_drives": palette.WORK_DRIVES,
    "total": (40, 44, 52),
}
_ALWAYS_SHOWN = ("kinetic", "potential", "total")
TIME = "time (s)"
_EFFORT_LABELS = {"rad": "torque (N·m)", "m": "force (N)", "": "effort (SI units)"}
# Titles of the positions, velocities and efforts of a unit, and of the phase portrait, where there are several units.
_TITLES = {
    "rad": ("Angle", "Angular velocity", "Torque", "Phase portrait of rotations"),
    "m": ("Displacement", "Velocity", "Force", "Phase portrait of displacements"),
    "": ("Position", "Velocity of other coordinates", "Effort", "Phase portrait of other coordinates"),
}
OF_COORDINATES = ("joints", "phase")  # groups of panels with a line for each coordinate
_DARK: Color = (20, 24, 32)  # mixed with the colors of the scene so that they are visible on white


@dataclass(frozen=True, eq=False)
class Line:
    """Values y (n,) over x (n,), and the name in the legend.

    The line is interrupted before the entries `gaps`; None stands for the rows at which the motion starts again.
    """

    name: str
    x: Array
    y: Array
    color: Color
    gaps: tuple[int, ...] | None = None
    width: float = 1.0  # relative to that of the style


@dataclass(frozen=True, eq=False)
class Panel:
    """Lines in common axes; panels `over_time` share their time axis and show the events."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    over_time: bool = True
    logarithmic: bool = False


def panels(
    table: RunTable, names: Sequence[str] = (), coordinates: Sequence[str] = (), *, degrees: bool = False
) -> list[Panel]:
    """Return the named groups of panels, or all for which there are data.

    :param coordinates: names, or patterns such as `leg_*`, of those that are plotted; by default all.
    :param degrees: plot angles in degrees, not in rad.
    :raises InputError: a name is unknown, or the recording has no data for it.
    """
    require_names(names)
    for name in names:
        if not list(_BUILDERS[name](table)):
            raise InputError(
                f"{table.path}: the recording contains no data for the plot '{name}'", _REMEDIES.get(name, "")
            )
    chosen = _chosen_coordinates(table, coordinates)
    found = [
        panel
        for name in names or _BUILDERS
        for one in _BUILDERS[name](table)
        if (panel := _of_coordinates(one, chosen) if name in OF_COORDINATES else one).lines
    ]
    if degrees:
        found = [_in_degrees(panel) for panel in found]
    return [replace(panel, lines=tuple(_with_gaps(line, table.resets) for line in panel.lines)) for panel in found]


def _chosen_coordinates(table: RunTable, patterns: Sequence[str]) -> set[str]:
    found = set[str]()
    for pattern in patterns:
        matching = fnmatch.filter(table.names, pattern)
        if not matching:
            raise InputError(f"coordinates: there is no coordinate '{pattern}'", nearest(pattern, table.names))
        found |= {*matching}
    return found or {*table.names}


def _of_coordinates(panel: Panel, names: Collection[str]) -> Panel:
    return replace(panel, lines=tuple(line for line in panel.lines if line.name in names))


def _in_degrees(panel: Panel) -> Panel:
    x, y = (np.degrees(1.0) if "(rad" in label else 1.0 for label in (panel.x_label, panel.y_label))
    return replace(
        panel,
        x_label=panel.x_label.replace("(rad", "(deg"),
        y_label=panel.y_label.replace("(rad", "(deg"),
        lines=tuple(replace(line, x=x * line.x, y=y * line.y) for line in panel.lines),
    )


def require_names(names: Sequence[str]) -> None:
    """Refuse names that are not those of groups of panels.

    :raises InputError: there is no such group.
    """
    for name in names:
        if name not in _BUILDERS:
            raise InputError(f"show: there is no plot '{name}'", nearest(name, _BUILDERS))


def _with_gaps(line: Line, rows: Sequence[int]) -> Line:
    """Return a line that is interrupted before its gaps, by default before each of some rows."""
    rows = rows if line.gaps is None else line.gaps
    return replace(line, x=np.insert(line.x, rows, np.nan), y=np.insert(line.y, rows, np.nan)) if rows else line


def _energies(table: RunTable) -> Iterator[Panel]:
    if table.energies is not None:
        values = {name: table.energies[:, index] for index, name in enumerate(ENERGY_NAMES)}
        lines = tuple(
            Line(name.replace("_", " "), table.times, values[name], color)
            for name, color in _ENERGY_COLORS.items()
            if name in _ALWAYS_SHOWN or np.nanmax(np.abs(values[name]), initial=0.0) > 0.0
        )
        yield Panel("Energies", TIME, "energy (J)", lines)


def _joints(table: RunTable) -> Iterator[Panel]:
    for title, values, rate in (("Position", table.position, ""), ("Velocity", table.velocity, "/s")):
        for unit in dict.fromkeys(table.units):
            lines = tuple(_joint_lines(table, values, unit))
            if lines:
                yield Panel(_titled(title, table, unit), TIME, _named(title.lower(), unit and unit + rate), lines)
    for unit in dict.fromkeys(table.units):
        lines = tuple(line for line in _joint_lines(table, table.effort, unit) if np.any(line.y != 0.0))
        if lines:
            yield Panel(_titled("Effort", table, unit), TIME, _EFFORT_LABELS[unit], lines)


def _titled(title: str, table: RunTable, unit: str) -> str:
    """The title of a panel of joints; that of its unit where there are several units."""
    generic = "Position", "Velocity", "Effort", "Phase portrait"
    return title if len(set(table.units)) == 1 else _TITLES[unit][generic.index(title)]


def _joint_lines(table: RunTable, values: Array, unit: str) -> Iterator[Line]:
    for index, name in enumerate(table.names):
        if table.units[index] == unit and not np.all(np.isnan(values[:, index])):
            yield Line(name, table.times, values[:, index], _joint_color(index))


def _phase_portraits(table: RunTable) -> Iterator[Panel]:
    for unit in dict.fromkeys(table.units):
        lines = tuple(
            Line(name, table.position[:, index], table.velocity[:, index], _joint_color(index))
            for index, name in enumerate(table.names)
            if table.units[index] == unit and not np.all(np.isnan(table.position[:, index] + table.velocity[:, index]))
        )
        if lines:
            labels = _named("position", unit), _named("velocity", unit and f"{unit}/s")
            yield Panel(_titled("Phase portrait", table, unit), *labels, lines, over_time=False)


def _residual(table: RunTable) -> Iterator[Panel]:
    if table.energies is not None:
        line = Line("|residual|", table.times, residual_magnitude(table.energies), palette.RESIDUAL)
        yield Panel("Energy residual", TIME, "|residual| (J)", (line,), logarithmic=True)


def _reactions(table: RunTable) -> Iterator[Panel]:
    """The magnitudes of the force and of the moment that each joint transmits."""
    joints = _with_forces(table, REACTION)
    for title, unit, suffix in (("Reaction force", "N", "force_{}_N"), ("Reaction moment", "N·m", "moment_{}_Nm")):
        lines = []
        for index, joint in enumerate(joints):
            vectors = [table.requested[f"{REACTION}{joint}.{suffix.format(axis)}"] for axis in "xyz"]
            lines.append(Line(joint, table.times, np.linalg.norm(vectors, axis=0), _joint_color(index)))
        if lines:
            yield Panel(title, TIME, _named(title.split()[-1], unit), tuple(lines))


def _contact_forces(table: RunTable) -> Iterator[Panel]:
    """The magnitudes of the forces of the contacts that touched."""
    forces = {
        name: np.linalg.norm([table.requested[f"{CONTACT}{name}.force_{axis}_N"] for axis in "xyz"], axis=0)
        for name in _with_forces(table, CONTACT)
    }
    touched = [name for name, force in forces.items() if np.nanmax(force, initial=0.0) > 0.0]
    if touched:
        lines = (Line(name, table.times, forces[name], _joint_color(index)) for index, name in enumerate(touched))
        yield Panel("Contact force", TIME, _named("force", "N"), tuple(lines))


def _with_forces(table: RunTable, prefix: str) -> list[str]:
    """The names of the joints or contacts whose forces were recorded on request."""
    suffix = ".force_x_N"
    found = [name for name in table.requested if name.startswith(prefix) and name.endswith(suffix)]
    return [name.removeprefix(prefix).removesuffix(suffix) for name in found]


def _sensors(table: RunTable) -> Iterator[Panel]:
    """The measurements over the times of their arrival; the components of a quantity share a panel."""
    for sensor, measurements in table.sensors.items():
        gaps = tuple(np.searchsorted(measurements.rows, table.resets).tolist())
        for quantity, measured in measurements.quantities.items():
            lines = tuple(
                Line(component or sensor, measurements.times, column, _joint_color(index), gaps)
                for index, (component, column) in enumerate(zip(measured.components, measured.values.T, strict=True))
            )
            name = quantity.replace("_", " ")
            yield Panel(f"{sensor}: {name}", TIME, _named(name, measured.unit or "1"), lines)


def _named(quantity: str, unit: str) -> str:
    """The label of an axis."""
    return f"{quantity} ({unit or 'SI units'})"


def _joint_color(index: int) -> Color:
    return mixed(palette.PARTS[index % len(palette.PARTS)], _DARK, 0.18)


_REMEDIES = {
    "reactions": "Record the run with --reactions, or in a node with joint_reactions:=true.",
    "contacts": "Record the run with --contact-forces, or in a node with contact_forces:=true. Stops of joints, and "
    "contacts that never touch, have no forces to draw.",
    "sensors": "Give the mechanism sensors.",
}
_BUILDERS = {
    "energies": _energies,
    "joints": _joints,
    "residual": _residual,
    "reactions": _reactions,
    "contacts": _contact_forces,
    "sensors": _sensors,
    "phase": _phase_portraits,
}


THEMES = ("light", "dark")
DASHES = ("-", "--", "-.", ":")  # of printed lines, which may have no colors
_WHITE: Color = (255, 255, 255)
_DARK_GROUND, _DARK_TEXT, _DARK_RULES = "#131416", "#e6e8ec", "#5a606a"
_BRIGHT = 150  # largest component above which a color is visible on a dark ground


@dataclass(frozen=True)
class PlotStyle:
    """The style of a plot: sizes in inches, points and pixels per inch."""

    name: str
    width: float
    double_width: float  # of plots in two columns
    panel_height: float  # of a panel over time; that of a phase portrait is twice as large
    font: float
    line: float
    resolution: int
    titled: bool = True  # the plot and its panels have titles; a figure in a paper has a caption instead
    dashed: bool = False
    theme: str = "light"

    def color(self, color: Color) -> str:
        """A color as Matplotlib and HTML write it, which is visible on the ground of the theme."""
        if self.theme == "dark":
            color = mixed(color, _WHITE, 0.2 if max(color) > _BRIGHT else 0.8)
        return f"#{color[0]:02x}{color[1]:02x}{color[2]:02x}"

    def dash(self, number: int) -> str:
        """The dashes of the line of a number in its panel."""
        return DASHES[number % len(DASHES)] if self.dashed else "-"

    def legend(self, axes: Any, count: int) -> None:
        """Name the `count` lines outside the axes: on the right, or above them where the width is scarce."""
        if self.titled:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")
        else:
            axes.legend(
                loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(count, 3), frameon=False, fontsize="small"
            )

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Draw with Matplotlib in this style rather than in the user's own."""
        from matplotlib import style

        settings: dict[str, Any] = {
            "font.size": self.font,
            "lines.linewidth": self.line,
            "axes.linewidth": 0.6 * self.line,
            "axes.titlesize": "medium",
            "axes.labelsize": "medium",
            "svg.fonttype": "none",
            "grid.alpha": 0.3,
        }
        if self.theme == "dark":
            settings |= dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), _DARK_GROUND)
            text = ("text.color", "axes.labelcolor", "xtick.color", "ytick.color", "axes.titlecolor")
            settings |= dict.fromkeys(text, _DARK_TEXT) | dict.fromkeys(("axes.edgecolor", "grid.color"), _DARK_RULES)
        with style.context(["default", settings]):
            yield


STYLES = {
    "screen": PlotStyle("screen", width=9.0, double_width=11.0, panel_height=2.0, font=10.0, line=1.2, resolution=110),
    "slide": PlotStyle("slide", width=10.0, double_width=13.3, panel_height=2.6, font=16.0, line=2.2, resolution=192),
    "paper": PlotStyle(
        "paper",
        width=3.5,
        double_width=7.2,
        panel_height=1.4,
        font=8.0,
        line=0.9,
        resolution=300,
        titled=False,
        dashed=True,
    ),
}


def plot_style(path: Path, name: str = "screen", theme: str = "light") -> PlotStyle:
    """The style for a file.

    :raises InputError: there is no such style or theme, or the file is an HTML page and the style is not `screen`.
    """
    if name not in STYLES:
        raise InputError(f"there is no style {name!r} of plots", nearest(name, STYLES))
    if theme not in THEMES:
        raise InputError(f"there is no theme {theme!r} of plots", nearest(theme, THEMES))
    if path.suffix == ".html" and name != "screen":
        raise InputError(
            f"{path}: the style {name} has a fixed width, but an HTML page is as wide as its window",
            "Choose a .png, .svg or .pdf file.",
        )
    return replace(STYLES[name], theme=theme)


def template(theme: str) -> str:
    """The template of Plotly for a theme."""
    return "plotly_dark" if theme == "dark" else "plotly_white"
