"""Plots a recorded run and a changed one in the same axes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mbd_sim.errors import InputError, MbdSimError
from mbd_sim.playback.plot_files import PLOT_SUFFIXES, import_plotly, require_plot_packages, require_suffix
from mbd_sim.recording.changed_run import ChangedRun, ComparedSeries

MAX_COORDINATES = 6  # that are plotted: those that deviate most
TIME = "time since the start of the recording, s"
TOTAL, RESIDUAL = "total energy, J", "|energy residual|, J"
SMALLEST = 1e-18  # J, added to residuals so that zero has a logarithm
RECORDED = {"color": "0.45", "linewidth": 2.2, "label": "recorded"}
CHANGED = {"color": "tab:red", "linewidth": 1.0, "label": "changed"}
_Row = tuple[ComparedSeries, ComparedSeries]


def plot_changed_run(path: Path, run: ChangedRun, title: str, change: str) -> None:
    """Plot positions, velocities and energies of both runs over time; `change` is the label of the changed one.

    A picture is drawn by Matplotlib, a zoomable HTML page by Plotly; the page needs no network.

    :raises MbdSimError: the file has another format or cannot be written, or Plotly is not installed.
    """
    require_suffix(path, PLOT_SUFFIXES)
    try:
        if path.suffix == ".html":
            _write_page(path, run, title, change)
        else:
            _draw_picture(path, run, title, change)
    except InputError:  # already has a remedy
        raise
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _coordinate_rows(run: ChangedRun) -> list[_Row]:
    """Return positions and velocities of the coordinates that deviate most, in the order of the coordinates."""
    positions, velocities = run.coordinates["position"], run.coordinates["velocity"]
    by_deviation = sorted(range(len(positions)), key=lambda n: -positions[n].largest_deviation[0])
    return [(positions[number], velocities[number]) for number in sorted(by_deviation[:MAX_COORDINATES])]


def _energy_row(run: ChangedRun) -> _Row:
    energies = {series.name: series for series in run.energies}
    return energies["total"]._replace(name=TOTAL), energies["residual"]._replace(name=RESIDUAL)


def _draw_picture(path: Path, run: ChangedRun, title: str, change: str) -> None:
    require_plot_packages(path)
    from matplotlib.figure import Figure

    rows = _coordinate_rows(run)
    figure = Figure(figsize=(11.0, 2.1 * (len(rows) + 1) + 0.6), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left")
    grid = figure.subplots(len(rows) + 1, 2, sharex=True, squeeze=False)
    total, residual = _energy_row(run)
    for axes_row, row in zip(grid, rows, strict=False):
        for axes, series in zip(axes_row, row, strict=True):
            _draw_series(axes, series, change)
    _draw_series(grid[-1][0], total, change)
    _draw_residuals(grid[-1][1], residual, change)
    for axes in grid[-1]:
        axes.set_xlabel(TIME)
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize="small")
    figure.savefig(path, dpi=140)


def _draw_series(axes: Any, series: ComparedSeries, change: str) -> None:
    axes.plot(series.times, series.recorded, **RECORDED)
    axes.plot(series.times, series.changed, **(CHANGED | {"label": change}))
    _label(axes, series.name)


def _draw_residuals(axes: Any, series: ComparedSeries, change: str) -> None:
    """Draw the errors of both integrations on a logarithmic scale: they differ by orders of magnitude."""
    for values, style in ((series.recorded, RECORDED), (series.changed, CHANGED | {"label": change})):
        axes.semilogy(series.times, abs(values) + SMALLEST, **style)
    _label(axes, series.name)


def _label(axes: Any, name: str) -> None:
    axes.set_ylabel(name)
    axes.grid(alpha=0.3)


def _write_page(path: Path, run: ChangedRun, title: str, change: str) -> None:
    graph_objects, subplots = import_plotly()
    energies = _energy_row(run)
    rows = [*_coordinate_rows(run), energies]
    figure = subplots.make_subplots(rows=len(rows), cols=2, shared_xaxes="all", vertical_spacing=0.15 / len(rows))
    for number, row in enumerate(rows, 1):
        for column, series in enumerate(row, 1):
            is_residual = series is energies[1]
            is_first = number == column == 1
            for values, name, color, width in (
                (series.recorded, "recorded", "#777777", 3),
                (series.changed, change, "#d62728", 1.5),
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
    figure.update_layout(title=title, height=260 * len(rows) + 120, template="plotly_white")
    figure.write_html(path, include_plotlyjs=True)


def largest_deviations(series: Sequence[ComparedSeries]) -> list[tuple[str, float, float]]:
    """Return name, largest deviation and its time for each series, the largest deviation first."""
    return sorted(((one.name, *one.largest_deviation) for one in series), key=lambda row: -row[1])
