"""Drawings of mechanisms as PNG or SVG, in the style of textbook figures.

Importing this package does not import Matplotlib; drawing does. A picture is made in three steps: a `View` of the
mechanism is chosen, its lines and texts are laid out in points on a `Sheet`, and Matplotlib writes the sheet.

| module | contents |
|---|---|
| `picture` | `draw`: a drawing as a file, or as pixels; the whole sheet with its legend |
| `sheet` | the view, the paths and texts it is drawn with, the placement of names |
| `outlines`, `mesh_outlines` | parts and their shapes |
| `joints` | joints |
| `symbols` | springs, ropes, hatched lines, supports, bearings, walls |
| `forces`, `constraints`, `contacts` | forces and drives; constraints and gears; closed contacts |
| `animation` | frames of a mechanism in motion |
"""

from __future__ import annotations

from mbd_sim.pictures.drawing.picture import DrawingError, draw

__all__ = ["DrawingError", "draw"]
