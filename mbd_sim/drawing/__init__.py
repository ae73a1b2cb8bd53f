"""Pictures of mechanisms as PNG or SVG, in the manner of textbook figures.

Importing this package does not import Matplotlib; drawing does. A picture is made in three steps: the mechanism is
seen in a `View`, laid out as lines and texts in points on a `Sheet`, and written to a file by Matplotlib.
"""

from __future__ import annotations

from mbd_sim.drawing.picture import DrawingError, draw

__all__ = ["DrawingError", "draw"]
