"""Pinocchio as an oracle for mechanisms that were read from a URDF."""

import re

import numpy as np

from mbd_sim.mechanism.rotation import from_quaternion

BASE = "base"  # the joint by which the root link flies


class Oracle:
    """A URDF's text as a Pinocchio model with a fixed or a free base, whose joints are ours by name."""

    def __init__(self, pin, text, mechanism, free):
        self.pin, self.mechanism, self.free = pin, mechanism, free
        self.model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer()) if free else pin.buildModelFromXML(text)
        self.model.gravity.linear = mechanism.gravity
        self.joints = {
            re.sub(r"\W+", "_", name): model for name, model in zip(self.model.names, self.model.joints, strict=True)
        }
        self.data = self.model.createData()

    def accelerations(self, q, u, efforts):
        """Our u' (nv,) for our q, u and efforts, by Pinocchio's `aba`."""
        pin, model = self.pin, self.model
        pin_q, pin_v, pin_tau = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        in_q = in_u = 0
        turn, omega = np.eye(3), np.zeros(3)
        places = []
        for name, joint in self.mechanism.joints.items():
            if joint.type == "free":
                w, x, y, z = q[in_q + 3 : in_q + 7]
                turn, omega = from_quaternion(np.array([w, x, y, z])), u[in_u + 3 : in_u + 6]
                pin_q[:7] = *q[in_q : in_q + 3], x, y, z, w
                # Ours are a velocity and a force in the first part's axes, Pinocchio's in the second's.
                pin_v[:6] = *(turn.T @ u[in_u : in_u + 3]), *omega
                pin_tau[:6] = *(turn.T @ efforts[in_u : in_u + 3]), *efforts[in_u + 3 : in_u + 6]
                places.append((slice(in_u, in_u + 6), slice(0, 6)))
                in_q, in_u = in_q + 7, in_u + 6
            elif joint.type != "fixed":
                found = self.joints[name]
                if found.nq == 2:  # continuous
                    pin_q[found.idx_q : found.idx_q + 2] = np.cos(q[in_q]), np.sin(q[in_q])
                else:
                    pin_q[found.idx_q] = q[in_q]
                pin_v[found.idx_v] = u[in_u]
                lost = joint.damping[0] * u[in_u]
                if joint.friction is not None:
                    lost += joint.friction.coulomb * np.tanh(u[in_u] / joint.friction.regularisation)
                pin_tau[found.idx_v] = efforts[in_u] - lost
                places.append((slice(in_u, in_u + 1), slice(found.idx_v, found.idx_v + 1)))
                in_q, in_u = in_q + 1, in_u + 1
        assert (in_q, in_u) == (len(q), len(u)) and in_u == model.nv
        found = pin.aba(model, self.data, pin_q, pin_v, pin_tau)
        rates = np.zeros(len(u))
        for ours, theirs in places:
            rates[ours] = found[theirs]
            if theirs.stop - theirs.start == 6:
                rates[ours][:3] = turn @ (found[:3] + np.cross(omega, pin_v[:3]))
        return rates
