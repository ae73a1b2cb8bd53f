"""Mechanisms whose commanded drives let go: the positions that commands can bring about, as coordinates.

A drive that follows commands can be told to go to any position of its range. To search among these positions, its joint
is taken as one without a drive.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.layouts.vectors import CoordinateLayout
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import Joint, Limits
from mbd_sim.mechanism.mechanism import Mechanism


@dataclass(frozen=True)
class FreeDrives:
    """Coordinates of a mechanism and of the same with free drives, by their layouts."""

    driven: CoordinateLayout
    free: CoordinateLayout

    def released(self, q: Array) -> Array:
        """The coordinates with those of the drives, from those (nq,) of the mechanism itself."""
        found = np.zeros(self.free.nq)
        for name, place in self.free.q.items():
            drive = self.driven.drives.get(name)
            found[place] = q[self.driven.q[name]] if drive is None else q[drive.start]
        return found

    def commanded(self, q: Array) -> Array:
        """The coordinates (nq,) of the mechanism itself, with drives at rest, from those with the drives."""
        found = np.zeros(self.driven.nq)
        for name, place in self.free.q.items():
            drive = self.driven.drives.get(name)
            if drive is None:
                found[self.driven.q[name]] = q[place]
            else:
                found[drive.start] = q[place][0]
        return found


def with_free_drives(mechanism: Mechanism) -> Mechanism:
    """The mechanism with the joints of commanded drives as free ones, within the ranges of these."""
    joints = {name: _without_commanded_drive(joint) for name, joint in mechanism.joints.items()}
    return replace(mechanism, joints=joints)


def _without_commanded_drive(joint: Joint) -> Joint:
    drive = joint.drive
    if not isinstance(drive, CommandedDrive):
        return joint
    return replace(
        joint,
        drive=(),
        position=np.array([drive.start]),
        velocity=np.zeros(1),
        stiffness=np.zeros(1),
        rest=np.zeros(1),
        damping=np.zeros(1),
        limits=(Limits(drive.lower, drive.upper),),
        fixed_in_assembly=(True,),
        fixed_speeds=(True,),
    )
