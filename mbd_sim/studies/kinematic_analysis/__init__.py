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
