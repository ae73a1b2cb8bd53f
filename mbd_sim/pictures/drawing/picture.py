"""A drawing as a file or as pixels, rendered by Matplotlib; the same mechanism always gives the same file.

The layout puts the mechanism, its names and the legend at the scale at which they fit. A strip below the drawing shows
the axes of ground, the direction of gravity, and a scale.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError, quoted
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import unit_or_zero
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.packages import require_packages
from mbd_sim.mechanism.elements.parts import Part
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.constraints import constraint_curves, constraint_paths, curve_paths
from mbd_sim.pictures.drawing.contacts import contact_paths
from mbd_sim.pictures.drawing.forces import drive_paths, force_paths, two_point_paths
from mbd_sim.pictures.drawing.joints import carries_coordinate_only, joint_paths, label_point
from mbd_sim.pictures.drawing.parts import bounding_points, mass_center, part_paths, pin_bar_paths
from mbd_sim.pictures.drawing.sheet import (
    FRONT,
    GRAY,
    INK,
    MARKS,
    ScaledView,
    Sheet,
    SheetPath,
    SheetText,
    arc,
    arrow_head,
    outline_color,
    place_labels,
    view_of,
)
from mbd_sim.pictures.drawing.symbols import PlacedJoint, middle, place_joint
from mbd_sim.pictures.shapes.curves import CurveLine
from mbd_sim.pictures.shapes.joints import weight
from mbd_sim.pictures.shapes.palette import AXIS_X, AXIS_Y, AXIS_Z, Color, mixed, part_colors
from mbd_sim.pictures.shapes.solids import is_invisible
from mbd_sim.pictures.shapes.touching import NONE_TOUCHING, ForceScale, Touching

HEIGHT = 62.0  # pt
ARM = 30.0  # pt
SIZE = 10.5  # pt, of texts


def add_strip(sheet: Sheet, page: ScaledView, gravity: Array, width: float) -> None:
    """Add axes, gravity and scale in a strip from (0, 0) to (width, HEIGHT)."""
    _add_axes(sheet, page, np.array([26.0, 20.0]))
    _add_gravity(sheet, page, gravity, np.array([98.0, 24.0]))
    _add_scale(sheet, page, np.array([width - 14.0, 16.0]), limit=0.34 * width)


def nice_length(limit: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `limit`."""
    power = 10.0 ** np.floor(np.log10(limit))
    return float(power * max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= limit * (1.0 + 1e-9)))


def length_text(length: float) -> str:
    """A length in m with the unit in which it is shortest."""
    for unit_name, size in (("km", 1e3), ("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)):
        if length >= 0.999 * size:
            return f"{length / size:.6g} {unit_name}"
    return f"{length:.6g} m"


def _add_axes(sheet: Sheet, page: ScaledView, origin: Array) -> None:
    colors = [mixed(color, INK, 0.3) for color in (AXIS_X, AXIS_Y, AXIS_Z)]
    order = np.argsort(np.eye(3) @ page.view.toward)
    for index in order:
        projected = page.direction(np.eye(3)[index])
        label = "xyz"[index]
        if np.hypot(*projected) < 1e-6:
            _add_end_on(sheet, origin, float(page.view.toward[index]) > 0.0, colors[index])
            sheet.texts.append(SheetText(label, origin + np.array([-10.0, -8.0]), SIZE, colors[index], italic=True))
            continue
        tip = origin + ARM * projected
        sheet.add(
            SheetPath(
                np.array([origin, tip - 4.0 * unit_or_zero(projected)]), edge=colors[index], width=1.4, layer=MARKS
            )
        )
        sheet.add(arrow_head(tip, projected, colors[index]))
        sheet.texts.append(SheetText(label, tip + 8.0 * unit_or_zero(projected), SIZE, colors[index], italic=True))


def _add_gravity(sheet: Sheet, page: ScaledView, gravity: Array, at: Array) -> None:
    if not gravity.any():
        return
    projected = page.direction(unit_or_zero(gravity))
    if np.hypot(*projected) < 0.05:
        _add_end_on(sheet, at, float(gravity @ page.view.toward) > 0.0, INK)
        sheet.texts.append(SheetText("g", at + np.array([13.0, 1.0]), SIZE + 1.0, italic=True))
        return
    along = unit_or_zero(projected)
    start, tip = at - 17.0 * along, at + 17.0 * along
    sheet.add(SheetPath(np.array([start, tip - 5.0 * along]), width=1.8, layer=MARKS), arrow_head(tip, along, INK, 8.5))
    sheet.texts.append(SheetText("g", at + np.array([10.0, 3.0]), SIZE + 1.0, italic=True))


def _add_end_on(sheet: Sheet, at: Array, toward: bool, color: tuple[int, int, int]) -> None:
    """An arrow seen end-on: a dot where it points toward the viewer, a cross where it points away."""
    sheet.add(SheetPath(arc(at, 5.0), edge=color, fill=(255, 255, 255), width=1.2, closed=True, layer=MARKS))
    if toward:
        sheet.add(SheetPath(arc(at, 1.5), edge=None, fill=color, closed=True, layer=MARKS))
        return
    for angle in (0.25 * np.pi, 0.75 * np.pi):
        half = 5.0 * np.array([np.cos(angle), np.sin(angle)])
        sheet.add(SheetPath(np.array([at - half, at + half]), edge=color, width=1.0, layer=MARKS))


def _add_scale(sheet: Sheet, page: ScaledView, right: Array, limit: float) -> None:
    length = nice_length(limit / page.scale)
    left = right - np.array([length * page.scale, 0.0])
    tick = np.array([0.0, 3.5])
    for line in ([left, right], [left - tick, left + tick], [right - tick, right + tick]):
        sheet.add(SheetPath(np.array(line), edge=GRAY, width=1.2, layer=MARKS))
    sheet.texts.append(SheetText(length_text(length), (left + right) / 2.0 + np.array([0.0, 9.0]), SIZE - 1.0, GRAY))


MAX_SIZE = np.array([500.0, 400.0])  # pt, of the mechanism
MIN_WIDTH = 330.0  # pt, of the whole drawing
MAX_ENLARGEMENT = 1.5  # relative to the scale at which the mechanism alone would fill the drawing
MARGIN, TITLE = 16.0, 26.0  # pt
PART_NAME, JOINT_NAME = 10.0, 9.0  # pt
MAX_COVERED = 8.0  # cost up to which the name of a joint may cover lines


@dataclass(frozen=True, eq=False)
class Composition:
    """A finished sheet from (0, 0) to `size` (2,), in points."""

    sheet: Sheet
    size: Array


def compose(
    mechanism: Mechanism, poses: Mapping[str, Pose], title: str | None = None, contacts: Touching = NONE_TOUCHING
) -> Composition:
    """Lay out a mechanism at the poses of its parts, with its closed contacts."""
    view = view_of(mechanism, poses)
    curves = constraint_curves(mechanism, poses, view)
    spread = bounding_points(mechanism, poses) @ np.column_stack([view.right, view.up])
    size = max(float(np.max(np.ptp(spread, axis=0))), 0.0) or 1.0
    scale = float(np.min(MAX_SIZE)) / size
    for _ in range(5):  # lines and symbols have sizes in points, so that the scale is found by iteration
        sheet = mechanism_sheet(ScaledView(view, scale), mechanism, poses, size, curves)
        low, high = sheet.bounds()
        scale *= float(np.clip(np.min(MAX_SIZE / np.maximum(high - low, 1.0)), 0.2, 5.0))
        scale = min(scale, MAX_ENLARGEMENT * float(np.max(MAX_SIZE)) / size)  # the mechanism may be a single dot
    page = ScaledView(view, scale)
    sheet = mechanism_sheet(page, mechanism, poses, size, curves)
    force_scale = ForceScale(weight(mechanism, size))
    force_scale.add(contacts.forces)
    sheet.add(*contact_paths(page, contacts, size, force_scale.full))
    sheet.texts += place_labels(sheet, named_joints_and_parts(page, mechanism, poses, size))
    low, high = sheet.bounds()
    width = max(float((high - low)[0]) + 2.0 * MARGIN, MIN_WIDTH)
    base = HEIGHT + 0.5 * MARGIN
    sheet = sheet.translated(np.array([0.5 * width, base]) - [0.5 * (low + high)[0], low[1]])
    add_strip(sheet, page, mechanism.gravity, width)
    height = base + float((high - low)[1]) + MARGIN
    if title:
        sheet.texts.append(SheetText(title, np.array([0.5 * width, height + 0.25 * TITLE]), 13.0, INK))
        height += TITLE
    return Composition(sheet, np.ceil([width, height]))  # whole points keep SVG short


def mechanism_sheet(
    page: ScaledView,
    mechanism: Mechanism,
    poses: Mapping[str, Pose],
    size: float,
    curves: Sequence[CurveLine],
    start: Mapping[str, Pose] | None = None,
) -> Sheet:
    """The mechanism alone, without names.

    :param size: the length in m of the mechanism, to which the size of symbols is relative.
    :param start: the poses at which there is room for the supports of ground, which do not move, and to which its
        planes extend; by default the same.
    """
    sheet, colors = Sheet(), part_colors(mechanism)
    joints = [place_joint(page, mechanism, poses, joint) for joint in mechanism.all_joints.values()]
    if start is not None:
        joints = [_supported_as_at(start, page, mechanism, joint) for joint in joints]
    for name, part in mechanism.parts.items():
        sheet.add(*part_paths(page, mechanism, part, poses[name], colors[name]))
    sheet.add(*pin_bar_paths(page, mechanism, poses, colors))
    sheet.paths = [replace(path, group="PARTS") for path in sheet.paths]
    occupied = [np.mean(path.points[:-1], axis=0) for path in sheet.paths if path.particle]
    sheet.add(*curve_paths(page, curves))
    sheet.add(*two_point_paths(page, mechanism, poses), *constraint_paths(page, mechanism, poses, size, start))
    for joint in joints:
        sheet.add(*(replace(path, group="JOINTS") for path in joint_paths(page, joint, size)))
    if page.view.planar:
        sheet.paths = [_without_depth(path) for path in sheet.paths]
    round_joints = [joint for joint in joints if joint.joint.kind.keeps_point and joint.joint.kind.connects]
    occupied += [page.project(joint.carrier_frame.position) for joint in round_joints]  # hidden by their symbols
    for name, part in mechanism.parts.items():
        sheet.add(*mass_center(page, part, poses[name], occupied))
    sheet.add(*force_paths(page, mechanism, poses), *drive_paths(page, mechanism, poses))
    return sheet


def _supported_as_at(
    start: Mapping[str, Pose], page: ScaledView, mechanism: Mechanism, placed: PlacedJoint
) -> PlacedJoint:
    if not placed.grounded:
        return placed
    return replace(placed, support_direction=place_joint(page, mechanism, start, placed.joint).support_direction)


def _without_depth(path: SheetPath) -> SheetPath:
    """Without depth: in a planar view things lie in the order of the file, with particles, springs and pins on top."""
    return replace(path, depth=0.0, layer=FRONT if path.particle else path.layer)


def named_joints_and_parts(
    page: ScaledView, mechanism: Mechanism, poses: Mapping[str, Pose], size: float
) -> list[tuple[SheetText, float]]:
    """The names of the parts, and of the joints that move where there is room, each with the most it may cover.

    A joint that is called as one of its parts has no name of its own.
    """
    joints = [place_joint(page, mechanism, poses, joint) for joint in mechanism.all_joints.values()]
    colors, visible = part_colors(mechanism), [name for name, part in mechanism.parts.items() if not is_invisible(part)]
    names = [
        (
            SheetText(_spaced(name), _label_point(page, part, poses[name]), PART_NAME, outline_color(colors[name])),
            math.inf,
        )
        for name, part in mechanism.parts.items()
        if name in visible
    ]
    for joint in joints:
        own, parts = joint.joint.name, (joint.joint.inboard, joint.joint.outboard_part)
        if joint.joint.kind.connects and not carries_coordinate_only(joint) and not (own in visible and own in parts):
            at = page.project(label_point(page, joint, size))
            names.append((SheetText(_spaced(joint.joint.name), at, JOINT_NAME, GRAY, italic=True), MAX_COVERED))
    return names


def _label_point(page: ScaledView, part: Part, pose: Pose) -> Array:
    """The point (2,) on the sheet near which the name of a part is written; of a ring, a point on its rim."""
    if part.shapes and all(shape.kind == "ring" for shape in part.shapes):
        ring = pose @ part.shapes[0].pose
        circle = arc(np.zeros(2), part.shapes[0].size[0]) @ ring.rotation[:, :2].T
        projected = page.project(ring.position + circle)
        return np.asarray(projected[int(np.argmax(projected @ [0.6, 0.8]))])
    return page.project(pose.position + pose.rotation @ middle(part))


def _spaced(name: str) -> str:
    return name.replace("_", " ")


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


class DrawingError(InputError):
    """A drawing cannot be written."""


def draw(
    mechanism: Mechanism,
    poses: Mapping[str, Pose],
    path: str | Path,
    *,
    title: str | None = None,
    contacts: Touching = NONE_TOUCHING,
) -> None:
    """Draw a mechanism into a file, as PNG, SVG or PDF by its suffix.

    A planar mechanism is drawn in its plane, any other one obliquely from above.

    :param poses: the pose of each part in ground's frame in m, as from `Simulation.poses()`.
    :param title: a line above the drawing.
    :param contacts: that are closed, as from `mbd_sim.pictures.shapes.touching.touching`.
    :raises DrawingError: the suffix is another one, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise DrawingError(
            f"cannot draw {quoted(str(path))}: the suffix is {quoted(path.suffix) if path.suffix else 'missing'}",
            f"Use a file name that ends in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}.",
        )
    require_packages("matplotlib", purpose="A drawing")
    write_picture(compose(mechanism, poses, title, contacts), path)


@interruptible()
def write_picture(picture: Composition, path: Path) -> None:
    """Write a drawing by the suffix of the file.

    :raises DrawingError: it cannot be written.
    """
    try:
        path.open("ab").close()  # fails before Matplotlib is loaded
        with _figure(picture, RESOLUTION) as figure:
            figure.savefig(path, dpi=RESOLUTION, metadata=METADATA[path.suffix.lower()])
    except OSError as error:
        raise DrawingError(
            f"cannot write {quoted(str(path))}: {error.strerror or error}",
            "Choose a file in a folder that you may write to.",
        ) from error


@interruptible()
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
