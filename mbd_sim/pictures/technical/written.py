"""A plan as a file, by its suffix."""

from __future__ import annotations

from pathlib import Path

from mbd_sim.base.errors import quoted
from mbd_sim.base.packages import require_packages
from mbd_sim.pictures.drawing.picture import FORMATS, DrawingError, write_picture
from mbd_sim.pictures.technical.dxf import write_plan
from mbd_sim.pictures.technical.plan import DrawingPlan

DXF = ".dxf"
SUFFIXES = (*FORMATS, DXF)


def draw_plan(plan: DrawingPlan, path: str | Path) -> None:
    """Write a plan: .svg, .pdf, .png or .dxf.

    :raises DrawingError: the suffix is another one, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise DrawingError(f"cannot draw {quoted(str(path))}", f"Use a file name that ends in {', '.join(SUFFIXES)}.")
    if path.suffix.lower() == DXF:
        write_plan(plan, path)
        return
    require_packages("matplotlib", purpose="A drawing")
    write_picture(plan.picture, path)
