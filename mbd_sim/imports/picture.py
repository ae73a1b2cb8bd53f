"""A picture of an assembly that numbers the joints which its faces offer."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.imports.assembly import CadAssembly
from mbd_sim.imports.joints import Candidate, word_of
from mbd_sim.pictures.drawing.sheet import (
    AZIMUTH,
    ELEVATION,
    MARKS,
    Projection,
    ScaledView,
    Sheet,
    SheetPath,
    SheetText,
    place_labels,
)
from mbd_sim.pictures.shapes.meshes import coarsened
from mbd_sim.pictures.shapes.palette import from_hex

SIZE = 430.0  # pt, of the assembly
LEGEND = 250.0  # pt
LINE = 14.0  # pt, of the legend
MARGIN = 30.0  # pt
AXIS = 16.0  # pt, half the length of an axis on paper
MOST_TRIANGLES = 60_000  # of all parts together
GLASS = 0.13  # opacity of ground; the other parts are solid
LIGHT = np.array([-0.3, -0.6, 0.75]) / np.linalg.norm([-0.3, -0.6, 0.75])
COLORS = ("#8da0b3", "#c9a66b", "#88b07c", "#b98a9e", "#7fb0b5", "#b3a48d", "#9a94bd")
INK, ACCENT = "#2c323c", "#b3261e"


@interruptible()
def write_picture(
    path: Path, assembly: CadAssembly, candidates: Sequence[Candidate], glass: Collection[str], up: Array
) -> None:
    """Draw the parts, those of `glass` transparent, with the numbers of the joints; a legend names them.

    :param up: the unit vector (3,) that points upward on the picture.
    """
    page = _view(assembly, up)
    figure, axes, size = _figure(page, assembly, len(candidates))
    _add_parts(axes, page, assembly, glass)
    _add_numbers(axes, page, candidates)
    _add_legend(axes, candidates, size)
    figure.savefig(path, dpi=150)


def _view(assembly: CadAssembly, up: Array) -> ScaledView:
    """An oblique view, at the scale at which the assembly has its size."""
    side = np.eye(3)[(int(np.argmax(np.abs(up))) + 1) % 3]
    turned = np.column_stack([side, np.cross(up, side), up])  # from axes in which z points upward
    toward = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    view = Projection(turned @ right, turned @ np.cross(toward, right), turned @ toward, planar=False)
    corners = np.concatenate([part.triangles().reshape(-1, 3) for part in assembly.parts])
    spread = np.ptp(ScaledView(view, 1.0).project(corners), axis=0)
    return ScaledView(view, SIZE / max(float(spread.max()), 1e-12))


def _figure(page: ScaledView, assembly: CadAssembly, count: int) -> tuple[Any, Any, Array]:
    """A figure with axes in points; and the place (2,) of the legend."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    corners = np.concatenate([page.project(part.triangles()).reshape(-1, 2) for part in assembly.parts])
    low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
    height = max(float(high[1] - low[1]), LINE * (count + 2))
    middle = 0.5 * float(low[1] + high[1])
    left, right = float(low[0]), float(high[0]) + LEGEND
    figure = Figure(figsize=((right - left) / 72.0, height / 72.0), facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(left, right)
    axes.set_ylim(middle - 0.5 * height, middle + 0.5 * height)
    return figure, axes, np.array([float(high[0]), middle + 0.5 * height - 1.5 * LINE])


def _add_parts(axes: Any, page: ScaledView, assembly: CadAssembly, glass: Collection[str]) -> None:
    """The triangles of all parts, shaded, from back to front."""
    from matplotlib.collections import PolyCollection

    most = max(MOST_TRIANGLES // len(assembly.parts), 200)
    every, colors = [], []
    for number, part in enumerate(assembly.parts):
        triangles = coarsened(part.triangles(), most)
        edges = triangles[:, 1:] - triangles[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        seen = normals @ page.view.toward > 0.0
        own = next((placed.color for placed in part.bodies if placed.color), None) or COLORS[number % len(COLORS)]
        light = 0.62 + 0.38 * np.clip(normals[seen] @ LIGHT, 0.0, 1.0)
        shaded = np.array(from_hex(own)) / 255.0 * light[:, None]
        opacity = np.full((len(shaded), 1), GLASS if part.name in glass else 1.0)
        every.append(triangles[seen])
        colors.append(np.hstack([shaded, opacity]))
    triangles, shades = np.concatenate(every), np.concatenate(colors)
    order = np.argsort(triangles.mean(axis=1) @ page.view.toward, kind="stable")
    edges = shades[order] * [1.0, 1.0, 1.0, 0.0] + np.outer(shades[order, 3] == 1.0, [0.0, 0.0, 0.0, 1.0])  # no seams
    projected: Any = page.project(triangles[order])
    axes.add_collection(PolyCollection(projected, facecolors=shades[order], edgecolors=edges, linewidths=0.35))


def _add_numbers(axes: Any, page: ScaledView, candidates: Sequence[Candidate]) -> None:
    """The axis and the point of each joint, and its number beside it, clear of the others."""
    sheet = Sheet()
    for candidate in candidates:
        point = page.project(candidate.point)
        axes.plot(*point, marker="o", markersize=4.0, color=ACCENT, zorder=10)
        if candidate.axis is not None:
            along = AXIS * page.direction(candidate.axis)
            ends = np.array([point - along, point + along])
            axes.plot(*ends.T, color=ACCENT, linewidth=1.2, linestyle=(0, (7, 2, 1, 2)), zorder=10)
            sheet.add(SheetPath(ends, layer=MARKS))
    texts = [(SheetText(str(one.number), page.project(one.point), 10.0), float("inf")) for one in candidates]
    for candidate, text in zip(candidates, place_labels(sheet, texts), strict=True):
        point = page.project(candidate.point)
        axes.plot(*np.array([point, text.at]).T, color=ACCENT, linewidth=0.6, zorder=11)
        axes.text(
            *text.at, text.text, fontsize=9.0, color="white", ha="center", va="center", zorder=12,
            bbox={"boxstyle": "circle,pad=0.25" if len(text.text) < 2 else "round,pad=0.25,rounding_size=0.6",
                  "facecolor": ACCENT, "edgecolor": "white", "linewidth": 0.6},
        )  # fmt: skip


def _add_legend(axes: Any, candidates: Sequence[Candidate], top: Array) -> None:
    for row, candidate in enumerate(candidates):
        kind = word_of(candidate.type) if candidate.type else "choose"
        names = " – ".join(name if len(name) <= 18 else name[:17] + "…" for name in candidate.parts)
        place = top - np.array([0.0, LINE * row])
        axes.text(*place, f"{candidate.number}", fontsize=9.0, color=ACCENT, ha="right", va="center", weight="bold")
        axes.text(place[0] + 8.0, place[1], f"{names}: {kind}", fontsize=9.0, color=INK, va="center", parse_math=False)
