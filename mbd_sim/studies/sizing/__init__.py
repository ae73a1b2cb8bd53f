"""Sizing of drives: motors, gears, flywheels and balancing springs for a motion and its loads.

| module | contents |
|---|---|
| `samples` | functions of time by their samples: integrals, derivatives, positive parts, with jumps |
| `laws` | how a drive moves through its range: at constant speed, trapezoidal, sinusoidal, by polynomials |
| `cycle` | what a drive or a joint does over time: `LoadCycle`, from a prescribed motion, from arrays or from a table |
| `catalog` | motors and gears as data, from YAML or CSV files; the generic ones that are shipped |
| `duty` | a motor with a gear in a cycle: torque, current, voltage, losses, temperature, energies, limits |
| `gears` | the gear of least RMS torque |
| `flywheel`, `springs` | the flywheel for a coefficient of speed fluctuation; balancing springs |
| `text`, `picture` | the results as text, columns and pictures |
"""

from __future__ import annotations

from mbd_sim.studies.sizing.catalog import Catalog, GearType, MotorType, read_catalog, shipped_catalog
from mbd_sim.studies.sizing.cycle import LoadCycle, drive_cycles, read_cycle
from mbd_sim.studies.sizing.duty import MotorDuty, motor_duty
from mbd_sim.studies.sizing.flywheel import Flywheel, flywheel
from mbd_sim.studies.sizing.gears import best_ratio
from mbd_sim.studies.sizing.laws import MotionLaw, constant_speed, motion_law
from mbd_sim.studies.sizing.springs import BalancingSpring, balancing_spring, spring_between

__all__ = [
    "BalancingSpring",
    "Catalog",
    "Flywheel",
    "GearType",
    "LoadCycle",
    "MotionLaw",
    "MotorDuty",
    "MotorType",
    "balancing_spring",
    "best_ratio",
    "constant_speed",
    "drive_cycles",
    "flywheel",
    "motion_law",
    "motor_duty",
    "read_catalog",
    "read_cycle",
    "shipped_catalog",
    "spring_between",
]
