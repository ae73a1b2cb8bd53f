"""Sheets of paper (ISO 216 and ANSI) and scales (ISO 5455)."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array

POINT = 72.0 / 25.4  # pt in a mm
SIZES = {  # mm, upright
    "A0": (841.0, 1189.0),
    "A1": (594.0, 841.0),
    "A2": (420.0, 594.0),
    "A3": (297.0, 420.0),
    "A4": (210.0, 297.0),
    "A5": (148.0, 210.0),
    "letter": (215.9, 279.4),
    "tabloid": (279.4, 431.8),
}
SCALES = (50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)


@dataclass(frozen=True)
class Paper:
    """A sheet: its name, `width` and `height` in mm."""

    name: str
    width: float
    height: float

    @property
    def size(self) -> Array:
        """Width and height (2,) in pt."""
        return np.array([self.width, self.height]) * POINT


def paper(text: str) -> Paper:
    """Read the name of a sheet, which lies flat unless `portrait` follows: `A4`, `A4 portrait`.

    :raises InputError: there is no such sheet.
    """
    name, _, way = text.strip().partition(" ")
    known = {one.casefold(): one for one in SIZES}
    if name.casefold() not in known or way.strip() not in ("", "portrait", "landscape"):
        raise InputError(f"there is no sheet '{text}'", f"{nearest(name, SIZES)} 'A4 portrait' stands upright.")
    name = known[name.casefold()]
    short, long = SIZES[name]
    return Paper(name, short, long) if way.strip() == "portrait" else Paper(name, long, short)


def scale(text: str) -> float:
    """Read a scale such as `1:5` or `2:1`.

    :raises InputError: it has another form.
    """
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*:\s*(\d+(?:\.\d+)?)\s*", text)
    if found is None or not float(found[1]) or not float(found[2]):
        raise InputError(f"'{text}' is not a scale", "Write for example 1:5, or 2:1.")
    return float(found[1]) / float(found[2])


def scale_text(value: float) -> str:
    """`1:5` of 0.2."""
    return f"{value:g}:1" if value >= 1.0 else f"1:{1.0 / value:g}"
