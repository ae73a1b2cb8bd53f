"""The exact values that sensors measure, as expressions of the state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

import casadi as ca

from mbd_sim.dynamics.commanded_drives import driven_motion
from mbd_sim.dynamics.frame_motion import FrameMotion, frame_motion
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.dynamics.tracing import TracedMechanism
from mbd_sim.mechanism.sensors import (
    Accelerometer,
    AnySensor,
    Encoder,
    ForceTorque,
    Imu,
    MotorCurrent,
    Odometry,
    PoseSensor,
    RangeFinder,
    SensorFrame,
    Tachometer,
    TwistSensor,
)


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

    def motion_at(at: SensorFrame) -> FrameMotion:
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
            column = [*traced.mechanism.joints, *traced.mechanism.closing].index(sensor.joint)
            return ca.vertcat(reactions[:, column], axes)
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
