"""Plots a recorded run and a changed one in the same axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mbd_sim.errors import InputError, MbdSimError
from mbd_sim.playback.plot_files import PLOT_SUFFIXES, import_plotly, require_plot_packages, require_suffix
from mbd_sim.playback.plot_style import STYLES, PlotStyle, template
from mbd_sim.recording.changed_run import ChangedRun, ComparedSeries

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
    require_suffix(path, PLOT_SUFFIXES)
    rows = [*_coordinate_rows(run, units), _energy_row(run)]
    try:
        if path.suffix == ".html":
            _write_page(path, rows, title, change, style)
        else:
            require_plot_packages(path)
            with style.applied():
                _draw_picture(path, rows, title, change, style)
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


def _draw_picture(path: Path, rows: Sequence[_Row], title: str, change: str, style: PlotStyle) -> None:
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


def _write_page(path: Path, rows: Sequence[_Row], title: str, change: str, style: PlotStyle) -> None:
    graph_objects, subplots = import_plotly()
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
