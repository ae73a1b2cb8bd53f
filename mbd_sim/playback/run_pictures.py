"""Panels as PNG, SVG or PDF by Matplotlib, and as a page of HTML by Plotly that can be zoomed, and needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.playback.panels import Line, Panel
from mbd_sim.playback.run_table import RunTable
from mbd_sim.playback.table_export import require_kind

PICTURES = (".png", ".svg", ".pdf")
KINDS = (*PICTURES, ".html")
MOST_LINES = 12  # in a legend
MOST_POINTS = 20_000  # of a line on a page, or of a picture in vectors
MOST_EVENTS = 40


def draw(path: Path, table: RunTable, shown: Sequence[Panel]) -> None:
    """Draw the panels, one below the other.

    :raises MbdSimError: the file is of another kind or cannot be written, or Plotly is not installed.
    """
    require_kind(path, KINDS)
    try:
        if path.suffix == ".html":
            _page(path, table, shown)
        else:
            _picture(path, table, shown)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _picture(path: Path, table: RunTable, shown: Sequence[Panel]) -> None:
    from matplotlib.figure import Figure

    heights = [2.0 if panel.over_time else 4.0 for panel in shown]
    figure = Figure(figsize=(9.0, sum(heights) + 0.6), layout="constrained")
    figure.suptitle(_title(table))
    axes = figure.subplots(len(shown), 1, squeeze=False, height_ratios=heights)[:, 0]
    first = next((axis for axis, panel in zip(axes, shown, strict=True) if panel.over_time), None)
    last = max((n for n, panel in enumerate(shown) if panel.over_time), default=-1)
    for number, (axis, panel) in enumerate(zip(axes, shown, strict=True)):
        for line in panel.lines:
            x, y = _thinned(line) if path.suffix != ".png" else (line.x, line.y)
            axis.plot(x, y, color=_hex(line), linewidth=1.2, label=line.name)
        axis.set(title=panel.title, ylabel=panel.y_label)
        axis.title.set_fontsize("medium")
        axis.grid(alpha=0.25)
        if panel.logarithmic:
            axis.set_yscale("log")
        if panel.over_time:
            for time, _ in table.events[:MOST_EVENTS]:
                axis.axvline(time, color="0.6", linewidth=0.8, linestyle=":")
            if axis is not first:
                axis.sharex(first)
            axis.tick_params(labelbottom=number == last)
        if number == last or not panel.over_time:
            axis.set_xlabel(panel.x_label)
        if 1 < len(panel.lines) <= MOST_LINES:
            axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")
    figure.savefig(path, dpi=110)


def _page(path: Path, table: RunTable, shown: Sequence[Panel]) -> None:
    try:
        from plotly.graph_objects import Scattergl
        from plotly.subplots import make_subplots
    except ImportError as error:
        raise MbdSimError("HTML needs Plotly. Install it with: pip install plotly; or draw a .png or .svg") from error
    heights = [220 if panel.over_time else 440 for panel in shown]
    total = sum(heights)
    figure: Any = make_subplots(
        rows=len(shown),
        cols=1,
        subplot_titles=[panel.title for panel in shown],
        row_heights=[height / total for height in heights],
        vertical_spacing=min(60.0 / total, 0.9 / max(len(shown) - 1, 1)),
    )
    timed = [number for number, panel in enumerate(shown, 1) if panel.over_time]
    first, last = min(timed, default=0), max(timed, default=0)
    for number, panel in enumerate(shown, 1):
        for line in panel.lines:
            x, y = _thinned(line)
            group = {"legendgroup": str(number), "legendgrouptitle": {"text": panel.title}}
            style = {"color": _hex(line), "width": 1.4}
            figure.add_trace(Scattergl(x=x, y=y, name=line.name, mode="lines", line=style, **group), row=number, col=1)
        logarithmic = {"type": "log", "exponentformat": "power"} if panel.logarithmic else {}
        figure.update_yaxes(title_text=panel.y_label, row=number, col=1, **logarithmic)
        shared = {"matches": "x" if first == 1 else f"x{first}"} if panel.over_time and number != first else {}
        label = panel.x_label if number == last or not panel.over_time else ""
        figure.update_xaxes(title_text=label, row=number, col=1, **shared)
        if panel.over_time:
            for time, text in table.events[:MOST_EVENTS]:
                mark = {"line_width": 1, "line_dash": "dot", "line_color": "gray"}
                note = {"annotation_text": text, "annotation_font_size": 9, "annotation_textangle": 90}
                figure.add_vline(x=time, row=number, col=1, **mark, **(note if number == first else {}))
    figure.update_layout(title=_title(table), height=total + 120, template="plotly_white", hovermode="x unified")
    figure.write_html(path, include_plotlyjs=True)


def _title(table: RunTable) -> str:
    about = table.about
    method = f", {about['method']} at {1e3 * float.fromhex(about['step']):g} ms" if "method" in about else ""
    return f"{table.title}: {table.path.name}{method}"


def _thinned(line: Line) -> tuple[Array, Array]:
    """At most `MOST_POINTS`, evenly taken."""
    stride = -(-len(line.x) // MOST_POINTS)
    return np.asarray(line.x[::stride]), np.asarray(line.y[::stride])


def _hex(line: Line) -> str:
    red, green, blue = line.color
    return f"#{red:02x}{green:02x}{blue:02x}"
