"""Velocities and accelerations of parts: differences of poses, closed forms of a free part, and free joints in any direction."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import from_quaternion, of_vector
from mbd_sim.simulation.run.moving_points import free_joint_of, free_joint_values

FREE = """
mechanism: thrown
ground: {points: {base: {at: [0.1, 0.2, 0.3], rotate: {axis: [1, 2, 0], angle: 40 deg}}}}
parts:
  body:
    mass: 2
    inertia: [0.1, 0.2, 0.25]
    points: {corner: {at: [0.3, 0, -0.1], rotate: {axis: [0, 1, 1], angle: 70 deg}}}
joints:
  flight: {type: free, between: ENDS, position: [0.4, 0.5, 0.6], velocity: [1, 2, 3], angular_velocity: [0.7, -0.5, 0.9]}
"""
BOTH_WAYS = ["[ground.base, body.corner]", "[body.corner, ground.base]"]


def motions_of(simulation):
    return simulation.model.part_motions(simulation.time, simulation.state, simulation.inputs)


@pytest.mark.parametrize("name", ["four_bar", "rolling_disc", "moving_support_pendulum"])
def test_the_motions_are_the_derivatives_of_the_poses(name):
    simulation = Simulation.from_file(name, step=1e-4)
    simulation.run(0.05)
    poses = [simulation.poses()]
    for index in range(2):
        simulation.step()
        poses.append(simulation.poses())
        if index == 0:
            found = motions_of(simulation)
    before, _, after = poses
    for part, motion in found.items():
        velocity = (after[part].position - before[part].position) / 2e-4
        acceleration = (after[part].position - 2.0 * motion.pose.position + before[part].position) / 1e-8
        size = 1.0 + np.linalg.norm(motion.acceleration) + np.linalg.norm(motion.angular_velocity) ** 3
        np.testing.assert_allclose(motion.velocity, velocity, atol=1e-6 * size)
        np.testing.assert_allclose(motion.acceleration, acceleration, atol=1e-5 * size)
        turned = after[part].rotation @ before[part].rotation.T
        spin = 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
        np.testing.assert_allclose(motion.angular_velocity, spin / 2e-4, atol=1e-6 * size)


@pytest.mark.parametrize("ends", BOTH_WAYS)
def test_a_free_part_falls_and_its_coordinates_follow_from_its_motion(ends):
    simulation = Simulation.from_text(FREE.replace("ENDS", ends))
    simulation.run(0.2)
    found = motions_of(simulation)
    center_acceleration = found["body"].acceleration  # the part's origin is its mass center
    np.testing.assert_allclose(center_acceleration, [0.0, 0.0, -9.81], atol=1e-2)
    joint = free_joint_of(simulation.model, "body")
    positions, speeds = free_joint_values(simulation.model, joint, found)
    np.testing.assert_allclose(list(positions.values()), simulation.model.coordinates(simulation.state), atol=1e-12)
    np.testing.assert_allclose(list(speeds.values()), simulation.u, atol=1e-12)
    assert list(positions) == list(simulation.model.coordinate_names)


@pytest.mark.parametrize("ends", BOTH_WAYS)
def test_a_free_part_takes_any_motion(ends):
    simulation = Simulation.from_text(FREE.replace("ENDS", ends))
    pose = Pose(np.array([1.0, -2.0, 3.0]), from_quaternion(of_vector(np.array([0.5, -1.0, 2.0]))))
    wanted = motions_of(simulation)["body"]._replace(
        pose=pose, velocity=np.array([0.1, 0.2, 0.3]), angular_velocity=np.array([-1.0, 2.0, 0.5])
    )
    joint = free_joint_of(simulation.model, "body")
    simulation.set_state(*free_joint_values(simulation.model, joint, {"body": wanted}))
    found = motions_of(simulation)["body"]
    np.testing.assert_allclose(found.pose.position, pose.position, atol=1e-12)
    np.testing.assert_allclose(found.pose.rotation, pose.rotation, atol=1e-12)
    np.testing.assert_allclose(found.velocity, wanted.velocity, atol=1e-12)
    np.testing.assert_allclose(found.angular_velocity, wanted.angular_velocity, atol=1e-12)


def test_a_part_that_is_held_has_no_free_joint():
    model = Simulation.from_file("double_rod").model
    assert free_joint_of(model, "upper") is None


def test_u_rates_are_the_rates_of_the_speeds_and_driven_coordinates_follow_them():
    simulation = Simulation.from_file("moving_support_pendulum")
    simulation.run(0.3)
    rates = simulation.model.equations.rates.call([simulation.time, simulation.state, simulation.inputs])[0]
    np.testing.assert_array_equal(simulation.u_rates, np.array(rates).ravel()[simulation.model.u_range])
    accelerations = simulation.model.accelerations(simulation.time, simulation.y, simulation.inputs)
    assert len(accelerations) == len(simulation.u) + len(simulation.model.driven_names)
    speeds = [simulation.model.drives(simulation.time + dt, simulation.y, simulation.inputs)[1] for dt in (-1e-5, 1e-5)]
    np.testing.assert_allclose(accelerations[len(simulation.u) :], (speeds[1] - speeds[0]) / 2e-5, rtol=1e-7, atol=1e-7)


BALL = """
mechanism: resting_ball
ground: {points: {floor: [0, 0, 0]}}
parts:
  ball: {shape: {type: sphere, radius: 0.1, mass: 2}}
joints:
  flight: {type: free, between: [ground, ball], position: [0, 0, 0.1]}
contacts:
  floor: {parts: [ball], plane: ground.floor}
"""


def test_contact_forces_are_part_of_the_accelerations():
    simulation = Simulation.from_text(BALL)
    simulation.step(10)
    np.testing.assert_allclose(simulation.u_rates, 0.0, atol=1e-12)
    np.testing.assert_allclose(simulation.motion("ball").acceleration, 0.0, atol=1e-12)
    simulation.reset(q=[0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(simulation.u_rates[:3], [0.0, 0.0, -9.81], atol=1e-12)
