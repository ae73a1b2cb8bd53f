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

QUANTITIES = ("position", "velocity", "acceleration")


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
    plain = [*motion.system.drives, *motion.outputs]
    for name in sorted(plain, key=lambda name: motion.names.index(name) if name in motion.names else len(plain)):
        unit, quantities = "rad" if motion.is_rotation(name) else "m", motion.coordinate(name)
        for quantity, suffix, numbers in zip(QUANTITIES, ("", "_s", "_s2"), quantities, strict=True):
            found[f"{name}.{quantity}_{unit}{suffix}"] = numbers
    for name, place in zip(motion.names, motion.columns, strict=True):
        if place < 0:
            found[f"{name}.velocity_rad_s"] = motion.u[:, motion.index(name)]
            found[f"{name}.acceleration_rad_s2"] = motion.u_rates[:, motion.index(name)]
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
    for name in motion.outputs:
        found[f"advantage.{name}"] = motion.advantage(name)
    return found if loads is None else found | _load_columns(motion, loads)


def grounded_outputs(motion: DrivenMotion) -> list[str]:
    """The outputs of joints with ground; all outputs if there are none."""
    joints = motion.mechanism.all_joints.values()
    on_ground = [joint for joint in joints if GROUND in (joint.parent, joint.child)]
    grounded = {name for joint in on_ground for name in (joint.name, *joint.motion_names)}
    return [name for name in motion.outputs if name in grounded] or list(motion.outputs)


def _load_columns(motion: DrivenMotion, loads: DriveLoads) -> dict[str, Array]:
    found = {}
    for name, effort in loads.efforts.items():
        found[f"{name}.effort_{'Nm' if is_rotation(motion.mechanism, name) else 'N'}"] = effort
    for name, reaction in loads.reactions.items():
        found[f"reaction.{name}.force_N"] = np.linalg.norm(reaction.force, axis=1)
        for quantity, values, unit in (("force", reaction.force, "N"), ("moment", reaction.moment, "Nm")):
            for index, axis in enumerate("xyz"):
                found[f"reaction.{name}.{quantity}_{axis}_{unit}"] = values[:, index]
    return {**found, "power_W": loads.power}
