"""Functions of the state that are traced when they are first read: accelerations, motions of parts, measurements.

The exact values that sensors measure are expressions of the state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, assert_never

import casadi as ca
import numpy as np

from mbd_sim.dynamics.accelerations import ConstrainedMotion
from mbd_sim.dynamics.constraints.equations import ConstraintEquations
from mbd_sim.dynamics.kinematics.drives import driven_motion
from mbd_sim.dynamics.kinematics.frames import (
    FrameMotion,
    FrameQuantity,
    center_function,
    coordinate_accelerations,
    frame_function,
    frame_motion,
    momentum_function,
    part_motions,
)
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.dynamics.terms import DynamicsTerm, term_function
from mbd_sim.mechanism.elements.parts import PartFrame
from mbd_sim.mechanism.elements.sensors import (
    Accelerometer,
    AnySensor,
    Encoder,
    ForceTorque,
    Imu,
    MotorCurrent,
    Odometry,
    PoseSensor,
    RangeFinder,
    Tachometer,
    TwistSensor,
)

if TYPE_CHECKING:
    from mbd_sim.dynamics.actuators.functions import ActuatorFunctions


@dataclass(frozen=True, eq=False)
class Measurements:
    """Functions of (t, y, inputs) in SI units; the inputs contain the contact forces, if there are contacts."""

    traced: TracedMechanism
    motion: ConstrainedMotion
    constraints: ConstraintEquations
    trace_reactions: Callable[[], ca.SX]

    @cached_property
    def accelerations(self) -> ca.Function:
        """u' (nv,), then the accelerations of the driven coordinates, in declared order."""
        return self._function("accelerations", coordinate_accelerations(self.traced, self.motion.u_rates))

    @cached_property
    def part_motions(self) -> ca.Function:
        """(12, parts) in ground's axes: the velocity of each origin, ω, the acceleration of the origin, and ω'."""
        return self._function("part_motions", part_motions(self.traced, self.motion.links))

    def frame(self, part: str | None, quantity: FrameQuantity) -> ca.Function:
        """(t, y, inputs, point) -> a quantity of a point of a part, see `frame_function`; None: the center of mass."""
        if part is None:
            return center_function(self.traced, quantity)
        return frame_function(self.traced, part, quantity)

    def term(self, term: DynamicsTerm) -> ca.Function:
        """(t, y, inputs, u') -> a term of the equations of motion, see `term_function`."""
        return term_function(self.traced, self.constraints, term)

    @property
    def momentum(self) -> ca.Function:
        """(6,): the linear momentum, and the angular one about ground's origin."""
        return momentum_function(self.traced)

    def sensors(self, actuators: ActuatorFunctions | None) -> dict[str, ca.Function]:
        """The exact values of each sensor by name, see `exact_values`, with the functions of the actuators."""
        from mbd_sim.dynamics.actuators.functions import MOTOR_READINGS
        from mbd_sim.mechanism.elements.sensors import ForceTorque

        sensors = self.traced.mechanism.sensors
        with_load = any(isinstance(sensor, ForceTorque) for sensor in sensors)
        reactions = self.trace_reactions() if with_load else ca.SX(6, 0)
        links, currents = self.motion.links, ca.SX(0, 1)
        if actuators is not None:
            (readings,) = actuators.readings.call([self.traced.state.t, self.traced.y, self.traced.inputs])
            currents = readings[MOTOR_READINGS.index("current"), :].T
        return {
            sensor.name: self._function(
                f"sensor_{number}", exact_values(self.traced, links, reactions, currents, sensor)
            )
            for number, sensor in enumerate(sensors)
        }

    def _function(self, name: str, output: ca.SX) -> ca.Function:
        inputs = [self.traced.state.t, self.traced.y, self.traced.inputs]
        return ca.Function(name, inputs, [ca.densify(output)], {"cse": True})


def exact_values(
    traced: TracedMechanism, accelerations: Sequence[ca.SX], reactions: ca.SX, currents: ca.SX, sensor: AnySensor
) -> ca.SX:
    """The values of a sensor's quantities in order.

    An orientation is a rotation matrix (9,), column by column. A force–torque sensor gives the reaction in ground's
    axes (6,) and the axes of its frame (9,). A range finder of a plane gives n·d and n·x, with the normal n, the
    direction x of its beam and the vector d from it to a point of the plane.

    :param accelerations: spatial acceleration (6,) of each link in L, less that of gravity.
    :param reactions: (6, joints), see `joint_reactions`.
    :param currents: (n,) of the actuators.
    """

    def motion_at(at: PartFrame) -> FrameMotion:
        return frame_motion(traced, accelerations, at.part, at.pose)

    match sensor:
        case Encoder():
            return coordinate_values(traced, sensor.coordinate)[0]
        case Tachometer():
            return coordinate_values(traced, sensor.coordinate)[1]
        case MotorCurrent():
            names = [actuator.name for actuator in traced.mechanism.actuators]
            return currents[names.index(sensor.actuator)]
        case RangeFinder():
            return _range_values(motion_at(sensor.at), motion_at(sensor.target), sensor)
    frame = motion_at(sensor.at)
    axes = ca.vec(frame.rotation)
    match sensor:
        case Imu():
            return ca.vertcat(frame.omega, frame.specific_force, *([axes] if sensor.orientation else []))
        case Accelerometer():
            return frame.specific_force
        case ForceTorque():
            return ca.vertcat(_load(traced, reactions, motion_at, sensor, frame), axes)
        case PoseSensor():
            return ca.vertcat(frame.position, axes)
        case TwistSensor():
            to_axes = ca.SX.eye(3) if sensor.in_frame else frame.rotation
            return ca.vertcat(to_axes @ frame.velocity, to_axes @ frame.omega)
        case Odometry():
            return ca.vertcat(frame.position, axes, frame.velocity, frame.omega)
        case _:
            assert_never(sensor)


def measured_values(sensor: AnySensor, exact: ca.SX) -> ca.SX:
    """What a sensor without errors gives, from its exact values: a load in the axes of its frame, a distance along x.

    An orientation remains a rotation matrix (9,).
    """
    match sensor:
        case ForceTorque():
            to_frame = ca.reshape(exact[6:], 3, 3).T
            return ca.vertcat(to_frame @ exact[:3], to_frame @ exact[3:6])
        case RangeFinder():
            return exact if sensor.normal is None else exact[0] / exact[1]
        case Imu() | Accelerometer() | Encoder() | Tachometer() | MotorCurrent():
            return exact
        case PoseSensor() | TwistSensor() | Odometry():
            return exact
        case _:
            assert_never(sensor)


def _load(
    traced: TracedMechanism,
    reactions: ca.SX,
    motion_at: Callable[[PartFrame], FrameMotion],
    sensor: ForceTorque,
    frame: FrameMotion,
) -> ca.SX:
    """The reaction (6,) of a joint in ground's axes, its moment about the origin of the sensor's frame."""
    joints = traced.mechanism.all_joints
    load, joint = reactions[:, list(joints).index(sensor.joint)], joints[sensor.joint]
    if np.array_equal(sensor.at.pose.position, joint.child_pose.position):
        return load
    arm = motion_at(PartFrame(joint.child, joint.child_pose)).position - frame.position
    return ca.vertcat(load[:3], load[3:] + ca.cross(arm, load[:3]))


def _range_values(own: FrameMotion, target: FrameMotion, sensor: RangeFinder) -> ca.SX:
    line = target.position - own.position
    if sensor.normal is None:
        return ca.norm_2(line)
    normal = target.rotation @ constant(sensor.target.pose.rotation).T @ constant(sensor.normal)
    return ca.vertcat(ca.dot(normal, line), ca.dot(normal, own.rotation[:, 0]))


def coordinate_values(traced: TracedMechanism, name: str) -> tuple[ca.SX, ca.SX]:
    """The position and the speed of a free or driven coordinate that is not part of an orientation."""
    for link in traced.links:
        joint = link.joint
        if name not in joint.motion_names:
            continue
        number = joint.motion_names.index(name)
        if joint.drive:
            positions, speeds, _ = driven_motion(link, traced.state.t, traced.state.q)
            return positions[number], speeds[number]
        return traced.state.q[link.q.start + number], traced.state.u[link.u.start + number]
    raise ValueError(f"there is no coordinate '{name}'")
