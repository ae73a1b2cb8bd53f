"""Drawings and paths of points as DXF, by `ezdxf`: in mm, at true size, with the origin of ground at [0, 0].

Circles and arcs among the lines are found and written as such. Layers: `PARTS`, `JOINTS`, `FORCES`, `NAMES`,
`DIMENSIONS`, `SHEET` (the frame and the title block, at the size of the paper over the scale), and for each point of a
part one with its name, such as `coupler.tip`, from which a mechanism file can read the point again.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.picture import DrawingError
from mbd_sim.pictures.drawing.sheet import SheetPath, SheetText, view_of
from mbd_sim.pictures.technical.dimensions import DECIMALS, OFFSET, TEXT, Dimension
from mbd_sim.pictures.technical.paper import POINT
from mbd_sim.pictures.technical.plan import DrawingPlan
from mbd_sim.simulation.run.moving_points import points_of

LAYERS = {"PARTS": 7, "JOINTS": 8, "FORCES": 3, "NAMES": 5, "DIMENSIONS": 1, "SHEET": 9}  # with AutoCAD's colors
POINT_COLOR = 6
ROUND = 1e-6  # relative to its radius, how exactly the points of a circle must lie on it
FEWEST = 9  # points of a circle or an arc
MM = 4  # $INSUNITS


def write_plan(plan: DrawingPlan, path: Path) -> None:
    """Write a plan.

    :raises DrawingError: the file cannot be written.
    :raises MissingPackageError: `ezdxf` is not installed.
    """
    document = _new()
    for name, color in LAYERS.items():
        document.layers.add(name, color=color)
    space, size = document.modelspace(), 1e3 / plan.page.scale  # mm for each pt
    measured = {id(one) for one in plan.content.texts}
    for item in plan.content.back_to_front():
        if item.group != "DIMENSIONS":
            _add_path(space, item, np.zeros(2), size, item.group or "FORCES")
    for text in plan.names:
        _add_text(space, text, np.zeros(2), size, "NAMES")
    border = plan.picture.sheet
    count = len(plan.content.paths)
    for item in border.paths[count:]:
        _add_path(space, item, -plan.origin, size, "SHEET")
    for text in border.texts[len(measured) + len(plan.names) :]:
        _add_text(space, text, -plan.origin, size, "SHEET")
    for dimension, at in plan.dimensions:
        _add_dimension(space, dimension, at * size, size)
    for part, points in points_of(plan.mechanism).items():
        for point in points:
            name = f"{part}.{point}"
            document.layers.add(name, color=POINT_COLOR)
            space.add_point(tuple(1e3 * plan.places(name)), dxfattribs={"layer": name})
    document.header["$PDMODE"], document.header["$PDSIZE"] = 3, 3.0 * POINT * size
    _save(document, path)


def _new() -> Any:
    require_packages("ezdxf", purpose="A DXF drawing")
    import ezdxf

    document = ezdxf.new("R2010", setup=True)  # type: ignore[attr-defined]
    document.units = MM
    document.header["$MEASUREMENT"] = 1
    return document


def _save(document: Any, path: Path) -> None:
    try:
        document.saveas(path)
    except OSError as error:
        remedy = "Choose a file in a folder that you may write to."
        raise DrawingError(f"cannot write {quoted(str(path))}: {error.strerror or error}", remedy) from error


def _add_path(space: Any, item: SheetPath, shift: Array, size: float, layer: str) -> None:
    """A circle, an arc, a filled area, or a polyline."""
    points = (item.points + shift) * size
    attributes = {"layer": layer, **({"linetype": "DASHED"} if item.dash else {})}
    if item.edge is None:
        if item.fill is not None and item.fill != (255, 255, 255):
            hatch = space.add_hatch(dxfattribs={"layer": layer})
            hatch.paths.add_polyline_path([tuple(point) for point in points], is_closed=True)
        return
    found = circle_of(points)
    if found is None:
        space.add_lwpolyline([tuple(point) for point in points], close=item.closed, dxfattribs=attributes)
        return
    center, radius, first, last = found
    if item.closed or abs(abs(last - first) - 2.0 * np.pi) < ROUND:
        space.add_circle(tuple(center), radius, dxfattribs=attributes)
    else:
        low, high = sorted((first, last))
        space.add_arc(tuple(center), radius, np.degrees(low), np.degrees(high), dxfattribs=attributes)


def circle_of(points: Array) -> tuple[Array, float, float, float] | None:
    """The center, radius and both angles in rad of points (n, 2) along a circle; None if they are not on one."""
    if len(points) < FEWEST:
        return None
    offsets = points - points.mean(axis=0)
    scale = float(np.max(np.abs(offsets))) or 1.0
    offsets = offsets / scale
    matrix = np.column_stack([2.0 * offsets, np.ones(len(offsets))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, np.sum(offsets**2, axis=1), rcond=1e-9)
    if rank < 3:
        return None
    center = solution[:2]
    radii = np.hypot(*(offsets - center).T)
    radius = float(radii.mean())
    angles = np.unwrap(np.arctan2(*(offsets - center).T[::-1]))
    steps = np.diff(angles)
    if (
        np.ptp(radii) > ROUND * radius
        or radius > 100.0
        or np.max(np.abs(steps)) > 0.6
        or np.any(steps * steps[0] < 0.0)
    ):
        return None
    return points.mean(axis=0) + scale * center, scale * radius, float(angles[0]), float(angles[-1])


def _add_text(space: Any, text: SheetText, shift: Array, size: float, layer: str) -> None:
    from ezdxf.enums import TextEntityAlignment

    height = 0.72 * text.size * size  # of capitals
    added = space.add_text(text.text, height=height, dxfattribs={"layer": layer, "style": "OpenSans"})
    added.set_placement(tuple((text.at + shift) * size), align=TextEntityAlignment.MIDDLE_CENTER)


def _add_dimension(space: Any, dimension: Dimension, at: Array, size: float) -> None:
    """A dimension that measures itself; `at` (2,) is a point on its line, in mm."""
    style = {"dimtxt": 0.72 * TEXT * size, "dimasz": 6.0 * size, "dimexe": 4.0 * size, "dimexo": 3.0 * size,
             "dimgap": 2.0 * size, "dimdec": DECIMALS, "dimzin": 8, "dimadec": DECIMALS, "dimazin": 2, "dimlfac": 1.0,
             "dimtad": 0, "dimclrt": 1, "dimclrd": 1, "dimclre": 1}  # fmt: skip
    points = [tuple(1e3 * point) for point in dimension.points]
    further: dict[str, Any] = {"override": style, "dxfattribs": {"layer": "DIMENSIONS"}}
    match dimension.kind:
        case "angle":
            first, last = (1e3 * dimension.points[1] + np.array([np.cos(a), np.sin(a)]) for a in dimension.directions)
            added = space.add_angular_dim_3p(at, points[1], tuple(first), tuple(last), dimstyle="EZ_CURVED", **further)
        case "length":
            along = 1e3 * (dimension.points[1] - dimension.points[0])
            upward = along[0] > 0.0 or (along[0] == 0.0 and along[1] > 0.0)
            if not upward:  # the text along the line would stand on its head
                points, along = points[::-1], -along
            normal = np.array([-along[1], along[0]]) / np.hypot(*along)
            distance = float(normal @ (at - np.array(points[0])))
            distance = distance or OFFSET * size
            added = space.add_aligned_dim(points[0], points[1], distance, dimstyle="EZDXF", **further)
        case _:
            turn = 0.0 if dimension.kind == "x" else 90.0
            added = space.add_linear_dim(tuple(at), points[0], points[1], angle=turn, dimstyle="EZDXF", **further)
    added.render()


def write_curves(path: str | Path, mechanism: Mechanism, poses: Mapping[str, Any], curves: Mapping[str, Array]) -> None:
    """Write the paths (n, 3) of points in m, each on the layer of its name.

    They are in the plane of a planar mechanism, and in space otherwise. A path that returns to its start is closed.

    :raises DrawingError: the file cannot be written.
    :raises MissingPackageError: `ezdxf` is not installed.
    """
    document = _new()
    space, view = document.modelspace(), view_of(mechanism, poses)
    axes = np.column_stack([view.right, view.up])
    for name, curve in curves.items():
        document.layers.add(name)
        closed = bool(np.hypot(*np.ptp(curve[[0, -1]], axis=0)[:2]) < 1e-9 and np.ptp(curve) > 0.0)
        kept = 1e3 * (curve[:-1] if closed else curve)
        if view.planar:
            flat = [tuple(point) for point in kept @ axes]
            space.add_lwpolyline(flat, close=closed, dxfattribs={"layer": name})
        else:
            space.add_polyline3d([tuple(point) for point in kept], close=closed, dxfattribs={"layer": name})
    _save(document, Path(path))
