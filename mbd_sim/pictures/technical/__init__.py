"""Drawings to scale on a sheet of paper, with dimensions and a title block, as SVG, PDF, PNG and DXF.

| module | contents |
|---|---|
| `paper` | sheets and scales |
| `dimensions` | lengths, offsets and angles: which ones, and how they are drawn |
| `plan` | the layout: mechanism, dimensions, names, frame and title block |
| `dxf` | a plan, or the paths of points, as DXF |
| `written` | a plan as a file |
"""

from __future__ import annotations

from mbd_sim.pictures.technical.dxf import write_curves
from mbd_sim.pictures.technical.plan import DrawingPlan, make_plan
from mbd_sim.pictures.technical.written import draw_plan

__all__ = ["DrawingPlan", "draw_plan", "make_plan", "write_curves"]
