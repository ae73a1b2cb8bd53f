"""Drake as an oracle for mechanisms that were read from an SDF or written as one."""

import re

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from mbd_sim.base.geometry.rotation import from_quaternion


class DrakeOracle:
    """An SDF's text as a plant of Drake, whose bodies and joints correspond to ours by name."""

    def __init__(self, text):
        self.plant = MultibodyPlant(0.0)
        Parser(self.plant).AddModelsFromString(text, "sdf")
        if gravity := re.search(r"<gravity>(.*?)</gravity>", text):  # which its parser does not read
            self.plant.mutable_gravity_field().set_gravity_vector([float(word) for word in gravity[1].split()])
        self.plant.Finalize()
        self.context = self.plant.CreateDefaultContext()
        self.names = [self.plant.GetModelInstanceName(index) for index in self._instances()]

    def _instances(self):
        from pydrake.multibody.tree import ModelInstanceIndex

        return [ModelInstanceIndex(i) for i in range(2, self.plant.num_model_instances())]

    def _full(self, name, instance):
        """Our name of an element of a model instance."""
        scope = self.plant.GetModelInstanceName(instance)
        path = (
            f"{scope}::{name}"
            if len({full.split("::")[0] for full in self.names}) > 1
            else f"{scope}::{name}".split("::", 1)[1]
        )
        return re.sub(r"\W+", "_", path)

    def _bodies(self):
        found = {}
        for instance in self._instances():
            for index in self.plant.GetBodyIndices(instance):
                body = self.plant.get_body(index)
                found[self._full(body.name(), instance)] = body
        return found

    def _joint(self, name):
        """The joint of which ours has the name, perhaps after those of its models."""
        indices = [index for instance in self._instances() for index in self.plant.GetJointIndices(instance)]
        joints = [self.plant.get_joint(index) for index in indices]
        return max(
            (one for one in joints if name.endswith(re.sub(r"\W+", "_", one.name()))), key=lambda one: len(one.name())
        )

    def set_state(self, mechanism, q, u):
        """Take our coordinates and speeds."""
        bodies, in_q, in_u = self._bodies(), 0, 0
        for name, joint in mechanism.joints.items():
            nq, nv = joint.kind.nq, joint.kind.nv
            position, speed = q[in_q : in_q + nq], u[in_u : in_u + nv]
            in_q, in_u = in_q + nq, in_u + nv
            if joint.type == "free":
                body, rotation = bodies[joint.child], from_quaternion(position[3:])
                pose = RigidTransform(RotationMatrix(rotation), position[:3])
                self.plant.SetFreeBodyPose(self.context, body, pose)
                velocity = SpatialVelocity(rotation @ speed[3:], speed[:3])
                self.plant.SetFreeBodySpatialVelocity(context=self.context, body=body, V_JpJc=velocity)
            elif nv:
                theirs = self._joint(name)
                if joint.type == "spherical":
                    raise NotImplementedError("Drake's ball joints have roll, pitch and yaw")
                for index in range(nv):
                    start = theirs.position_start() + index
                    positions, speeds = self.plant.GetPositions(self.context), self.plant.GetVelocities(self.context)
                    positions[start], speeds[theirs.velocity_start() + index] = position[index], speed[index]
                    self.plant.SetPositions(self.context, positions)
                    self.plant.SetVelocities(self.context, speeds)

    def pose(self, part):
        """The pose of a part in the world."""
        return self.plant.EvalBodyPoseInWorld(self.context, self._bodies()[part])

    def accelerations(self, mechanism):
        """Our u' (nv,)."""
        rates = self.plant.get_generalized_acceleration_output_port().Eval(self.context)
        found, bodies = [], self._bodies()
        for name, joint in mechanism.joints.items():
            if joint.type == "free":
                body = bodies[joint.child]
                spatial = body.EvalSpatialAccelerationInWorld(self.context)
                turn = self.pose(joint.child).rotation().matrix()
                found += [*spatial.translational(), *(turn.T @ spatial.rotational())]
            elif joint.kind.nv:
                start = self._joint(name).velocity_start()
                found += [*rates[start : start + joint.kind.nv]]
        return np.array(found)
