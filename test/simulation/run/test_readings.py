"""Kinematics of points and the terms of the equations of motion, against Kane's equations and against differences."""

import numpy as np
import pytest

from mbd_sim import InputError, Simulation
from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics
from test.generators.mechanisms import FLOATING, consistent_state
from test.oracles import kane

CHAINS = ["heavy_top", "moving_support_pendulum", "cart_massive_spring"]
LOOPS = ["four_bar", "rolling_disc"]


def in_motion(name, **options):
    """A simulation at some time, in some state of motion with efforts."""
    sim = Simulation.from_text(FLOATING, **options) if name == "floating" else Simulation.from_file(name, **options)
    rng = np.random.default_rng(5)
    sim.step(7)
    q, u, efforts = consistent_state(sim.model.equations, rng, sim.time, 0.3)
    y = sim.state
    y[sim.model.q_range], y[sim.model.u_range] = q, u
    sim.restore(y, sim.steps)
    sim.set_efforts(efforts)
    return sim


def close(found, expected, tolerance=1e-11):
    expected = np.asarray(expected)
    np.testing.assert_allclose(found, expected, atol=tolerance * (1.0 + np.max(np.abs(expected), initial=0.0)), rtol=0)


def names_of(sim):
    return [
        name
        for part in sim.mechanism.parts.values()
        for name in (part.name, *(f"{part.name}.{p}" for p in part.points))
    ]


def kane_point(mechanism, name, motions):
    """Position, velocity and acceleration (3, 3) of a point, and ω and ω' (2, 3), by Kane's oracle."""
    part, _, point = name.partition(".")
    local = mechanism.parts[part].points[point].position if point else np.zeros(3)
    motion = motions[part]
    places = [motion.origin.d[order] + motion.rotation.d[order] @ local for order in range(3)]
    turned = motion.rotation.d[0]
    return np.array(places), np.array([turned @ motion.omega, turned @ motion.alpha])


@pytest.mark.parametrize("name", [*CHAINS, *LOOPS, "floating"])
def test_points_and_frames_move_as_in_kanes_equations(name):
    sim = in_motion(name)
    mechanism, nv, t, q = sim.mechanism, len(sim.u), sim.time, sim.q
    moving = kane.motions(mechanism, q, sim.u, sim.u_rates, t=t)
    steady, resting, *units = (
        kane.motions(mechanism, q, u, np.zeros(nv), t=t) for u in (sim.u, np.zeros(nv), *np.eye(nv))
    )
    for point in names_of(sim):
        frame, own = sim.frame(point), sim.point(point)
        places, turning = kane_point(mechanism, point, moving)
        still, still_turning = kane_point(mechanism, point, steady)
        for one in (own, frame):
            close(one.position, places[0])
            close(one.velocity, places[1])
            close(one.acceleration, places[2])
        close(frame.angular_velocity, turning[0])
        close(frame.angular_acceleration, turning[1])
        close(own.bias_acceleration, still[2])
        close(frame.bias_acceleration, [*still[2], *still_turning[1]])
        at_rest = kane_point(mechanism, point, resting)
        for column, motions in enumerate(units):
            unit = kane_point(mechanism, point, motions)
            expected = [*(unit[0][1] - at_rest[0][1]), *(unit[1][0] - at_rest[1][0])]
            close(frame.jacobian[:, column], expected)
        np.testing.assert_array_equal(own.jacobian, frame.jacobian[:3])
        np.testing.assert_array_equal(own.jacobian_rate, frame.jacobian_rate[:3])
        pose = sim.motion(point).pose
        close(frame.rotation, pose.rotation)
        close(frame.pose.position, pose.position)


@pytest.mark.parametrize("name", ["heavy_top", "floating", "rolling_disc"])
def test_the_rate_of_a_jacobian_is_its_difference_along_the_motion(name):
    sim = in_motion(name)
    frame, state, h = sim.frame(names_of(sim)[-1]), sim.state, 1e-5
    rate, center_rate = frame.jacobian_rate, sim.center_of_mass.jacobian_rate
    rates = np.array(sim.model.equations.rates.call([sim.time, state, sim.inputs])[0]).ravel()
    jacobians = []
    for sign in (1.0, -1.0):
        moved = state + sign * h * rates  # the time stays: joints that carry these points are not driven
        sim.restore(moved, sim.steps)
        jacobians.append((frame.jacobian, sim.center_of_mass.jacobian))
    for found, ahead, behind in zip((rate, center_rate), *jacobians, strict=True):
        close(found, (ahead - behind) / (2 * h), 1e-8)


@pytest.mark.parametrize("name", [*CHAINS, *LOOPS, "floating"])
def test_the_terms_are_those_of_kanes_equations(name):
    sim = in_motion(name)
    exact = kane.equations(sim.mechanism, sim.q, sim.u, sim.efforts, sim.time)
    close(sim.mass_matrix(), exact.mass)
    close(sim.generalized_forces() - sim.bias_terms(), exact.forces, 1e-10)
    close(sim.coriolis_terms() + sim.gravity_terms(), sim.bias_terms())
    assert sim.constraint_jacobian().shape == (len(sim.constraint_names), len(sim.u))


@pytest.mark.parametrize("name", ["floating"])
def test_coriolis_and_gravity_terms_are_apart(name):
    """Without forces and at rest, Kane's forces are those of gravity; without gravity, those of inertia."""
    sim = in_motion(name, set={"gravity": [0.3, -0.7, -9.0]})
    resting = sim.state
    resting[sim.model.u_range] = 0.0
    bare = sim.generalized_forces()
    gravity, coriolis = sim.gravity_terms(), sim.coriolis_terms()
    exact = kane.equations(sim.mechanism, sim.q, sim.u, sim.efforts, sim.time)
    at_rest = kane.equations(sim.mechanism, sim.q, np.zeros_like(sim.u), np.zeros_like(sim.u), sim.time)
    sim.restore(resting, sim.steps)
    sim.set_efforts(np.zeros_like(sim.u))
    close(sim.generalized_forces() - gravity, at_rest.forces, 1e-10)
    close(sim.gravity_terms(), gravity)
    close(sim.coriolis_terms(), np.zeros_like(sim.u))
    close(coriolis, bare - exact.forces - gravity, 1e-10)


@pytest.mark.parametrize("name", LOOPS)
def test_constraints_hold_for_the_accelerations_and_their_forces_balance_the_equations(name):
    sim = in_motion(name)
    jacobian = sim.constraint_jacobian()
    multipliers, taken = sim.multipliers(), {}
    ordered = []
    for owner in sim.constraint_names:
        ordered.append(multipliers[owner][taken.setdefault(owner, 0)])
        taken[owner] += 1
    close(jacobian @ sim.u_rates + sim.constraint_bias(), np.zeros(len(jacobian)), 1e-9)
    inertia, applied = sim.mass_matrix() @ sim.u_rates + sim.bias_terms(), sim.generalized_forces()
    close(inertia, applied + jacobian.T @ ordered, 1e-9)


@pytest.mark.parametrize("name", ["four_bar", "floating"])
def test_momentum_and_center_of_mass(name):
    sim = in_motion(name)
    linear, angular = kane.momentum(sim.mechanism, sim.q, sim.u)
    center, mass = sim.center_of_mass, sim.mechanism.mass
    close(sim.momentum("ground").linear, linear)
    close(sim.momentum([0.0, 0.0, 0.0]).angular, angular)
    close(mass * center.velocity, linear)
    close(center.jacobian @ sim.u, center.velocity)
    close(sim.momentum().angular, angular - np.cross(center.position, linear))
    point = names_of(sim)[-1]
    close(sim.momentum(point).angular, angular - np.cross(sim.point(point).position, linear))
    parts = [kane.motions(sim.mechanism, sim.q, sim.u, sim.u_rates)[name] for name in sim.mechanism.parts]
    masses = [part.mass for part in sim.mechanism.parts.values()]
    for order, found in enumerate((center.position, center.velocity, center.acceleration)):
        close(found, sum(m * part.center.d[order] for m, part in zip(masses, parts, strict=True)) / mass)


@pytest.mark.parametrize("name", ["floating", "four_bar", "motor_drive"])
def test_forward_and_inverse_dynamics_are_inverse(name):
    sim = in_motion(name)
    before = sim.u_rates
    np.testing.assert_array_equal(sim.forward_dynamics(), before)
    efforts = sim.efforts + 0.3
    rates = sim.forward_dynamics(efforts)
    np.testing.assert_array_equal(sim.u_rates, before)  # nothing is applied
    first = sim.coordinate_names[0]
    changed = sim.forward_dynamics({first: float(efforts[0])})
    sim.set_efforts({first: float(efforts[0])})
    np.testing.assert_array_equal(changed, sim.u_rates)
    sim.set_efforts(efforts)
    np.testing.assert_array_equal(rates, sim.u_rates)
    gradient = sim.constraint_jacobian()
    free = np.linalg.svd(gradient)[2][np.linalg.matrix_rank(gradient) :].T if len(gradient) else np.eye(len(sim.u))
    exerted = efforts + sum((motor.effort for motor in sim.actuators().values()), 0.0)
    close(free.T @ sim.inverse_dynamics(rates), free.T @ exerted, 1e-9)
    independent = InverseDynamics(sim.mechanism)
    if name != "motor_drive":
        close(sim.inverse_dynamics(rates), independent(sim.q, sim.u, rates, sim.time), 1e-11)


def test_readings_follow_the_motion_and_are_new_arrays():
    sim = Simulation.from_file("double_rod")
    tip = sim.point("lower.tip") if "tip" in sim.mechanism.parts["lower"].points else sim.point("lower")
    before = tip.position
    kept = before.copy()
    sim.run(until=0.2)
    np.testing.assert_array_equal(before, kept)
    assert np.abs(tip.position - before).max() > 0.01
    tip.jacobian[:] = 0.0
    assert np.any(tip.jacobian)
    with pytest.raises(InputError, match="lowr"):
        sim.point("lowr")


def test_a_point_of_ground_does_not_move():
    sim = Simulation.from_file("double_rod")
    ground = sim.frame("ground")
    np.testing.assert_array_equal(ground.position, np.zeros(3))
    assert ground.jacobian.shape == (6, 2) and not ground.jacobian.any() and not ground.velocity.any()
    assert sim.point("ground").jacobian_rate.shape == (3, 2)
    np.testing.assert_array_equal(ground.rotation, np.eye(3))


@pytest.mark.parametrize(
    ("name", "key", "factor"),
    [
        ("double_rod", "parameters.l", 1.3),
        ("four_bar", "parameters.base", 1 + 1e-7),
    ],
)
def test_points_whose_place_is_a_live_value_follow_it(name, key, factor):
    """The lengths of the file place points of the parts; a simulation that is built with the other value agrees."""
    live = Simulation.from_file(name, live=[key])
    points = [*names_of(live), *(f"ground.{point}" for point in live.mechanism.ground_points)]
    frames, before = [live.frame(point) for point in points], live.snapshot()
    places = [frame.position for frame in frames]
    live.set_live({key: live.live[key] * factor})
    built = Simulation.from_file(name, set=dict(live.live))
    built.restore(live.state, live.steps)
    for point, frame in zip(points, frames, strict=True):
        expected = built.frame(point)
        close(frame.position, expected.position, 1e-15)
        close(frame.jacobian, expected.jacobian, 1e-14)
        for found, other in zip(live.motion(point)[1:], built.motion(point)[1:], strict=True):
            close(found, other, 1e-9)
        close(live.motion(point).pose.position, built.motion(point).pose.position, 1e-15)
    moved = max(np.abs(frame.position - place).max() for frame, place in zip(frames, places, strict=True))
    assert moved > 1e-8
    live.restore(before)
    for frame, place in zip(frames, places, strict=True):
        np.testing.assert_array_equal(frame.position, place)
