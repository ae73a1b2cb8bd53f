"""A prescribed motion as columns of numbers with units in their names, like those of a recorded run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.drive_loads import DriveLoads
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion
from mbd_sim.kinematic_analysis.prescribed_drives import is_rotation
from mbd_sim.kinematic_analysis.transmission import CouplerAndFollower, TransmissionAngle
from mbd_sim.mechanism.records import GROUND


def motion_columns(
    motion: DrivenMotion,
    points: Sequence[str] = (),
    pins: Sequence[CouplerAndFollower] = (),
    loads: DriveLoads | None = None,
) -> dict[str, Array]:
    """The columns (n,): coordinates such as `crank.velocity_rad_s`, points such as `coupler.tip.x_m`, and the rest.

    `advantage.rocker` is the mechanical advantage of an undriven coordinate, in SI units of its effort over those of
    the drive's. nan where a number is undefined, as velocities are at dead points.
    """
    system, found = motion.system, dict[str, Array]({"time_s": motion.time})
    for name, column in zip(motion.names, motion.columns, strict=True):
        unit = "rad" if column < 0 or is_rotation(system.mechanism, name) else "m"
        index = motion.index(name)
        if column >= 0:
            found[f"{name}.position_{unit}"] = motion.q[:, column]
        found[f"{name}.velocity_{unit}_s"] = motion.u[:, index]
        found[f"{name}.acceleration_{unit}_s2"] = motion.u_rates[:, index]
    for name in points:
        point = motion.point(name)
        for prefix, values, unit in (
            ("", point.position, "m"),
            ("v", point.velocity, "m_s"),
            ("a", point.acceleration, "m_s2"),
        ):
            found |= {f"{name}.{prefix}{axis}_{unit}": values[:, index] for index, axis in enumerate("xyz")}
    for joints in pins:
        angle = TransmissionAngle(system, joints)
        found[f"transmission.{joints.pin}_rad"] = np.array([angle(q) for q in motion.q])
    for name in outputs(motion):
        found[f"advantage.{name}"] = motion.advantage(name)
    return found if loads is None else found | _load_columns(motion, loads)


def outputs(motion: DrivenMotion) -> list[str]:
    """The coordinates that follow the drives."""
    return [name for name in motion.names if name not in motion.system.drives]


def grounded_outputs(motion: DrivenMotion) -> list[str]:
    """Those of joints with ground; all of them if there are none."""
    joints = motion.mechanism.joints.values()
    grounded = {name for joint in joints if GROUND in (joint.parent, joint.child) for name in joint.motion_names}
    return [name for name in outputs(motion) if name in grounded] or outputs(motion)


def _load_columns(motion: DrivenMotion, loads: DriveLoads) -> dict[str, Array]:
    found = {}
    for name, effort in loads.efforts.items():
        found[f"{name}.effort_{'Nm' if is_rotation(motion.mechanism, name) else 'N'}"] = effort
    for name, reaction in loads.reactions.items():
        for quantity, values, unit in (("force", reaction.force, "N"), ("moment", reaction.moment, "Nm")):
            for index, axis in enumerate("xyz"):
                found[f"reaction.{name}.{quantity}_{axis}_{unit}"] = values[:, index]
    return {**found, "power_W": loads.power}
