"""Curves and surfaces on which points are constrained to lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbd_sim.appearance.implicit_curves import (
    CurveLine,
    curve_lines,
    section_lines,
    surface_lines,
)
from mbd_sim.appearance.palette import mixed
from mbd_sim.drawing.load_symbols import point_of
from mbd_sim.drawing.projection import Page, View
from mbd_sim.drawing.sheet import BACK, GRAY, INK, STEEL, WHITE, SheetPath
from mbd_sim.geometry.pose import Pose, identity_pose
from mbd_sim.mechanism.constraints import Surface
from mbd_sim.mechanism.records import GROUND, Mechanism


def constraint_curves(mechanism: Mechanism, poses: Mapping[str, Pose], view: View) -> list[CurveLine]:
    """The lines of all curves and surfaces, in ground's frame in m."""
    curves: list[CurveLine] = []
    for record in mechanism.constraints:
        if isinstance(record, Surface):
            point, carrier_frame = point_of(poses, record.point), record.base.part
            turned = (identity_pose() if carrier_frame == GROUND else poses[carrier_frame]).rotation @ record.axes
            base = Pose(point_of(poses, record.base), turned)
            if len(record.equations) > 1:
                curves += curve_lines(record, point, base)
            elif view.planar:
                curves += section_lines(record, point, base, view.toward)
            else:
                curves += surface_lines(record, point, base, view.toward)
    return curves


def curve_paths(page: Page, curves: Sequence[CurveLine]) -> list[SheetPath]:
    """A curve as a wire, a surface as thin lines, paler on its far side."""
    paths: list[SheetPath] = []
    for curve in sorted(curves, key=lambda curve: (curve.kind != "net", curve.front)):
        projected = page.project(curve.points)
        if curve.kind == "outline":
            paths.append(SheetPath(projected, edge=GRAY, width=1.3, layer=BACK))
        elif curve.kind == "net":
            paths.append(
                SheetPath(projected, edge=STEEL if curve.front else mixed(STEEL, WHITE, 0.6), width=0.7, layer=BACK)
            )
        else:
            paths += [
                SheetPath(projected, edge=INK, width=3.2, layer=BACK),
                SheetPath(projected, edge=STEEL, width=1.6, layer=BACK),
            ]
    return paths
