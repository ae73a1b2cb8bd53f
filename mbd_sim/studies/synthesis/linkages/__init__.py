"""Planar linkages from their geometry: for poses of a body, dead centers and functions.

| module | contents |
|---|---|
| `dyads` | `PlanePose`, and the dyads that lead a body through two to five poses, by Burmester's theory |
| `four_bars` | linkages of two dyads: their motion, defects of order, branch and circuit, transmission angles |
| `poses` | `linkages_for_poses`: all dyads and the linkages of two of them, sorted |
| `dead_centers` | `crank_rockers` and `slider_cranks` for a swing or a stroke and a time ratio |
| `functions` | `function_four_bars`: followers that turn as a function of the crank |
| `mechanism_files` | linkages as mechanism files, and their check by moving them |
| `reports`, `pictures` | the results as text and pictures |
"""

from __future__ import annotations

from mbd_sim.studies.synthesis.linkages.dead_centers import crank_rockers, slider_cranks
from mbd_sim.studies.synthesis.linkages.dyads import Dyad, PlanePose
from mbd_sim.studies.synthesis.linkages.four_bars import PoseLinkage
from mbd_sim.studies.synthesis.linkages.functions import chebyshev_positions, function_four_bars
from mbd_sim.studies.synthesis.linkages.mechanism_files import pose_linkage_text, verified
from mbd_sim.studies.synthesis.linkages.pictures import draw_poses
from mbd_sim.studies.synthesis.linkages.poses import Given, PoseSolutions, Region, linkages_for_poses

__all__ = [
    "Dyad",
    "Given",
    "PlanePose",
    "PoseLinkage",
    "PoseSolutions",
    "Region",
    "chebyshev_positions",
    "crank_rockers",
    "draw_poses",
    "function_four_bars",
    "linkages_for_poses",
    "pose_linkage_text",
    "slider_cranks",
    "verified",
]
