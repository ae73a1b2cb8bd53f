"""Analysis of mechanisms whose drives are prescribed: positions, velocities, accelerations and loads without a run.

| module | contents |
|---|---|
| `system` | the driven coordinates and their ranges; the constraints with prescribed drives |
| `drive_line`, `curve` | continuation along the drives; dead points, change points, and how far a drive can go |
| `motion` | the motion through a range, of points, and of joints that close loops |
| `modes` | all configurations at given drives |
| `loads` | efforts and reactions by inverse dynamics; transmission angles |
| `extremes` | limit positions and extreme angles |
| `parametric`, `tolerances` | derivatives by parameters of the file; tolerances |
| `text`, `picture` | the results as columns, text and pictures |
"""

from __future__ import annotations

from mbd_sim.studies.kinematic_analysis.curve import ReachableRange, reachable_range
from mbd_sim.studies.kinematic_analysis.extremes import Extreme, limit_positions, transmission_extremes
from mbd_sim.studies.kinematic_analysis.loads import CouplerAndFollower, DriveLoads, couplers_and_followers, drive_loads
from mbd_sim.studies.kinematic_analysis.modes import AssemblyModes, assembly_modes
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion, PointMotion, SingularRow, driven_motion
from mbd_sim.studies.kinematic_analysis.parametric import MotionSensitivity, Sensitivity
from mbd_sim.studies.kinematic_analysis.system import UnreachableError
from mbd_sim.studies.kinematic_analysis.text import motion_columns
from mbd_sim.studies.kinematic_analysis.tolerances import Deviation, ToleranceAnalysis

__all__ = [
    "AssemblyModes",
    "CouplerAndFollower",
    "Deviation",
    "DriveLoads",
    "DrivenMotion",
    "Extreme",
    "MotionSensitivity",
    "PointMotion",
    "ReachableRange",
    "Sensitivity",
    "SingularRow",
    "ToleranceAnalysis",
    "UnreachableError",
    "assembly_modes",
    "couplers_and_followers",
    "drive_loads",
    "driven_motion",
    "limit_positions",
    "motion_columns",
    "reachable_range",
    "transmission_extremes",
]
