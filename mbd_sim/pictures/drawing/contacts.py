"""Closed contacts on the sheet: a dot where they touch, a line along the normal, and an arrow for the force."""

from __future__ import annotations

import numpy as np

from mbd_sim.base.geometry.rotation import unit_or_zero
from mbd_sim.pictures.drawing.sheet import MARKS, WHITE, ScaledView, SheetPath, arc, arrow_head, outline_color
from mbd_sim.pictures.shapes.joints import LONG
from mbd_sim.pictures.shapes.palette import DRIVEN
from mbd_sim.pictures.shapes.touching import Touching

COLOR = outline_color(DRIVEN)
DOT, HEAD, WIDTH, NORMAL_WIDTH = 2.2, 7.0, 1.6, 0.8  # pt
SHORTEST = 3.0  # pt, of an arrow


def contact_paths(page: ScaledView, contacts: Touching, size: float, full: float) -> list[SheetPath]:
    """The symbols of the closed contacts of a mechanism.

    :param size: of the mechanism in m.
    :param full: the force in N whose arrow has full length; those of larger ones are as long, so that they stay on the
        sheet.
    """
    paths = [
        SheetPath(page.project(line), edge=COLOR, width=NORMAL_WIDTH, layer=MARKS)
        for line in contacts.normal_lines(size)
    ]
    for ends in contacts.arrows(size, full, longest=LONG):
        start, tip = map(page.project, ends)
        along, length = unit_or_zero(tip - start), float(((tip - start) ** 2).sum() ** 0.5)
        if length < SHORTEST:
            continue
        head = min(HEAD, 0.7 * length)
        paths += [
            SheetPath(np.array([start, tip - 0.6 * head * along]), edge=COLOR, width=WIDTH, layer=MARKS),
            arrow_head(tip, along, COLOR, head),
        ]
    for point in contacts.points:
        dot = arc(page.project(point), DOT, count=17)
        paths.append(SheetPath(dot, edge=WHITE, fill=COLOR, width=0.6, closed=True, layer=MARKS))
    return paths
