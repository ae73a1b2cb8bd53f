"""Mechanisms whose commanded drives let go: the positions that commands can bring about, as coordinates.

A drive that follows commands can be told to go to any position of its range. To search among these positions, its joint
is taken as one without a drive.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import Joint, Limits
from mbd_sim.mechanism.mechanism import Mechanism


class FreeDrives:
    """The kinematics of a mechanism with the joints of commanded drives as coordinates, within the ranges of these.

    Without such drives, they are those of the mechanism itself.
    """

    def __init__(self, driven: Kinematics) -> None:
        self.driven = driven
        self._drives = commanded_drives(driven.mechanism)
        self.kinematics = Kinematics(_released(driven.mechanism)) if self._drives else driven

    def released(self, q: Array) -> Array:
        """The coordinates with those of the drives, from those (nq,) of the mechanism itself."""
        if not self._drives:
            return q
        found = np.zeros(self.kinematics.layout.nq)
        for name, place in self.kinematics.layout.q.items():
            own = self.driven.layout.q[name]
            found[place] = q[self.driven.layout.drives[name].start] if name in self._drives else q[own]
        return found

    def commanded(self, q: Array) -> Array:
        """The coordinates (nq,) of the mechanism itself, with drives at rest, from those with the drives."""
        if not self._drives:
            return q
        found = np.zeros(self.driven.layout.nq)
        for name, place in self.kinematics.layout.q.items():
            if name in self._drives:
                found[self.driven.layout.drives[name].start] = q[place][0]
            else:
                found[self.driven.layout.q[name]] = q[place]
        return found


def _released(mechanism: Mechanism) -> Mechanism:
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
