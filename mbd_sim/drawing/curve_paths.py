"""Curves and surfaces on which points are constrained to lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import assert_never

import numpy as np

from mbd_sim.appearance.implicit_curves import CurveLine, curve_lines, section_lines, surface_lines
from mbd_sim.appearance.palette import mixed
from mbd_sim.drawing.load_symbols import point_of
from mbd_sim.drawing.projection import Page, View
from mbd_sim.drawing.sheet import BACK, GRAY, INK, STEEL, WHITE, SheetPath
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.constraints import Surface
from mbd_sim.mechanism.records import GROUND, Mechanism


def constraint_curves(mechanism: Mechanism, poses: Mapping[str, Pose], view: View) -> list[CurveLine]:
    """The lines of all curves and surfaces, in ground's frame in m."""
    curves: list[CurveLine] = []
    for constraint in mechanism.constraints:
        if isinstance(constraint, Surface):
            point, carrier = point_of(poses, constraint.point), constraint.base.part
            rotation = np.eye(3) if carrier == GROUND else poses[carrier].rotation
            base = Pose(point_of(poses, constraint.base), rotation @ constraint.axes)
            if len(constraint.equations) > 1:
                curves += curve_lines(constraint, point, base)
            elif view.planar:
                curves += section_lines(constraint, point, base, view.toward)
            else:
                curves += surface_lines(constraint, point, base, view.toward)
    return curves


def curve_paths(page: Page, curves: Sequence[CurveLine]) -> list[SheetPath]:
    """A curve as a wire, a surface as thin lines, paler on its far side."""
    paths: list[SheetPath] = []
    for curve in sorted(curves, key=lambda curve: (curve.kind != "net", curve.front)):
        points = page.project(curve.points)
        match curve.kind:
            case "outline":
                paths.append(SheetPath(points, edge=GRAY, width=1.3, layer=BACK))
            case "net":
                color = STEEL if curve.front else mixed(STEEL, WHITE, 0.6)
                paths.append(SheetPath(points, edge=color, width=0.7, layer=BACK))
            case "curve":
                paths.append(SheetPath(points, edge=INK, width=3.2, layer=BACK))
                paths.append(SheetPath(points, edge=STEEL, width=1.6, layer=BACK))
            case _:
                assert_never(curve.kind)
    return paths
