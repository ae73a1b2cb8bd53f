"""Analysis of mechanisms whose drives are prescribed: positions, velocities, accelerations and loads without a run.

| module | contents |
|---|---|
| `prescribed_drives` | the driven coordinates and their ranges |
| `kinematic_system` | the constraints with prescribed drives: positions, velocities and accelerations |
| `drive_line`, `curve_tracing`, `singular_points` | continuation along the drives; dead points and change points |
| `driven_motion`, `point_motion` | the motion through a range, and of points |
| `assembly_modes`, `reach` | all configurations at given drives; how far a drive can go |
| `transmission`, `extremes`, `golden_section` | transmission angles; limit positions and extreme angles |
| `closing_joints` | angles and displacements of joints that close loops |
| `drive_loads` | efforts and reactions by inverse dynamics |
| `parametric_motion`, `sensitivity`, `tolerances` | derivatives by parameters of the file; tolerances |
| `motion_table`, `motion_text`, `motion_picture`, `accuracy_report` | the results as columns, text and pictures |
"""

from __future__ import annotations

from mbd_sim.kinematic_analysis.assembly_modes import AssemblyModes, assembly_modes
from mbd_sim.kinematic_analysis.drive_loads import DriveLoads, drive_loads
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion, SingularRow, driven_motion
from mbd_sim.kinematic_analysis.extremes import Extreme, limit_positions, transmission_extremes
from mbd_sim.kinematic_analysis.kinematic_system import UnreachableError
from mbd_sim.kinematic_analysis.motion_table import motion_columns
from mbd_sim.kinematic_analysis.point_motion import PointMotion
from mbd_sim.kinematic_analysis.reach import ReachableRange, reachable_range
from mbd_sim.kinematic_analysis.sensitivity import MotionSensitivity, Sensitivity
from mbd_sim.kinematic_analysis.tolerances import Deviation, ToleranceAnalysis
from mbd_sim.kinematic_analysis.transmission import CouplerAndFollower, couplers_and_followers

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
