"""A mechanism to scale on a sheet of paper, with dimensions, names, a frame and a title block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.constraints import constraint_curves
from mbd_sim.pictures.drawing.parts import bounding_points
from mbd_sim.pictures.drawing.picture import (
    HEIGHT,
    Composition,
    add_strip,
    mechanism_sheet,
    named_joints_and_parts,
)
from mbd_sim.pictures.drawing.sheet import INK, MARKS, ScaledView, Sheet, SheetPath, SheetText, place_labels, view_of
from mbd_sim.pictures.technical.dimensions import AUTO, Dimension, DimensionLines, Places, automatic, dimension_of
from mbd_sim.pictures.technical.paper import POINT, SCALES, Paper, paper, scale, scale_text

MARGIN = 10.0  # mm, from the edge of the sheet to the frame
BLOCK = (95.0, 22.0)  # mm, of the title block
SPARE = 6.0  # mm, between the frame and what is drawn


@dataclass(frozen=True, eq=False)
class DrawingPlan:
    """A finished drawing: `picture` is the sheet of paper in pt, `content` what is drawn to scale, without names.

    `origin` (2,) in pt is the place on the paper of the origin of ground; `page` projects and scales. `dimensions` are
    those that are drawn, each with a point (2,) on its line, in pt from the origin.
    """

    mechanism: Mechanism
    paper: Paper
    scale: float
    picture: Composition
    page: ScaledView
    origin: Array
    content: Sheet
    names: Sequence[SheetText]
    dimensions: Sequence[tuple[Dimension, Array]]
    places: Places


def make_plan(
    mechanism: Mechanism,
    poses: Mapping[str, Pose],
    *,
    sheet: str = "A4",
    at_scale: str = "",
    dimensions: Sequence[str] = (),
    title: str = "",
) -> DrawingPlan:
    """Lay out a drawing.

    :param poses: the pose of each part in ground's frame in m, as from `Simulation.poses()`.
    :param sheet: its name, such as `A3` or `A4 portrait`.
    :param at_scale: such as `1:5`; by default the largest of the usual ones at which everything fits.
    :param dimensions: what is dimensioned, see `dimension_of`; `auto` stands for those of links and supports.
    :param title: in the title block; by default the name of the mechanism.
    :raises InputError: the drawing does not fit the sheet, or there is no such sheet, scale or point.
    """
    chosen = paper(sheet)
    places = Places(mechanism, poses, view_of(mechanism, poses))
    wanted = [
        one for text in dimensions for one in ([dimension_of(text, places)] if text != AUTO else automatic(places))
    ]
    room = np.array([chosen.width - 2.0 * (MARGIN + SPARE), chosen.height - 2.0 * (MARGIN + SPARE) - BLOCK[1]]) * POINT
    for value in [scale(at_scale)] if at_scale else SCALES:
        plan = _plan(mechanism, poses, chosen, value, places, wanted, title or mechanism.name)
        low, high = _bounds(plan)
        if np.all(high - low <= room):
            return plan
    need = (high - low) / POINT
    message = (
        f"the drawing needs {need[0]:.0f} x {need[1]:.0f} mm at {scale_text(value)}, and {chosen.name} has room for"
    )
    raise InputError(
        f"{message} {room[0] / POINT:.0f} x {room[1] / POINT:.0f} mm", "Choose a larger sheet, or another scale."
    )


def _bounds(plan: DrawingPlan) -> tuple[Array, Array]:
    return Sheet(list(plan.content.paths), [*plan.content.texts, *plan.names]).bounds()


def _plan(
    mechanism: Mechanism,
    poses: Mapping[str, Pose],
    chosen: Paper,
    value: float,
    places: Places,
    wanted: Sequence[Dimension],
    title: str,
) -> DrawingPlan:
    """The drawing at a scale, whether or not it fits."""
    page = ScaledView(places.view, 1e3 * POINT * value)
    axes = np.column_stack([page.view.right, page.view.up])
    size = max(float(np.max(np.ptp(bounding_points(mechanism, poses) @ axes, axis=0))), 0.0) or 1.0
    content = mechanism_sheet(page, mechanism, poses, size, constraint_curves(mechanism, poses, page.view))
    lines = DimensionLines(page, *content.bounds())
    for dimension in wanted:
        lines.add(dimension)
    content.paths += [replace(path, group="DIMENSIONS") for path in lines.sheet.paths]
    content.texts += lines.sheet.texts
    names = place_labels(content, named_joints_and_parts(page, mechanism, poses, size))
    low, high = Sheet(list(content.paths), [*content.texts, *names]).bounds()
    middle = 0.5 * chosen.size + np.array([0.0, 0.5 * BLOCK[1] * POINT])
    origin = middle - 0.5 * (low + high)
    whole = Sheet(list(content.paths), [*content.texts, *names]).translated(origin)
    border = _border(chosen, page, mechanism, title, value)
    whole.paths += border.paths
    whole.texts += border.texts
    picture = Composition(whole, chosen.size)
    return DrawingPlan(mechanism, chosen, value, picture, page, origin, content, names, lines.placed, places)


def _border(chosen: Paper, page: ScaledView, mechanism: Mechanism, title: str, value: float) -> Sheet:
    """The frame, the title block at the lower right, and axes, gravity and a scale at the lower left."""
    low, high = MARGIN * POINT * np.ones(2), chosen.size - MARGIN * POINT
    block = np.array([high[0] - BLOCK[0] * POINT, low[1]])
    top = low[1] + BLOCK[1] * POINT
    sheet = Sheet()
    add_strip(sheet, page, mechanism.gravity, max(block[0] - low[0] - 10.0, 200.0))
    strip = sheet.translated(low + np.array([2.0, 0.5 * (BLOCK[1] * POINT - HEIGHT)]))
    found = Sheet([*strip.paths], [*strip.texts])
    frame = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    found.add(SheetPath(frame, edge=INK, width=1.4, closed=True, layer=MARKS))
    row = low[1] + 8.0 * POINT
    middle = block[0] + 0.62 * BLOCK[0] * POINT
    for line in ([block, [block[0], top]], [[block[0], top], [high[0], top]], [[block[0], row], [high[0], row]],
                 [[middle, low[1]], [middle, row]]):  # fmt: skip
        found.add(SheetPath(np.array(line), edge=INK, width=0.8, layer=MARKS))
    center = 0.5 * (block[0] + high[0])
    below = _fitting(mechanism.description, BLOCK[0] * POINT - 8.0, 8.0) if mechanism.description else None
    found.texts.append(SheetText(title, np.array([center, top - (5.0 if below else 7.0) * POINT]), 12.0))
    if below:
        found.texts.append(SheetText(below, np.array([center, row + 3.2 * POINT]), 8.0))
    source = _fitting(Path(mechanism.source.file).name or "mbd_sim", 0.62 * BLOCK[0] * POINT - 6.0, 8.0)
    found.texts.append(SheetText(source, np.array([0.5 * (block[0] + middle), low[1] + 4.0 * POINT]), 8.0))
    about = f"{scale_text(value)}   {chosen.name}   mm"
    found.texts.append(SheetText(about, np.array([0.5 * (middle + high[0]), low[1] + 4.0 * POINT]), 9.0))
    return found


def _fitting(text: str, width: float, size: float) -> str:
    """The text, cut where it is wider than this, in pt."""
    most = max(int(width / (0.61 * size)), 4)
    return text if len(text) <= most else f"{text[: most - 1].rstrip()}…"
