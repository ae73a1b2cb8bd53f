"""Curves and surfaces that points keep to, on the sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbd_sim.appearance.implicit_curves import (
    Wire,
    curve,
    section,
    surface,
)
from mbd_sim.appearance.palette import mixed
from mbd_sim.drawing.load_symbols import place
from mbd_sim.drawing.projection import Page, View
from mbd_sim.drawing.sheet import BACK, GREY, INK, STEEL, WHITE, Path
from mbd_sim.geometry.pose import Pose, identity_pose
from mbd_sim.mechanism.constraints import Surface
from mbd_sim.mechanism.records import GROUND, Mechanism


def wires_of(mechanism: Mechanism, poses: Mapping[str, Pose], view: View) -> list[Wire]:
    """The lines of all curves and surfaces, in ground's frame in m."""
    wires: list[Wire] = []
    for record in mechanism.constraints:
        if isinstance(record, Surface):
            point, carrier = place(poses, record.point), record.base.part
            turned = (identity_pose() if carrier == GROUND else poses[carrier]).rotation @ record.axes
            base = Pose(place(poses, record.base), turned)
            if len(record.equations) > 1:
                wires += curve(record, point, base)
            elif view.planar:
                wires += section(record, point, base, view.toward)
            else:
                wires += surface(record, point, base, view.toward)
    return wires


def wire_paths(page: Page, wires: Sequence[Wire]) -> list[Path]:
    """A curve as a wire, a surface as thin lines, paler on its far side."""
    paths: list[Path] = []
    for wire in sorted(wires, key=lambda wire: (wire.kind != "net", wire.front)):
        seen = page.at(wire.points)
        if wire.kind == "outline":
            paths.append(Path(seen, edge=GREY, width=1.3, layer=BACK))
        elif wire.kind == "net":
            paths.append(Path(seen, edge=STEEL if wire.front else mixed(STEEL, WHITE, 0.6), width=0.7, layer=BACK))
        else:
            paths += [Path(seen, edge=INK, width=3.2, layer=BACK), Path(seen, edge=STEEL, width=1.6, layer=BACK)]
    return paths
