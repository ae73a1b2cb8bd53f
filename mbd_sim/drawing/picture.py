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

FORMATS = (".png", ".svg", ".pdf")
RESOLUTION = 144  # pixels per inch, of PNG
POINTS = 72.0  # per inch
SETTINGS = {
    "svg.hashsalt": "mbd_sim",
    "svg.fonttype": "none",  # texts remain texts, which can be searched and edited
    "pdf.fonttype": 42,
    "path.simplify": False,
    "text.usetex": False,
}
METADATA = {
    ".png": {"Software": "mbd_sim"},
    ".svg": {"Date": None, "Creator": "mbd_sim"},
    ".pdf": {"CreationDate": None, "Creator": "mbd_sim", "Producer": None},
}


class DrawingError(MbdSimError):
    """A drawing cannot be written."""


def draw(mechanism: Mechanism, poses: Mapping[str, Pose], path: str | Path, *, title: str | None = None) -> None:
    """Draw a mechanism into a file, as PNG, SVG or PDF by its suffix.

    A planar mechanism is drawn in its plane, any other one obliquely from above.

    :param poses: the pose of each part in ground's frame in m, as from `Simulation.poses()`.
    :param title: a line above the drawing.
    :raises DrawingError: the suffix is another one, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise DrawingError(
            f"cannot draw {quoted(str(path))}: the suffix is {quoted(path.suffix) if path.suffix else 'missing'}. "
            f"Use a file name that ends in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}."
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
        figure.savefig(path, dpi=RESOLUTION, metadata=METADATA[path.suffix.lower()])


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
        add_picture(axes, picture)
        yield figure


def add_picture(axes: Any, picture: Composition, scale: float = 1.0) -> None:
    """Draw into axes of Matplotlib.

    :param scale: of lines and texts: the width of the axes relative to that of the picture.
    """
    axes.set_axis_off()
    axes.set_xlim(0.0, float(picture.size[0]))
    axes.set_ylim(0.0, float(picture.size[1]))
    for order, item in enumerate(picture.sheet.back_to_front()):
        axes.add_patch(_patch(item, order, scale))
    for text in picture.sheet.texts:
        _add_text(axes, text, len(picture.sheet.paths), scale)


def _patch(item: SheetPath, order: int, scale: float) -> Any:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    points = np.round(np.vstack([item.points, item.points[:1]]) if item.closed else item.points, 2)  # short SVG
    outline = Outline(points, closed=item.closed)
    dash = (0.0, tuple(length / item.width for length in item.dash)) if item.dash else "-"
    return PathPatch(
        outline,
        facecolor=_rgb(item.fill) if item.fill else "none",
        edgecolor=_rgb(item.edge) if item.edge else "none",
        linewidth=scale * item.width if item.edge else 0.0,
        linestyle=dash,
        capstyle="butt" if item.dash or item.width > 3.0 else "round",
        joinstyle="round",
        zorder=order,
        clip_on=False,
    )


def _add_text(axes: Any, text: SheetText, order: int, scale: float) -> None:
    """A text on a white halo, which is an outline, so that the text itself remains a text in SVG and PDF."""
    from matplotlib.patheffects import Stroke

    for effects in ([Stroke(linewidth=2.4 * scale, foreground="white")], []):
        axes.text(
            *text.at,
            text.text,
            fontsize=scale * text.size,
            fontfamily="DejaVu Sans",
            fontstyle="italic" if text.italic else "normal",
            color=_rgb(text.color),
            ha="center",
            va="center_baseline",
            zorder=order,
            parse_math=False,
            path_effects=effects,
        )


def _rgb(color: Color) -> tuple[float, float, float]:
    r, g, b = color
    return (r / 255.0, g / 255.0, b / 255.0)
