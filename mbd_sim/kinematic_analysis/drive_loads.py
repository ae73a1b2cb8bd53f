"""The efforts of the drives and the loads on the joints in a prescribed motion, by inverse dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbd_sim.analysis.inverse_dynamics import InverseDynamics
from mbd_sim.analysis.load_sharing import LoadSharing
from mbd_sim.dynamics.equations import derive
from mbd_sim.geometry.pose import Array
from mbd_sim.interrupts import interruptible_tracing
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion
from mbd_sim.mechanism.one_sided import require_two_sided
from mbd_sim.short_repr import short_repr
from mbd_sim.simulation.state_records import Reaction


@dataclass(frozen=True, eq=False)
class DriveLoads:
    """What a motion requires, one row for each configuration; nan at dead points and change points.

    `efforts` (n,) of each driven coordinate in N·m or N. `reactions` are the `force` (n, 3) in N and the `moment`
    (n, 3) in N·m that each joint transmits to its second part, about its point there, in ground's axes; the effort of a
    drive is part of that of its joint, see `Reaction`. `power` (n,) is that of all drives in W.
    """

    efforts: Mapping[str, Array]
    reactions: Mapping[str, Reaction]
    power: Array

    __repr__ = short_repr


@interruptible_tracing()
def drive_loads(motion: DrivenMotion) -> DriveLoads:
    """The loads of a motion with its speeds and accelerations: inertia, weight, springs, dampers and applied forces.

    Forces that depend on time take the time of the motion. Efforts follow from virtual power along the motion, and
    reactions from the multipliers of the constraints, see `InverseDynamics` and `LoadSharing`.

    :raises MechanismError: the mechanism has no equations of motion, because a part has no mass, or it has one-sided
        elements.
    """
    system, mechanism = motion.system, motion.mechanism
    require_two_sided(mechanism, "has no loads that follow from its motion")
    equations = derive(mechanism)
    inverse, sharing = InverseDynamics(mechanism, system.drives, equations), LoadSharing(mechanism, equations)
    inputs = equations.inputs_without_commands
    names = [*mechanism.joints, *mechanism.closing]
    efforts = np.full((len(motion), len(system.drives)), np.nan)
    loads = np.full((len(motion), len(names), 6), np.nan)
    for row in np.flatnonzero(np.all(np.isfinite(motion.u), axis=1)):
        q, u, time = motion.q[row], motion.u[row], float(motion.time[row])
        found = inverse(q, u, motion.u_rates[row], time)
        efforts[row] = found[system.u_driven]
        given = inputs.copy()
        given[equations.inputs.efforts] = found - inverse.efforts_of_actuators(q, u, time, inputs)
        loads[row] = sharing.reactions(time, inverse.state(q, u), given)
    return DriveLoads(
        dict(zip(system.drives, efforts.T, strict=True)),
        {name: Reaction(loads[:, index, :3], loads[:, index, 3:]) for index, name in enumerate(names)},
        np.sum(efforts * motion.u[:, system.u_driven], axis=1),
    )
