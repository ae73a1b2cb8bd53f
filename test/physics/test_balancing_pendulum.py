"""The balancing pendulum: its accelerations and the readings of its inertial sensor in closed form, without errors."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation

RIG = {f"sensors.imu.{quantity}.{key}": value for quantity, unit in (("angular_velocity", "rad/s"), ("specific_force", "m/s^2"))
       for key, value in {"bias": 0.0, "noise_density": 0.0, "resolution": f"1e-50 {unit}", "limit": f"1e9 {unit}"}.items()}  # fmt: skip
G, CART, ROD, BALL, LENGTH, BOARD = 9.81, 1.0, 0.1, 0.2, 0.5, 0.05
BALL_RADIUS = 0.04


def accelerations(angle, speed, rate, force):
    """Of the cart and of the angle, from Lagrange's equations by hand."""
    mass, moment = CART + ROD + BALL, (ROD / 2.0 + BALL) * LENGTH
    inertia = (ROD / 3.0 + BALL) * LENGTH**2 + 0.4 * BALL * BALL_RADIUS**2
    matrix = np.array([[mass, moment * math.cos(angle)], [moment * math.cos(angle), inertia]])
    right = [
        force - 0.5 * speed + moment * math.sin(angle) * rate**2,
        moment * G * math.sin(angle) - 0.002 * rate,
    ]
    return np.linalg.solve(matrix, right)


@pytest.mark.parametrize(
    ("angle", "speed", "rate", "force"), [(0.0, 0, 0, 0), (0.2, 0.3, -1.5, 4.0), (-1.1, -1, 2.0, -3.0)]
)
def test_accelerations_and_the_inertial_sensor_agree_with_the_equations_by_hand(angle, speed, rate, force):
    changes = {key: value for key, value in RIG.items() if "resolution" not in key}
    changes |= {"sensors.imu.angular_velocity.bias_walk": 0.0, "sensors.imu.delay": 0.0}
    changes |= {key: "1e-50" for key in RIG if "resolution" in key}
    sim = Simulation.from_file("balancing_pendulum", set=changes)
    sim.set_efforts([force, 0.0])
    sim.set_state({"pin": angle}, {"rail": speed, "pin": rate})
    cart, turning = accelerations(angle, speed, rate, force)
    np.testing.assert_allclose(sim.u_rates, [cart, turning], rtol=1e-12, atol=1e-12)
    reading = sim.sensors()["imu"]
    np.testing.assert_allclose(reading["angular_velocity"], [0.0, rate, 0.0], atol=1e-12)
    sine, cosine = math.sin(angle), math.cos(angle)
    forward = cart * cosine + BOARD * turning - G * sine
    upward = cart * sine - BOARD * rate**2 + G * cosine
    np.testing.assert_allclose(reading["specific_force"], [forward, 0.0, upward], rtol=1e-12, atol=1e-12)


def test_it_falls_with_its_energy_conserved():
    sim = Simulation.from_file("balancing_pendulum")
    sim.run(until=3.0)
    assert abs(sim.q[1]) > 1.0
    assert abs(sim.energies.residual) < 1e-10
