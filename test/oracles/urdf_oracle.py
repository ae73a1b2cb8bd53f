"""Pinocchio as an oracle for mechanisms read from a URDF."""

import re

import numpy as np

from mbd_sim.geometry.rotation import from_quaternion


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

    def accelerations(self, q, u, efforts):
        """Our u' (nv,) for our q, u and efforts, by Pinocchio's `aba`."""
        model = self.model
        pin_q, pin_v, pin_tau = self.pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        in_q = in_u = 0
        places = []
        for name, joint in self.mechanism.joints.items():
            if joint.type == "fixed":
                continue
            found = self.joints.get(name, model.joints[1])  # the free base has a name of its own
            theirs = slice(found.idx_v, found.idx_v + found.nv)
            ours = slice(in_u, in_u + found.nv)
            turn = np.eye(3)
            if joint.type == "free":
                place, (w, x, y, z) = q[in_q : in_q + 3], q[in_q + 3 : in_q + 7]
                pin_q[found.idx_q : found.idx_q + 7] = *place, x, y, z, w
                turn = from_quaternion(np.array([w, x, y, z]))
                # Ours are a velocity and a force in the first part's axes, Pinocchio's in the second's.
                pin_v[theirs] = *(turn.T @ u[ours][:3]), *u[ours][3:]
                pin_tau[theirs] = *(turn.T @ efforts[ours][:3]), *efforts[ours][3:]
            else:
                x = q[in_q]
                pin_q[found.idx_q : found.idx_q + found.nq] = [x] if found.nq == 1 else [np.cos(x), np.sin(x)]
                pin_v[theirs], lost = u[ours], joint.damping * u[ours]
                if joint.friction is not None:
                    lost += joint.friction.coulomb * np.tanh(u[ours] / joint.friction.regularization)
                pin_tau[theirs] = efforts[ours] - lost
            places.append((joint, ours, theirs, turn))
            in_q, in_u = in_q + (7 if joint.type == "free" else 1), in_u + found.nv
        assert (in_q, in_u) == (len(q), len(u)) and in_u == model.nv
        found = self.pin.aba(model, self.data, pin_q, pin_v, pin_tau)
        rates = np.zeros(len(u))
        for joint, ours, theirs, turn in places:
            rates[ours] = found[theirs]
            if joint.type == "free":
                velocity, omega = pin_v[theirs][:3], pin_v[theirs][3:]
                rates[ours][:3] = turn @ (found[theirs][:3] + np.cross(omega, velocity))
        return rates
