"""What sensors measure as formulas: textbook lines, and the measurements of simulations at random states."""

# ruff: noqa: E741  # the letters are those of the textbooks

import functools
from typing import get_args

import numpy as np
import sympy as sp

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.mechanism.elements.sensors import AnySensor
from mbd_sim.studies.symbolic import symbolic_equations, sympy, to_latex

TURNED = "rotate: {axis: [0, 1, 0], angle: 90 deg}"
CART = f"""
mechanism: cart
parameters: {{m: 2 kg, l: 0.5 m, mc: 1 kg, b: 2 m, period: 2}}
ground: {{points: {{wall: {{at: [b, 0, 0], rotate: {{axis: [0, 1, 0], angle: -90 deg}}}}}}}}
parts:
  cart: {{mass: mc}}
  rod: {{mass: m, shape: {{type: rod, to: [0, 0, -l]}}, points: {{board: {{at: [0, 0, -l], {TURNED}}}}}}}
joints:
  x: {{type: prismatic, between: [ground, cart], axis: [1, 0, 0]}}
  theta: {{type: revolute, between: [cart, rod], axis: [0, -1, 0]}}
actuators:
  drive:
    {{type: dc_motor, joint: theta, torque_constant: 0.05, resistance: 0.8, inductance: 1 mH, gear_ratio: 20,
     control: voltage, voltage_limit: 24}}
  small: {{type: dc_motor, joint: x, torque_constant: 0.1, resistance: 0.5, control: voltage, lead: 20 mm}}
sensors:
  imu: {{type: imu, at: rod.board, orientation: {{}}}}
  plain: {{type: accelerometer, at: rod.board}}
  load: {{type: force_torque, joint: theta}}
  encoder: {{type: encoder, joint: theta, counts: 1024, index: 0.1}}
  scale: {{type: encoder, joint: x, resolution: 0.1 mm}}
  tachometer: {{type: tachometer, joint: x}}
  current: {{type: current, actuator: drive}}
  other: {{type: current, actuator: small}}
  wall: {{type: range, at: rod.board, plane: ground.wall, most: 50}}
  far: {{type: range, at: rod.board, point: ground.wall, most: 50}}
  pose: {{type: pose, at: rod.board}}
  twist: {{type: twist, at: rod.board}}
  odometry: {{type: odometry, at: rod.board}}
"""
LOOP = """
mechanism: loop
parameters: {m: 1.5, l: 0.7, a: 0.4, ms: 0.3}
parts:
  crank: {mass: m, shape: {type: rod, to: [a, 0, 0]}, points: {tip: [a, 0, 0]}}
  coupler: {mass: 0.4, shape: {type: rod, to: [l, 0, 0]}, points: {end: [l, 0, 0]}}
  slider: {mass: 0.8}
joints:
  pin: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 0.9, velocity: 2}
  knee: {type: revolute, between: [crank.tip, coupler], axis: [0, -1, 0]}
  rail: {type: prismatic, between: [ground, slider], axis: [1, 0, 0]}
  end: {type: revolute, between: [coupler.end, slider], axis: [0, -1, 0], cut: true}
forces:
  spring: {type: spring, between: [ground, coupler.end], stiffness: 40, length: 0.2, mass: ms}
actuators:
  pull: {type: effort, between: [ground, crank.tip], effort_limit: 40 N}
sensors:
  cut: {type: force_torque, joint: end}
  pin: {type: force_torque, joint: pin}
  end: {type: accelerometer, at: coupler.end}
"""
BALL = """
mechanism: ball
parameters: {m: 2, r: 0.1}
parts: {post: {mass: 3}, ball: {mass: m, inertia: [0.1, 0.2, 0.3]}}
joints:
  turn: {type: revolute, between: [ground, post], axis: [0, 0, 1], drive: sin(3*t)}
  socket: {type: spherical, between: [post, ball]}
sensors:
  imu: {type: imu, at: ball, orientation: {}}
  load: {type: force_torque, joint: socket}
"""
LANDED = """
mechanism: landed
parameters: {m: 2}
parts: {ball: {shape: {type: sphere, radius: 0.1}, mass: m}}
joints: {lift: {type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: 0.1}}
contacts: {floor: {parts: [ball], plane: ground}}
sensors: {load: {type: force_torque, joint: lift}}
"""


@functools.cache
def cart_model():
    return sympy(parse_mechanism(CART))


def measured_formulas(text, states, keys=None):
    """Compare all sensors with their measurements at states (t is zero); returns the equations."""
    mechanism = parse_mechanism(text)
    found, simulation = symbolic_equations(mechanism, keys), Simulation(mechanism)
    states_and_commands = [
        symbol for a in found.actuators for symbol in (*a.state_symbols.values(), *a.commands.values())
    ]
    symbols = [found.time, *found.q, *found.u, *found.u_rates, *found.multipliers, *states_and_commands]
    laws = {actuator.effort: actuator.law for actuator in found.actuators}
    formulas = {(one.sensor.name, key): value for one in found.sensors for key, value in one.values.items()}
    numbers = {one.symbol: one.value for one in found.parameters}
    function = sp.lambdify(symbols, [sp.Matrix(f).subs(laws).subs(numbers) for f in formulas.values()])
    for q, u in states:
        simulation.reset(q=q, u=u)
        loads = {name: iter(rows) for name, rows in simulation.multipliers().items()}
        equations = simulation.model.equations
        every = [next(loads[row.owner[1]]) for row in equations.rows]
        multipliers = [every[row] for row in equations.start.independent]
        state = [0.0, *simulation.q, *simulation.u, *simulation.u_rates, *multipliers]
        values = function(*state, *(0.0 for _ in states_and_commands))
        readings = simulation.sensors()
        assert list(formulas) == [(name, key) for name, reading in readings.items() for key in reading.values]
        for (name, quantity), ours in zip(formulas, values, strict=True):
            reading = readings[name][quantity]
            expected = from_quaternion(reading) if quantity == "orientation" else reading[:, None]
            size = 1.0 + np.max(np.abs(expected))
            np.testing.assert_allclose(ours, expected, rtol=1e-11, atol=1e-11 * size, err_msg=name)
    return found


def test_sensors_of_a_cart_with_a_pendulum():
    random = np.random.default_rng(4)
    seen = [(random.uniform(0.2, 1.2, size=2), random.normal(size=2)) for _ in range(5)]  # the wall is
    found = measured_formulas(CART, seen, ())
    assert {type(one.sensor) for one in found.sensors} == set(get_args(AnySensor))


def test_their_textbook_lines():
    """Along and across the rod: l θ'² + g cos θ - x'' sin θ and l θ'' + g sin θ + x'' cos θ; the pin carries m times that of G."""
    model = cart_model()
    m, l, b, g = (next(one for one in model.parameters if str(one) == name) for name in ("m", "l", "b", "g"))
    (x, theta), (v, w), (x_rate, w_rate) = model.q, model.u, model.u_rates
    sin, cos = sp.sin(theta), sp.cos(theta)
    across, along = w_rate * l + g * sin + x_rate * cos, l * w**2 + g * cos - x_rate * sin
    imu = model.sensors["imu"]
    compare(imu["specific_force"], [-along, 0, across])
    compare(imu["angular_velocity"], [0, -w, 0])
    load = model.sensors["load"]
    half = {l: l / 2}
    compare(load["force"], [m * across.subs(half), 0, m * along.subs(half)])
    moment = m * l**2 / 3 * w_rate + m * l / 2 * (g * sin + x_rate * cos)
    compare(load["torque"], [0, -moment, 0])
    compare(model.sensors["wall"]["distance"], [(b - x - l * sin) / sin])
    compare(model.sensors["far"]["distance"].applyfunc(lambda d: d**2), [(b - x - l * sin) ** 2 + l**2 * cos**2])
    compare(model.sensors["twist"]["velocity"], [v + l * w * cos, 0, l * w * sin])
    assert model.sensors["encoder"]["position"][0] == sp.pi / 512 * sp.floor(512 * theta / sp.pi)


def compare(ours, expected):
    difference = sp.Matrix(ours) - sp.Matrix(expected)
    assert difference.applyfunc(sp.simplify) == sp.zeros(*difference.shape)


def test_loads_in_a_loop_with_a_spring_with_mass_and_an_actuator_along_a_line():
    found = measured_formulas(LOOP, [({"pin": 0.9}, {"pin": 2.0}), ({"pin": 0.4}, {"pin": -1.0})])
    cut, pin, _ = found.sensors
    both = {row.multiplier for row in found.constraints if row.owner == "end"}
    assert cut.values["force"].free_symbols & both and pin.values["force"].free_symbols >= {found.actuators[0].effort}


def test_an_inertial_sensor_and_a_load_behind_a_spherical_joint_and_a_drive():
    quaternions = np.random.default_rng(3).normal(size=(3, 4))
    states = [
        (p / np.linalg.norm(p), u)
        for p, u in zip(quaternions, np.random.default_rng(5).normal(size=(3, 3)), strict=True)
    ]
    measured_formulas(BALL, states, ())


def test_the_load_of_a_joint_next_to_a_contact():
    """The slider carries no weight along its axis: F = m (q'' + g) - λ."""
    model = sympy(parse_mechanism(LANDED))
    (m, g), (force,) = model.parameters, model.multipliers
    compare(model.sensors["load"]["force"], [0, 0, m * (model.u_rates[0] + g) - force])


def test_sensors_are_printed():
    text = to_latex(cart_model().equations)
    assert (
        r"\tilde{a}_{\mathrm{imu},x} &= \ddot{q}_{\mathrm{x}} \sin {\theta} - g \cos {\theta} - l \dot{\theta}^{2}"
        in text
    )
    assert r"\tilde{R}_{\mathrm{imu}} &= \begin{pmatrix} \sin {\theta} & 0 & \cos {\theta} \\ 0 & 1 & 0" in text
    assert r"$\tilde{q}_{\mathrm{scale}}$ is the position in whole steps, m, measured by sensor \texttt{scale}" in text


def test_loads_that_redundant_joints_share_have_no_formula():
    twice = LOOP.replace("end: {type: revolute", "end: {type: revolute, compliance: 2").replace(
        "actuators:",
        """constraints:
  again: {type: distance, between: [ground, crank.tip], length: a}
actuators:""",
    )
    sensors = {one.sensor.name: one for one in symbolic_equations(parse_mechanism(twice)).sensors}
    assert "redundant" in sensors["pin"].reason and not sensors["pin"].values and sensors["end"].values
