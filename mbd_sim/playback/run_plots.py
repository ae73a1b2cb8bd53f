"""Draws panels as PNG, SVG or PDF by Matplotlib, or as a zoomable HTML page by Plotly, which needs no network."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.errors import InputError, MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.playback.panels import Line, Panel
from mbd_sim.playback.plot_files import PLOT_SUFFIXES, import_plotly, require_plot_packages, require_suffix
from mbd_sim.playback.plot_style import STYLES, PlotStyle, template
from mbd_sim.playback.run_table import RunTable

MAX_LEGEND_LINES = 12
MAX_POINTS = 20_000  # of a line on a page or in a vector graphic
MAX_EVENTS = 40
POINTS_PER_INCH = 72.0


def draw(path: Path, table: RunTable, panels: Sequence[Panel], style: PlotStyle = STYLES["screen"]) -> None:
    """Draw the panels, one below the other.

    :raises MbdSimError: the file has another format or cannot be written, or Plotly is not installed.
    """
    require_suffix(path, PLOT_SUFFIXES)
    try:
        if path.suffix == ".html":
            _write_page(path, table, panels, style)
        else:
            require_plot_packages(path)
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
    graph_objects, subplots = import_plotly()
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
