"""A drawing as a file or as pixels, rendered by Matplotlib; the same mechanism always gives the same file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.appearance.palette import Color
from mbd_sim.drawing.composition import Composition, compose
from mbd_sim.drawing.sheet import SheetPath, SheetText
from mbd_sim.errors import MbdSimError, quoted
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.packages import require_packages

FORMATS = (".png", ".svg")
RESOLUTION = 144  # pixels per inch, of PNG
POINTS = 72.0  # per inch
SETTINGS = {"svg.hashsalt": "mbd_sim", "svg.fonttype": "path", "path.simplify": False, "text.usetex": False}


class DrawingError(MbdSimError):
    """A drawing cannot be written."""


def draw(mechanism: Mechanism, poses: Mapping[str, Pose], path: str | Path, *, title: str | None = None) -> None:
    """Draw a mechanism into a file, as PNG or SVG by its suffix.

    A planar mechanism is drawn in its plane, any other one obliquely from above.

    :param poses: the pose of each part in ground's frame in m, as from `Simulation.poses()`.
    :param title: a line above the drawing.
    :raises DrawingError: the suffix is neither `.png` nor `.svg`, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise DrawingError(
            f"cannot draw {quoted(str(path))}: the suffix is {quoted(path.suffix) if path.suffix else 'missing'}. "
            f"Use a file name that ends in {' or '.join(FORMATS)}."
        )
    require_packages("matplotlib", purpose="A drawing")
    picture = compose(mechanism, poses, title)
    try:
        path.open("ab").close()  # fails before Matplotlib is loaded
        _write(picture, path)
    except OSError as error:
        raise DrawingError(
            f"cannot write {quoted(str(path))}: {error.strerror or error}. "
            "Choose a file in a folder that you may write to."
        ) from error


def _write(picture: Composition, path: Path) -> None:
    with _figure(picture, RESOLUTION) as figure:
        metadata = {"Date": None, "Creator": "mbd_sim"} if path.suffix.lower() == ".svg" else {"Software": "mbd_sim"}
        figure.savefig(path, dpi=RESOLUTION, metadata=metadata)


def pixels(picture: Composition, resolution: float = POINTS) -> NDArray[np.uint8]:
    """A drawing as pixels (height, width, 3), `resolution` of them per inch."""
    with _figure(picture, resolution) as figure:
        figure.canvas.draw()
        return np.array(figure.canvas.buffer_rgba())[:, :, :3]


@contextlib.contextmanager
def _figure(picture: Composition, resolution: float) -> Iterator[Any]:
    """A Matplotlib figure of a drawing, with Matplotlib's default settings rather than the user's."""
    require_packages("matplotlib", purpose="A drawing")
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with style.context(["default", SETTINGS]):  # not the user's own
        figure = Figure(figsize=tuple(picture.size / POINTS), dpi=resolution, facecolor="white")
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0.0, float(picture.size[0]))
        axes.set_ylim(0.0, float(picture.size[1]))
        for order, item in enumerate(picture.sheet.back_to_front()):
            axes.add_patch(_patch(item, order))
        for text in picture.sheet.texts:
            _add_text(axes, text, len(picture.sheet.paths))
        yield figure


def _patch(item: SheetPath, order: int) -> Any:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    points = np.round(np.vstack([item.points, item.points[:1]]) if item.closed else item.points, 2)  # short SVG
    outline = Outline(points, closed=item.closed)
    dash = (0.0, tuple(length / item.width for length in item.dash)) if item.dash else "-"
    return PathPatch(
        outline,
        facecolor=_rgb(item.fill) if item.fill else "none",
        edgecolor=_rgb(item.edge) if item.edge else "none",
        linewidth=item.width if item.edge else 0.0,
        linestyle=dash,
        capstyle="butt" if item.dash or item.width > 3.0 else "round",
        joinstyle="round",
        zorder=order,
        clip_on=False,
    )


def _add_text(axes: Any, text: SheetText, order: int) -> None:
    from matplotlib.patheffects import withStroke

    axes.text(
        *text.at,
        text.text,
        fontsize=text.size,
        fontfamily="DejaVu Sans",
        fontstyle="italic" if text.italic else "normal",
        color=_rgb(text.color),
        ha="center",
        va="center_baseline",
        zorder=order,
        parse_math=False,
        path_effects=[withStroke(linewidth=2.4, foreground="white")],
    )


def _rgb(color: Color) -> tuple[float, float, float]:
    r, g, b = color
    return (r / 255.0, g / 255.0, b / 255.0)
