"""Drawings of mechanisms as PNG or SVG, in the style of textbook figures.

Importing this package does not import Matplotlib; drawing does. A picture is made in three steps: a `View` of the
mechanism is chosen, its lines and texts are laid out in points on a `Sheet`, and Matplotlib writes the sheet.

| module | contents |
|---|---|
| `picture` | `draw`: a drawing as a file, or as pixels |
| `composition`, `legend`, `label_placement` | the whole sheet; the strip below it; the placement of names |
| `projection`, `sheet` | the view, and the paths and texts it is drawn with |
| `part_outlines`, `shape_outlines` | parts and their shapes |
| `placed_joint`, `joint_symbols`, `slider_symbols`, `gear_symbols` | joints and couplings |
| `spring_symbols`, `load_symbols`, `constraint_symbols`, `curve_paths` | force elements, forces, constraints |
| `ground_symbols` | hatched lines, supports, bearings, walls |
| `animation` | frames of a mechanism in motion |
| `gallery` | the page of all shipped mechanisms |
"""

from __future__ import annotations

from mbd_sim.pictures.drawing.picture import DrawingError, draw

__all__ = ["DrawingError", "draw"]
