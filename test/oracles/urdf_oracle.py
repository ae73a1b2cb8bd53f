"""Pinocchio as an oracle for mechanisms read from a URDF."""

import re

import numpy as np

from mbd_sim.base.geometry.rotation import from_quaternion


class Oracle:
    """A URDF's text as a Pinocchio model whose joints correspond to ours by name.

    With `free` the root link moves on a free-flyer joint that Pinocchio adds. Otherwise a free root link, if any, has a
    floating joint in the URDF.
    """

    def __init__(self, pin, text, mechanism, free):
        self.pin, self.mechanism = pin, mechanism
        self.model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer()) if free else pin.buildModelFromXML(text)
        self.model.gravity.linear = mechanism.gravity
        self.joints = {
            re.sub(r"\W+", "_", name): model for name, model in zip(self.model.names, self.model.joints, strict=True)
        }
        self.data = self.model.createData()

    def state(self, q, u):
        """Pinocchio's q and v for ours, and T and w: its v is T u, and its accelerations are T u' + w.

        The velocity of a free joint is ours in the first part's axes and Pinocchio's in the second's.
        """
        model, nv = self.model, len(u)
        pin_q, turn, w = self.pin.neutral(model), np.zeros((model.nv, nv)), np.zeros(model.nv)
        in_q = in_u = 0
        for name, joint in self.mechanism.joints.items():
            if joint.type == "fixed":
                continue
            found = self.joints.get(name, model.joints[1])  # the free base has a name of its own
            theirs, ours = slice(found.idx_v, found.idx_v + found.nv), slice(in_u, in_u + found.nv)
            turn[theirs, ours] = np.eye(found.nv)
            if joint.type == "free":
                place, (real, x, y, z) = q[in_q : in_q + 3], q[in_q + 3 : in_q + 7]
                pin_q[found.idx_q : found.idx_q + 7] = *place, x, y, z, real
                rotation = from_quaternion(np.array([real, x, y, z]))
                turn[theirs, ours][:3, :3] = rotation.T
                w[theirs][:3] = -np.cross(u[ours][3:], rotation.T @ u[ours][:3])
            else:
                pin_q[found.idx_q : found.idx_q + found.nq] = (
                    [q[in_q]] if found.nq == 1 else [np.cos(q[in_q]), np.sin(q[in_q])]
                )
            in_q, in_u = in_q + (7 if joint.type == "free" else 1), in_u + found.nv
        assert (in_q, in_u) == (len(q), nv) and in_u == model.nv
        return pin_q, turn @ u, turn, w

    def losses(self, u):
        """The efforts (nv,) that dampers and friction of joints take from ours, which Pinocchio does not know."""
        lost, in_u = np.zeros(len(u)), 0
        for joint in self.mechanism.joints.values():
            size = len(joint.coordinate_names)
            if joint.type not in ("fixed", "free"):
                speeds = u[in_u : in_u + size]
                lost[in_u : in_u + size] = joint.damping * speeds
                if joint.friction is not None:
                    friction = joint.friction
                    lost[in_u : in_u + size] += friction.coulomb * np.tanh(speeds / friction.regularization)
            in_u += size
        return lost

    def accelerations(self, q, u, efforts):
        """Our u' (nv,) for our q, u and efforts, by Pinocchio's `aba`."""
        pin_q, pin_v, turn, w = self.state(q, u)
        found = self.pin.aba(self.model, self.data, pin_q, pin_v, turn @ (efforts - self.losses(u)))
        return turn.T @ (found - w)
