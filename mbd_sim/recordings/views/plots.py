"""Draws panels as PNG, SVG or PDF by Matplotlib, or as a zoomable HTML page by Plotly, which needs no network.

A recorded run and a changed one can be plotted in the same axes. Files that plots and tables cannot be written to are
refused before anything is computed for them.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError, cause_of
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.packages import require_packages
from mbd_sim.recordings.run.changed_run import ChangedRun, ComparedSeries
from mbd_sim.recordings.views.panels import STYLES, Line, Panel, PlotStyle, template
from mbd_sim.recordings.views.table import RunTable, require_suffix

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
PLOT_SUFFIXES = (*PICTURE_SUFFIXES, ".html")


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


def draw(
    path: Path, table: RunTable, panels: Sequence[Panel], style: PlotStyle = STYLES["screen"], *, kept: bool = True
) -> None:
    """Draw the panels of a run, one below the other.

    :param kept: whether the recording remains, whose name is in the title then.
    :raises MbdSimError: the file has another format or cannot be written, or Plotly is not installed.
    """
    _draw(path, _Plot(_title(table, kept), panels, style, table.events[:MAX_EVENTS]))


@dataclass(frozen=True)
class _Plot:
    """Panels in rows of `columns`; with several columns all have the same lines, which are named once."""

    title: str
    panels: Sequence[Panel]
    style: PlotStyle
    events: Sequence[tuple[float, str]] = ()
    columns: int = 1

    @property
    def rows(self) -> int:
        return -(-len(self.panels) // self.columns)

    def is_labeled(self, number: int) -> bool:
        """Whether the horizontal axis of a panel is labeled: those over time share the lowest one of the column."""
        below = self.panels[number + self.columns :: self.columns]
        return not (self.panels[number].over_time and any(panel.over_time for panel in below))


@interruptible()
def _draw(path: Path, plot: _Plot) -> None:
    """Draw by Matplotlib, or as a zoomable HTML page by Plotly, which needs no network."""
    require_plot(path)
    try:
        if path.suffix == ".html":
            _write_page(path, plot)
        else:
            with plot.style.applied():
                _draw_picture(path, plot)
    except InputError:  # already has a remedy
        raise
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {cause_of(error)}") from error


def _draw_picture(path: Path, plot: _Plot) -> None:
    from matplotlib.figure import Figure

    style, panels = plot.style, plot.panels
    heights = [style.panel_height * (1.0 if panel.over_time else 2.0) for panel in panels[:: plot.columns]]
    width = style.width if plot.columns == 1 else style.double_width
    figure = Figure(figsize=(width, sum(heights) + 0.06 * style.font), layout="constrained")
    if style.titled:
        figure.suptitle(plot.title)
    all_axes = figure.subplots(plot.rows, plot.columns, squeeze=False, height_ratios=heights).ravel()
    first = next((number for number, panel in enumerate(panels) if panel.over_time), -1)
    for number, (axes, panel) in enumerate(zip(all_axes, panels, strict=True)):
        for index, line in enumerate(panel.lines):
            x, y = _thinned(line) if path.suffix != ".png" else (line.x, line.y)
            look = {"color": style.color(line.color), "linewidth": line.width * style.line}
            axes.plot(x, y, style.dash(index), label=line.name, **look)
        axes.set(title=panel.title if style.titled else "", ylabel=panel.y_label)
        axes.grid(True)
        if panel.logarithmic:
            axes.set_yscale("log")
        if panel.over_time:
            for time, _ in plot.events:
                axes.axvline(time, color="0.6", linewidth=0.7 * style.line, linestyle=":")
            if number != first:
                axes.sharex(all_axes[first])
            axes.tick_params(labelbottom=plot.is_labeled(number))
        if plot.is_labeled(number):
            axes.set_xlabel(panel.x_label)
        if plot.columns == 1 and len(panel.lines) <= MAX_LEGEND_LINES:
            style.legend(axes, len(panel.lines))
    if plot.columns > 1:
        lines = all_axes[0].get_legend_handles_labels()
        figure.legend(*lines, loc="outside lower center", ncols=len(panels[0].lines), fontsize="small", frameon=False)
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


def _write_page(path: Path, plot: _Plot) -> None:
    graph_objects, subplots = _plotly()
    panels, style = plot.panels, plot.style
    heights = [220 if panel.over_time else 440 for panel in panels[:: plot.columns]]
    total = sum(heights)
    figure = subplots.make_subplots(
        rows=plot.rows,
        cols=plot.columns,
        subplot_titles=[panel.title for panel in panels],
        row_heights=[height / total for height in heights],
        vertical_spacing=min(60.0 / total, 0.9 / max(plot.rows - 1, 1)),
    )
    first = next((number for number, panel in enumerate(panels) if panel.over_time), -1)
    for number, panel in enumerate(panels):
        place = {"row": number // plot.columns + 1, "col": number % plot.columns + 1}  # Plotly counts from 1
        for line in panel.lines:
            x, y = _thinned(line)
            look = {"color": style.color(line.color), "width": 1.4 * line.width}
            trace = graph_objects.Scattergl(x=x, y=y, name=line.name, mode="lines", line=look)
            if plot.columns == 1:
                trace.update(legendgroup=str(number), legendgrouptitle={"text": panel.title})
            else:
                trace.update(legendgroup=line.name, showlegend=number == 0)
            figure.add_trace(trace, **place)
        logarithmic = {"type": "log", "exponentformat": "power"} if panel.logarithmic else {}
        figure.update_yaxes(title_text=panel.y_label, **place, **logarithmic)
        shared = {"matches": f"x{first + 1 if first else ''}"} if panel.over_time and number != first else {}
        figure.update_xaxes(title_text=panel.x_label if plot.is_labeled(number) else "", **place, **shared)
        for time, text in plot.events if panel.over_time else ():
            line_style = {"line_width": 1, "line_dash": "dot", "line_color": "gray"}
            label = {"annotation_text": text, "annotation_font_size": 9, "annotation_textangle": 90}
            figure.add_vline(x=time, **place, **line_style, **(label if number == first else {}))
    figure.update_layout(title=plot.title, height=total + 120, template=template(style.theme), hovermode="x unified")
    figure.write_html(path, include_plotlyjs=True)


def _title(table: RunTable, kept: bool) -> str:
    about = table.about
    method = f", {about['method']} at {1e3 * float.fromhex(about['step']):g} ms" if "method" in about else ""
    return f"{table.title}{f': {table.path.name}' if kept else ''}{method}"


def _thinned(line: Line) -> tuple[Array, Array]:
    """Return at most `MAX_POINTS` of a line's points, evenly spaced."""
    stride = -(-len(line.x) // MAX_POINTS)
    return np.asarray(line.x[::stride]), np.asarray(line.y[::stride])


MAX_COORDINATES = 6  # that are plotted: those that deviate most
TIME = "time since the start of the recording (s)"
SMALLEST = 1e-18  # J, added to residuals so that zero has a logarithm
RECORDED, CHANGED = (119, 119, 119), (214, 39, 40)  # colors


def plot_changed_run(
    path: Path,
    run: ChangedRun,
    title: str,
    change: str,
    units: Mapping[str, str],
    style: PlotStyle = STYLES["screen"],
) -> None:
    """Plot positions, velocities and energies of both runs over time; `change` is the label of the changed one.

    :param units: those of the coordinates by their names.
    :raises MbdSimError: the file has another format or cannot be written, or Plotly is not installed.
    """
    positions, velocities = run.coordinates["position"], run.coordinates["velocity"]
    by_deviation = sorted(range(len(positions)), key=lambda n: -positions[n].largest_deviation[0])
    panels = []
    for number in sorted(by_deviation[:MAX_COORDINATES]):
        for series, rate in ((positions[number], ""), (velocities[number], "/s")):
            label = f"{series.name} ({units[series.name.rpartition(' ')[0]]}{rate})"
            panels.append(_compared(series, label, change))
    energies = {series.name: series for series in run.energies}
    panels.append(_compared(energies["total"], "total energy (J)", change))
    panels.append(_compared(energies["residual"], "|energy residual| (J)", change, logarithmic=True))
    _draw(path, _Plot(title, panels, style, columns=2))


def _compared(series: ComparedSeries, label: str, change: str, *, logarithmic: bool = False) -> Panel:
    """Both runs; errors of integration on a logarithmic scale, because they differ by orders of magnitude."""
    lines = [
        Line("recorded", series.times, series.recorded, RECORDED, width=1.8),
        Line(change, series.times, series.changed, CHANGED, width=0.8),
    ]
    if logarithmic:
        lines = [replace(line, y=abs(line.y) + SMALLEST) for line in lines]
    return Panel("", TIME, label, tuple(lines), logarithmic=logarithmic)


def largest_deviations(series: Sequence[ComparedSeries]) -> list[tuple[str, float, float]]:
    """Return name, largest deviation and its time for each series, the largest deviation first."""
    return sorted(((one.name, *one.largest_deviation) for one in series), key=lambda row: -row[1])
