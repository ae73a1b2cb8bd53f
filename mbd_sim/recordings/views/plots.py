"""Draws panels as PNG, SVG or PDF by Matplotlib, or as a zoomable HTML page by Plotly, which needs no network.

A recorded run and a changed one can be plotted in the same axes. Files that plots and tables cannot be written to are
refused before anything is computed for them.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.recordings.run.changed_run import ChangedRun, ComparedSeries
from mbd_sim.recordings.views.panels import STYLES, Line, Panel, PlotStyle, template
from mbd_sim.recordings.views.table import RunTable

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
PLOT_SUFFIXES = (*PICTURE_SUFFIXES, ".html")


def require_suffix(path: Path, suffixes: Sequence[str]) -> None:
    """Refuse a file that cannot be written, before anything is read or computed for it.

    :raises InputError: it has another suffix, or its folder does not exist.
    """
    if path.suffix not in suffixes:
        raise InputError(f"{path}: this file format is not supported", f"Choose one of {', '.join(suffixes)}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}", "Create it, or choose another file.")


def require_plot(path: Path | None, suffixes: Sequence[str] = PLOT_SUFFIXES) -> None:
    """Refuse a plot that cannot be written, before anything is computed for it.

    :raises InputError: it has another suffix, or its folder does not exist.
    :raises MissingPackageError: Matplotlib, or Plotly for a page, is not installed.
    """
    if path is None:
        return
    require_suffix(path, suffixes)
    if path.suffix == ".html":
        require_packages("plotly", purpose="An HTML page of plots", otherwise="or choose a .png, .svg or .pdf file.")
    else:
        otherwise = "or choose an .html file." if ".html" in suffixes else ""
        require_packages("matplotlib", purpose="A picture of plots", otherwise=otherwise)


def _plotly() -> tuple[Any, Any]:
    """Plotly's modules `graph_objects` and `subplots`."""
    return importlib.import_module("plotly.graph_objects"), importlib.import_module("plotly.subplots")


MAX_LEGEND_LINES = 12
MAX_POINTS = 20_000  # of a line on a page or in a vector graphic
MAX_EVENTS = 40
POINTS_PER_INCH = 72.0


def draw(path: Path, table: RunTable, panels: Sequence[Panel], style: PlotStyle = STYLES["screen"]) -> None:
    """Draw the panels, one below the other.

    :raises MbdSimError: the file has another format or cannot be written, or Plotly is not installed.
    """
    require_plot(path)
    try:
        if path.suffix == ".html":
            _write_page(path, table, panels, style)
        else:
            with style.applied():
                _draw_picture(path, table, panels, style)
    except InputError:  # already has a remedy
        raise
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _draw_picture(path: Path, table: RunTable, panels: Sequence[Panel], style: PlotStyle) -> None:
    from matplotlib.figure import Figure

    heights = [style.panel_height * (1.0 if panel.over_time else 2.0) for panel in panels]
    figure = Figure(figsize=(style.width, sum(heights) + 0.06 * style.font), layout="constrained")
    if style.titled:
        figure.suptitle(_title(table))
    all_axes = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)[:, 0]
    first, last = _time_panels(panels)
    for number, (axes, panel) in enumerate(zip(all_axes, panels, strict=True)):
        for index, line in enumerate(panel.lines):
            x, y = _thinned(line) if path.suffix != ".png" else (line.x, line.y)
            axes.plot(x, y, style.dash(index), color=style.color(line.color), label=line.name)
        axes.set(title=panel.title if style.titled else "", ylabel=panel.y_label)
        axes.grid(True)
        if panel.logarithmic:
            axes.set_yscale("log")
        if panel.over_time:
            for time, _ in table.events[:MAX_EVENTS]:
                axes.axvline(time, color="0.6", linewidth=0.7 * style.line, linestyle=":")
            if number != first:
                axes.sharex(all_axes[first])
            axes.tick_params(labelbottom=number == last)
        if number == last or not panel.over_time:
            axes.set_xlabel(panel.x_label)
        if len(panel.lines) <= MAX_LEGEND_LINES:
            style.legend(axes, len(panel.lines))
    _align_labels(figure, all_axes)
    figure.savefig(path, dpi=style.resolution)


def _align_labels(figure: Any, all_axes: Iterable[Any]) -> None:
    """Put the labels of the vertical axes in one line, beside the widest tick label.

    Matplotlib's `align_ylabels` measures all panels for each of them, which takes most of the time of twenty.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.transforms import ScaledTranslation

    renderer = FigureCanvasAgg(figure).get_renderer()
    labels = [label for axes in all_axes for label in axes.get_yticklabels(which="both")]
    widest = max((label.get_window_extent(renderer).width for label in labels), default=0.0)
    for axes in all_axes:
        axis = axes.yaxis
        ticks = max(tick.get_pad() + tick.tick1line.get_markersize() for tick in axis.get_major_ticks())
        left = widest / figure.dpi + (ticks + axis.labelpad) / POINTS_PER_INCH
        axis.set_label_coords(
            0.0, 0.5, transform=axes.transAxes + ScaledTranslation(-left, 0.0, figure.dpi_scale_trans)
        )


def _write_page(path: Path, table: RunTable, panels: Sequence[Panel], style: PlotStyle) -> None:
    graph_objects, subplots = _plotly()
    heights = [220 if panel.over_time else 440 for panel in panels]
    total = sum(heights)
    figure = subplots.make_subplots(
        rows=len(panels),
        cols=1,
        subplot_titles=[panel.title for panel in panels],
        row_heights=[height / total for height in heights],
        vertical_spacing=min(60.0 / total, 0.9 / max(len(panels) - 1, 1)),
    )
    first, last = (number + 1 for number in _time_panels(panels))  # Plotly counts from 1
    for number, panel in enumerate(panels, 1):
        for line in panel.lines:
            x, y = _thinned(line)
            trace = graph_objects.Scattergl(
                x=x,
                y=y,
                name=line.name,
                mode="lines",
                line={"color": style.color(line.color), "width": 1.4},
                legendgroup=str(number),
                legendgrouptitle={"text": panel.title},
            )
            figure.add_trace(trace, row=number, col=1)
        logarithmic = {"type": "log", "exponentformat": "power"} if panel.logarithmic else {}
        figure.update_yaxes(title_text=panel.y_label, row=number, col=1, **logarithmic)
        shared = {"matches": "x" if first == 1 else f"x{first}"} if panel.over_time and number != first else {}
        label = panel.x_label if number == last or not panel.over_time else ""
        figure.update_xaxes(title_text=label, row=number, col=1, **shared)
        if panel.over_time:
            _add_events(figure, table, number, labeled=number == first)
    figure.update_layout(title=_title(table), height=total + 120, template=template(style.theme), hovermode="x unified")
    figure.write_html(path, include_plotlyjs=True)


def _add_events(figure: Any, table: RunTable, row: int, *, labeled: bool) -> None:
    for time, text in table.events[:MAX_EVENTS]:
        style = {"line_width": 1, "line_dash": "dot", "line_color": "gray"}
        label = {"annotation_text": text, "annotation_font_size": 9, "annotation_textangle": 90} if labeled else {}
        figure.add_vline(x=time, row=row, col=1, **style, **label)


def _time_panels(panels: Sequence[Panel]) -> tuple[int, int]:
    """Return the numbers, from 0 on, of the first and the last panel over time; -1 if there is none."""
    numbers = [number for number, panel in enumerate(panels) if panel.over_time]
    return min(numbers, default=-1), max(numbers, default=-1)


def _title(table: RunTable) -> str:
    about = table.about
    method = f", {about['method']} at {1e3 * float.fromhex(about['step']):g} ms" if "method" in about else ""
    return f"{table.title}: {table.path.name}{method}"


def _thinned(line: Line) -> tuple[Array, Array]:
    """Return at most `MAX_POINTS` of a line's points, evenly spaced."""
    stride = -(-len(line.x) // MAX_POINTS)
    return np.asarray(line.x[::stride]), np.asarray(line.y[::stride])


MAX_COORDINATES = 6  # that are plotted: those that deviate most
TIME = "time since the start of the recording (s)"
TOTAL, RESIDUAL = "total energy (J)", "|energy residual| (J)"
SMALLEST = 1e-18  # J, added to residuals so that zero has a logarithm
RECORDED, CHANGED = (119, 119, 119), (214, 39, 40)  # colors
_Row = tuple[ComparedSeries, ComparedSeries]


def plot_changed_run(
    path: Path,
    run: ChangedRun,
    title: str,
    change: str,
    units: Mapping[str, str],
    style: PlotStyle = STYLES["screen"],
) -> None:
    """Plot positions, velocities and energies of both runs over time; `change` is the label of the changed one.

    `units` are those of the coordinates by their names.

    A picture is drawn by Matplotlib, a zoomable HTML page by Plotly; the page needs no network.

    :raises MbdSimError: the file has another format or cannot be written, or Plotly is not installed.
    """
    require_plot(path)
    rows = [*_coordinate_rows(run, units), _energy_row(run)]
    try:
        if path.suffix == ".html":
            _write_changed_page(path, rows, title, change, style)
        else:
            with style.applied():
                _draw_changed_picture(path, rows, title, change, style)
    except InputError:  # already has a remedy
        raise
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _coordinate_rows(run: ChangedRun, units: Mapping[str, str]) -> list[_Row]:
    """Return positions and velocities of the coordinates that deviate most, in the order of the coordinates."""
    positions, velocities = run.coordinates["position"], run.coordinates["velocity"]
    by_deviation = sorted(range(len(positions)), key=lambda n: -positions[n].largest_deviation[0])
    chosen = sorted(by_deviation[:MAX_COORDINATES])
    return [(_labeled(positions[number], units, ""), _labeled(velocities[number], units, "/s")) for number in chosen]


def _labeled(series: ComparedSeries, units: Mapping[str, str], rate: str) -> ComparedSeries:
    """The series of a coordinate, such as `elbow position`, with its unit."""
    return replace(series, name=f"{series.name} ({units[series.name.rpartition(' ')[0]]}{rate})")


def _energy_row(run: ChangedRun) -> _Row:
    energies = {series.name: series for series in run.energies}
    return replace(energies["total"], name=TOTAL), replace(energies["residual"], name=RESIDUAL)


def _draw_changed_picture(path: Path, rows: Sequence[_Row], title: str, change: str, style: PlotStyle) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.double_width, style.panel_height * len(rows) + 0.6), layout="constrained")
    if style.titled:
        figure.suptitle(title, x=0.01, ha="left")
    grid = figure.subplots(len(rows), 2, sharex=True, squeeze=False)
    residual = rows[-1][1]
    for axes_row, row in zip(grid, rows, strict=True):
        for axes, series in zip(axes_row, row, strict=True):
            _draw_series(axes, series, change, style, logarithmic=series is residual)
    for axes in grid[-1]:
        axes.set_xlabel(TIME)
    place = "outside upper right" if style.titled else "outside upper center"
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc=place, ncols=2, fontsize="small", frameon=False)
    figure.savefig(path, dpi=style.resolution)


def _draw_series(axes: Any, series: ComparedSeries, change: str, style: PlotStyle, *, logarithmic: bool) -> None:
    """Draw both runs; errors of integration on a logarithmic scale, because they differ by orders of magnitude."""
    for values, name, color, width, dash in (
        (series.recorded, "recorded", RECORDED, 1.8, "-"),
        (series.changed, change, CHANGED, 0.8, style.dash(1)),
    ):
        shown = abs(values) + SMALLEST if logarithmic else values
        axes.plot(series.times, shown, dash, color=style.color(color), linewidth=width * style.line, label=name)
    if logarithmic:
        axes.set_yscale("log")
    axes.set_ylabel(series.name)
    axes.grid(True)


def _write_changed_page(path: Path, rows: Sequence[_Row], title: str, change: str, style: PlotStyle) -> None:
    graph_objects, subplots = _plotly()
    residual = rows[-1][1]
    figure = subplots.make_subplots(rows=len(rows), cols=2, shared_xaxes="all", vertical_spacing=0.15 / len(rows))
    for number, row in enumerate(rows, 1):
        for column, series in enumerate(row, 1):
            is_residual = series is residual
            is_first = number == column == 1
            for values, name, color, width in (
                (series.recorded, "recorded", style.color(RECORDED), 3),
                (series.changed, change, style.color(CHANGED), 1.5),
            ):
                y = abs(values) + SMALLEST if is_residual else values
                trace = graph_objects.Scattergl(
                    x=series.times,
                    y=y,
                    name=name,
                    line={"color": color, "width": width},
                    legendgroup=name,
                    showlegend=is_first,
                )
                figure.add_trace(trace, row=number, col=column)
            axis_type = "log" if is_residual else "linear"
            figure.update_yaxes(title_text=series.name, type=axis_type, row=number, col=column)
    figure.update_xaxes(title_text=TIME, row=len(rows))
    figure.update_layout(title=title, height=260 * len(rows) + 120, template=template(style.theme))
    figure.write_html(path, include_plotlyjs=True)


def largest_deviations(series: Sequence[ComparedSeries]) -> list[tuple[str, float, float]]:
    """Return name, largest deviation and its time for each series, the largest deviation first."""
    return sorted(((one.name, *one.largest_deviation) for one in series), key=lambda row: -row[1])
