"""The strip below a drawing: the axes of ground, the direction of gravity, and a scale."""

from __future__ import annotations

import numpy as np

from mbd_sim.appearance.palette import (
    AXIS_X,
    AXIS_Y,
    AXIS_Z,
    mixed,
)
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.sheet import GRAY, INK, MARKS, Sheet, SheetPath, SheetText, arc, arrow_head
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import unit_or_zero

HEIGHT = 62.0  # pt
ARM = 30.0  # pt
SIZE = 10.5  # pt, of texts


def add_strip(sheet: Sheet, page: Page, gravity: Array, width: float) -> None:
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


def _add_axes(sheet: Sheet, page: Page, origin: Array) -> None:
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


def _add_gravity(sheet: Sheet, page: Page, gravity: Array, at: Array) -> None:
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


def _add_scale(sheet: Sheet, page: Page, right: Array, limit: float) -> None:
    length = nice_length(limit / page.scale)
    left = right - np.array([length * page.scale, 0.0])
    tick = np.array([0.0, 3.5])
    for line in ([left, right], [left - tick, left + tick], [right - tick, right + tick]):
        sheet.add(SheetPath(np.array(line), edge=GRAY, width=1.2, layer=MARKS))
    sheet.texts.append(SheetText(length_text(length), (left + right) / 2.0 + np.array([0.0, 9.0]), SIZE - 1.0, GRAY))
