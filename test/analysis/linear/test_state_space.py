"""Linear systems with chosen inputs and outputs, against closed forms and against differences of the equations."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError, MbdSimError

G = 9.81
FREQUENCIES = np.geomspace(0.1, 30.0, 40)

OSCILLATOR = """
mechanism: oscillator
parts: {table: {mass: 5}, mass: {mass: 2}}
joints:
  shaker: {type: prismatic, between: [ground, table], axis: [0, 0, 1], drive: MOTION}
  spring: {type: prismatic, between: [table, mass], axis: [0, 0, 1], stiffness: 800, damping: 8}
"""


def transmissibility(frequencies):
    """(c s + k) / (m s² + c s + k)."""
    s = 2j * np.pi * frequencies
    return (8 * s + 800) / (2 * s**2 + 8 * s + 800)


@pytest.mark.parametrize(
    ("text", "source"),
    [
        (OSCILLATOR.replace("MOTION", '"0.01*sin(3*t)"'), "drives.shaker"),
        (OSCILLATOR.replace("MOTION", "{command: position, bandwidth: 20}"), "drives.shaker"),
        (
            OSCILLATOR.replace(
                "prismatic, between: [ground, table], axis: [0, 0, 1], drive: MOTION", "fixed, between: [ground, table]"
            ),
            "base.z",
        ),
    ],
)
def test_the_transmissibility_of_an_oscillator_on_a_shaker(text, source):
    sim = Simulation.from_text(text, step=1e-3)
    sim.run(0.05)
    system = sim.state_space([source], ["points.mass.acceleration.z", "joints.spring.force.z"])
    found = system.response(FREQUENCIES)[:, :, 0]
    exact = transmissibility(FREQUENCIES)
    assert found[:, 0] == pytest.approx(exact, rel=1e-9)
    assert found[:, 1] == pytest.approx(2 * exact, rel=1e-9)  # the spring carries the mass


def test_the_command_of_a_drive_acts_through_its_filter():
    """Poles at -ω, -ω and -4 ω: see `mbd_sim.dynamics.kinematics.drives`."""
    sim = Simulation.from_text(OSCILLATOR.replace("MOTION", "{command: position, bandwidth: 20}"))
    system = sim.state_space(["commands.shaker.position"], ["joints.shaker.position", "points.mass.position.z"])
    s = 2j * np.pi * FREQUENCIES
    follower = 20 * 20 * 80 / ((s + 20) ** 2 * (s + 80))
    found = system.response(FREQUENCIES)[:, :, 0]
    assert found[:, 0] == pytest.approx(follower, rel=1e-9)
    assert found[:, 1] == pytest.approx(follower * transmissibility(FREQUENCIES), rel=1e-9)
    with pytest.raises(CommandError, match="commands of this drive are inputs as well"):
        sim.state_space(["commands.shaker.position", "drives.shaker"])


MOTOR = """
mechanism: motor
parts: {rotor: {mass: 1, inertia: {xx: 0.01, yy: 0.01, zz: 0.02}}}
joints: {axle: {type: revolute, between: [ground, rotor], axis: [0, 0, 1]}}
actuators: {motor: {type: dc_motor, joint: axle, torque_constant: 0.5, resistance: 2, inductance: 0.1}}
"""


def test_the_voltage_of_a_motor():
    """k / (J s (L s + R) + k²) to the speed, and J s / (…) to the current, which is a state."""
    names = ["joints.axle.velocity", "actuators.motor.current"]
    system = Simulation.from_text(MOTOR).state_space("commands.motor.voltage", names)
    s = 2j * np.pi * FREQUENCIES
    denominator = 0.02 * s * (0.1 * s + 2) + 0.25
    found = system.response(FREQUENCIES)[:, :, 0]
    assert system.states[-1] == "actuators.motor.current"
    assert found == pytest.approx(np.column_stack([0.5 / denominator, 0.02 * s / denominator]), rel=1e-9)


CART = """
mechanism: cart
parts:
  cart: {mass: 1.5}
  rod: {mass: 0.4, center: [0, 0, 0.6], inertia: {xx: 0.02, yy: 0.03, zz: 0.01}, points: {tip: [0, 0, 1]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], damping: 0.2}
  hinge: {type: revolute, between: [cart, rod], axis: [0, 1, 0]}
sensors:
  imu: {type: imu, at: rod.tip, orientation: {}}
  load: {type: force_torque, joint: hinge}
"""


def test_a_pendulum_on_a_cart():
    """(M + m) x'' + m l θ'' = F - c x',  m l x'' + (I + m l²) θ'' = m g l θ, upright."""
    system = Simulation.from_text(CART).state_space(["efforts.rail"])
    m, inertia = 0.4 * 0.6, 0.03 + 0.4 * 0.6**2
    mass, stiffness = np.array([[1.9, m], [m, inertia]]), np.diag([0.0, -m * G])
    a = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, np.diag([0.2, 0.0]))],
        ]
    )
    assert system.a == pytest.approx(a, rel=1e-13, abs=1e-13)
    assert system.b[:, 0] == pytest.approx([0, 0, *np.linalg.solve(mass, [1.0, 0.0])], rel=1e-13)
    assert system.states == (
        "joints.rail.position", "joints.hinge.position", "joints.rail.velocity", "joints.hinge.velocity"
    )  # fmt: skip
    assert (system.c == np.eye(4)[:2]).all() and not system.d.any()


def test_python_control_and_scipy_have_the_same_system():
    pytest.importorskip("control")
    signal = pytest.importorskip("scipy.signal")
    system = Simulation.from_text(CART).state_space(
        ["efforts.rail", "base.x"], ["joints.hinge.position", "sensors.imu"]
    )
    own = system.response(FREQUENCIES)
    same = system.control()
    assert same.input_labels == ["efforts_rail", "base_x"] and same.output_labels[0] == "joints_hinge_position"
    assert np.moveaxis(same(2j * np.pi * FREQUENCIES), -1, 0) == pytest.approx(own, rel=1e-9, abs=1e-12)
    plain = OSCILLATOR.replace("MOTION", "0*t")
    single = Simulation.from_text(plain).state_space(["efforts.spring"], ["joints.spring.acceleration"])
    _, found = signal.freqresp(single.scipy(), 2 * np.pi * FREQUENCIES)
    s = 2j * np.pi * FREQUENCIES
    assert found == pytest.approx(s**2 / (2 * s**2 + 8 * s + 800), rel=1e-9)


DRIVEN_LOOP = """
mechanism: loop
parameters: {r: 0, v: 3, a: 2}
ground: {points: {right: [3, 0, 0]}}
parts:
  crank:   {mass: 3, shape: {type: rod, to: [1, 0, 0]}, points: {pin: [1, 0, 0]}}
  coupler: {mass: 8, shape: {type: rod, to: [2.8, 0, 0]}, points: {pin: [2.8, 0, 0]}}
  rocker:  {mass: 6, shape: {type: rod, to: [2.2, 0, 0]}, points: {pin: [2.2, 0, 0]}}
joints:
  motor:      {type: revolute, between: [ground, crank], axis: [0, -1, 0], drive: "1.05 + r + v*t + a*t^2/2"}
  crank_pin:  {type: revolute, between: [crank.pin, coupler], axis: [0, -1, 0]}
  rocker_pin: {type: revolute, between: [coupler.pin, rocker.pin], axis: [0, -1, 0]}
  pivot:      {type: revolute, between: [ground.right, rocker], axis: [0, -1, 0], position: 100 deg, guess: true}
"""
LOOP_OUTPUTS = [
    "joints.motor.effort", "joints.pivot.position", "joints.pivot.velocity", "joints.pivot.acceleration",
    "points.coupler.pin", "joints.crank_pin.force", "joints.pivot.moment",
]  # fmt: skip


def test_a_driven_linkage_against_differences_of_its_drive():
    """It has no states of its own: position, velocity and acceleration of the drive determine everything."""

    def outputs(**changed):
        sim.set_live({"r": 0.0, "v": 3.0, "a": 2.0} | changed, reassemble=True)
        sim.reset()
        pivot = sim.coordinate_names.index("pivot")
        pin, motor = sim.motion("coupler.pin"), sim.drives()["motor"]
        loads = sim.reactions()
        return np.concatenate([
            [motor.force, sim.q[pivot], sim.u[pivot], sim.u_rates[pivot]],
            pin.pose.position, pin.pose.rotation.ravel(), pin.velocity, pin.angular_velocity, pin.acceleration,
            pin.angular_acceleration, loads["crank_pin"].force, loads["pivot"].moment,
        ])  # fmt: skip

    sim = Simulation.from_text(DRIVEN_LOOP, live=["r", "v", "a"])
    system = sim.state_space(["drives.motor"], LOOP_OUTPUTS)
    rotation = sim.motion("coupler.pin").pose.rotation.copy()
    assert system.states == ("drives.motor.position", "drives.motor.velocity")
    found = np.column_stack([system.c, system.d])
    h = 1e-5
    for column, (name, value) in enumerate({"r": 0.0, "v": 3.0, "a": 2.0}.items()):
        slope = (outputs(**{name: value + h}) - outputs(**{name: value - h})) / (2 * h)
        rates = slope[7:16].reshape(3, 3)
        turn = (rates @ rotation.T)[[2, 0, 1], [1, 2, 0]]
        expected = np.concatenate([slope[:7], turn, slope[16:]])
        assert found[:, column] == pytest.approx(expected, rel=2e-8, abs=2e-7), name


def test_sensors_loads_and_forces_against_differences():
    """Of a cart pendulum in motion: C by the states, and D by a force at a point."""
    sim = Simulation.from_text(CART, wrenches=["rod"])
    q, u = np.array([0.1, 0.5]), np.array([0.3, -1.2])
    names = ["points.rod.tip.acceleration", "joints.hinge.force", "sensors.load", "sensors.imu.specific_force"]

    def outputs(state, force):
        sim.reset(q=state[:2], u=state[2:])
        sim.set_wrench("rod", force=force, at=[0.0, 0.0, 1.0])
        load, imu = sim.sensors()["load"], sim.sensors()["imu"]
        hinge = sim.reactions()["hinge"]
        values = sim.motion("rod.tip").acceleration, hinge.force, load["force"], load["torque"], imu["specific_force"]
        return np.concatenate(values)

    state, h = np.concatenate([q, u]), 1e-5
    sim.reset(q=q, u=u)
    system = sim.state_space(["forces.rod.tip", "efforts.hinge"], names)
    for column in range(4):
        change = h * np.eye(4)[column]
        slope = (outputs(state + change, np.zeros(3)) - outputs(state - change, np.zeros(3))) / (2 * h)
        assert system.c[:, column] == pytest.approx(slope, rel=1e-7, abs=1e-7)
    rotation = sim.motion("rod").pose.rotation
    for column in range(3):  # a sensor measures at the next step
        slope = (outputs(state, np.eye(3)[column]) - outputs(state, np.zeros(3)))[:6]
        assert system.d[:6, column] == pytest.approx(slope, rel=1e-9, abs=1e-9)
        assert system.d[6:9, column] == pytest.approx(rotation.T @ slope[3:6], rel=1e-9, abs=1e-9)
        assert system.d[12:15, column] == pytest.approx(rotation.T @ slope[:3], rel=1e-9, abs=1e-9)


def test_rolling_has_fewer_speeds_than_displacements():
    """An upright disc: five directions of motion of the three that roll; a push at its centre accelerates it by 2 F/3 m."""
    sim = Simulation.from_file("rolling_disc")
    sim.reset(q=[0, 0, 0.5, 1, 0, 0, 0], u=[0, 0, 0, 0, 0, 0])
    system = sim.state_space(["forces.disc.x"], ["points.disc.acceleration.x", "points.disc.velocity.x"])
    assert [name.split("_")[0] for name in system.states] == ["displacement"] * 5 + ["speed"] * 3
    assert system.d[:, 0] == pytest.approx([2 / 3 / sim.mechanism.parts["disc"].mass, 0.0], abs=1e-12)


def test_unknown_names_are_refused_with_the_nearest_one():
    sim = Simulation.from_text(CART)
    with pytest.raises(CommandError, match=r"no input 'efforts.rial'.*efforts\.rail"):
        sim.state_space(["efforts.rial"])
    with pytest.raises(CommandError, match=r"no output 'points.rod.tip.speed'"):
        sim.state_space(outputs=["points.rod.tip.speed"])


def test_forces_of_closed_contacts_are_refused():
    sim = Simulation.from_file("incline")
    sim.run(0.2)
    with pytest.raises(MbdSimError, match="forces of closed contacts"):
        sim.state_space(outputs=[f"points.{sim.model.part_names[0]}.acceleration"])


def test_every_reading_of_a_cylinder_is_an_output():
    """Among them the work of compression, whose unit was missing, so that nothing could be chosen."""
    system = Simulation.from_file("hydraulic_scissor_lift").state_space(outputs=["actuators"])
    assert {"actuators.cylinder.displaced", "actuators.cylinder.stored"} <= set(system.outputs)
