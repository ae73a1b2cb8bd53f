"""A recorded run and a changed one in one picture."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path

from mbd_sim.errors import MbdSimError
from mbd_sim.recording.changed_run import Series, WhatIf

MOST = 6  # coordinates that are drawn: those that deviate most
TIME = "time since the beginning of the recording, s"
TOTAL, RESIDUAL = "total energy, J", "|energy residual|, J"
LEAST = 1e-18  # J, so that a residual of zero has a logarithm
RECORDED = {"color": "0.45", "linewidth": 2.2, "label": "recorded"}
CHANGED = {"color": "tab:red", "linewidth": 1.0, "label": "changed"}


def draw(path: Path, found: WhatIf, title: str, change: str) -> None:
    """Draw positions, velocities and energies of both runs over time; `change` names the changed one.

    A picture by Matplotlib, or a page of HTML by Plotly that can be zoomed and needs no network.

    :raises MbdSimError: the file is of another kind or cannot be written, or Plotly is not installed.
    """
    try:
        if path.suffix == ".html":
            _page(path, found, title, change)
        else:
            _picture(path, found, title, change)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _panels(found: WhatIf) -> list[tuple[Series, Series]]:
    """Rows of what is drawn: positions and velocities of the coordinates that deviate most, in their order."""
    positions, velocities = found.coordinates["position"], found.coordinates["velocity"]
    order = sorted(range(len(positions)), key=lambda n: -positions[n].largest[0])[:MOST]
    return [(positions[number], velocities[number]) for number in sorted(order)]


def _picture(path: Path, found: WhatIf, title: str, change: str) -> None:
    from matplotlib.figure import Figure

    rows = _panels(found)
    figure = Figure(figsize=(11.0, 2.1 * (len(rows) + 1) + 0.6), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left")
    panels = figure.subplots(len(rows) + 1, 2, sharex=True, squeeze=False)
    for axes, row in zip(panels, rows, strict=False):
        for panel, series in zip(axes, row, strict=True):
            _overlay(panel, series, change)
    energies = {series.name: series for series in found.energies}
    _overlay(panels[-1][0], energies["total"]._replace(name=TOTAL), change)
    _residuals(panels[-1][1], energies["residual"], change)
    for axes in panels[-1]:
        axes.set_xlabel(TIME)
    figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize="small")
    figure.savefig(path, dpi=140)


def _page(path: Path, found: WhatIf, title: str, change: str) -> None:
    try:
        line = importlib.import_module("plotly.graph_objects").Scattergl
        subplots = importlib.import_module("plotly.subplots").make_subplots
    except ImportError as error:
        raise MbdSimError("HTML needs Plotly. Install it with: pip install plotly; or draw a .png or .svg") from error
    energies = {series.name: series for series in found.energies}
    last = energies["total"]._replace(name=TOTAL), energies["residual"]._replace(name=RESIDUAL)
    rows = [*_panels(found), last]
    figure = subplots(rows=len(rows), cols=2, shared_xaxes="all", vertical_spacing=0.3 / len(rows) / 2)
    for number, row in enumerate(rows, 1):
        for column, series in enumerate(row, 1):
            logarithmic = series is last[1]
            first = number == column == 1
            for values, name, color, width in (
                (series.recorded, "recorded", "#777777", 3),
                (series.changed, change, "#d62728", 1.5),
            ):
                y = abs(values) + LEAST if logarithmic else values
                style = {"color": color, "width": width}
                trace = line(x=series.times, y=y, name=name, line=style, legendgroup=name, showlegend=first)
                figure.add_trace(trace, row=number, col=column)
            kind = "log" if logarithmic else "linear"
            figure.update_yaxes(title_text=series.name, type=kind, row=number, col=column)
    figure.update_xaxes(title_text=TIME, row=len(rows))
    figure.update_layout(title=title, height=260 * len(rows) + 120, template="plotly_white")
    figure.write_html(path, include_plotlyjs=True)


def _overlay(axes: object, series: Series, change: str) -> None:
    axes.plot(series.times, series.recorded, **RECORDED)  # type: ignore[attr-defined]
    axes.plot(series.times, series.changed, **(CHANGED | {"label": change}))  # type: ignore[attr-defined]
    _finish(axes, series.name)


def _residuals(axes: object, series: Series, change: str) -> None:
    """The errors of both integrations, which have no common value: on a logarithmic scale."""
    for values, style in ((series.recorded, RECORDED), (series.changed, CHANGED | {"label": change})):
        axes.semilogy(series.times, abs(values) + LEAST, **style)  # type: ignore[attr-defined]
    _finish(axes, RESIDUAL)


def _finish(axes: object, name: str) -> None:
    axes.set_ylabel(name)  # type: ignore[attr-defined]
    axes.grid(alpha=0.3)  # type: ignore[attr-defined]


def largest(series: Sequence[Series]) -> list[tuple[str, float, float]]:
    """Name, largest deviation and time of it, the largest first."""
    return sorted(((one.name, *one.largest) for one in series), key=lambda row: -row[1])
