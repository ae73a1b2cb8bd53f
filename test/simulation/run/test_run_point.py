"""A run continues from a snapshot bit for bit, whatever was commanded before it."""

import copy
import pickle

import numpy as np
import pytest

from mbd_sim import CommandError, Ensemble, MechanismError, Simulation
from mbd_sim.simulation.run.run_point import integrated_energies, joint_state_arrays, joint_state_names, recorded_state
from test.record_contents import contents

OPTIONS = {"live": ["gravity[2]", "joints.*.damping"], "wrenches": ["lower"]}


@pytest.fixture(scope="module")
def builds():
    return [Simulation.from_file("double_rod", **OPTIONS) for _ in range(2)]


def everything(sim):
    found = sim.state.tobytes(), sim.inputs.tobytes(), sim.steps, sim.time, sim.energies, sim.error_estimate
    return *found, sim.live, sim.efforts.tolist()


def disturbed(sim):
    sim.reset()
    sim.set_live({"gravity[2]": -9.81, "joints.elbow.damping": 0.0})
    sim.set_efforts([0.3, -0.2])
    sim.set_wrench("lower", force=[1.0, 2.0, -1.0], at=[0.0, 0.0, -0.3])
    sim.step(103)
    sim.set_live({"gravity[2]": -3.0, "joints.elbow.damping": 0.4})
    sim.step(40)


def test_a_run_continues_bit_for_bit_in_the_same_and_in_another_simulation(builds):
    sim, other = builds
    disturbed(sim)
    snapshot, before = pickle.loads(pickle.dumps(sim.snapshot())), everything(sim)
    sim.step(77)
    expected = everything(sim)
    sim.set_live({"gravity[2]": -1.0})
    sim.set_efforts([9.0, 9.0])
    sim.reset(q=[0.1, 0.2])
    for each in (sim, other):
        each.restore(snapshot)
        assert everything(each) == before
        each.step(77)
        assert everything(each) == expected
    other.set_live({"joints.elbow.damping": 0.1})  # the other live values are those of the snapshot
    assert other.live["gravity[2]"] == -3.0


def test_a_snapshot_does_not_follow_the_run(builds):
    sim = builds[0]
    disturbed(sim)
    snapshot, state = sim.snapshot(), sim.state
    sim.step(10)
    assert np.array_equal(snapshot.state, state) and snapshot.steps == sim.steps - 10


@pytest.mark.parametrize(
    ("options", "difference"),
    [
        ({"step": 2e-3}, "step in s: 0.001 instead of 0.002"),
        ({"wrenches": []}, "parts that accept wrenches"),
        ({"live": ["gravity[2]"]}, "live values"),
    ],
)
def test_a_snapshot_of_another_run_is_refused(builds, options, difference):
    other = Simulation.from_file("double_rod", **{**OPTIONS, **options})
    before = everything(other)
    with pytest.raises(ValueError, match=difference):
        other.restore(builds[0].snapshot())
    assert everything(other) == before


def test_a_state_alone_needs_its_time(builds):
    sim = builds[0]
    disturbed(sim)
    before, state = everything(sim), sim.state
    with pytest.raises(ValueError, match=r"restore\(state, steps=…\), or restore a snapshot"):
        sim.restore(state)
    with pytest.raises(TypeError, match="as a whole"):
        sim.restore(sim.snapshot(), steps=0)
    with pytest.raises(TypeError, match="as a whole"):
        sim.restore(sim.snapshot(), history=sim.history)
    assert everything(sim) == before
    sim.restore(state, steps=12)
    assert sim.steps == 12 and sim.state.tobytes() == state.tobytes()


def test_an_ensemble_continues_bit_for_bit():
    rods = Ensemble.from_file("double_rod", [{"l": 0.5}, {"l": 1.0}, {"l": 2.0}])
    rods.set_efforts({"elbow": [0.1, 0.2, 0.3]})
    rods.step(50)
    snapshot = pickle.loads(pickle.dumps(rods.snapshot()))
    rods.step(30)

    def everything():
        numbers = rods.state, rods.error_estimates, rods.alive, rods.energies.residual
        return *(array.tobytes() for array in numbers), rods.steps, rods.time

    expected = everything()
    rods.reset()
    rods.restore(snapshot)
    assert rods.steps == 50
    rods.step(30)
    assert everything() == expected
    with pytest.raises(ValueError, match="members: 3 instead of 1"):
        Ensemble.from_file("double_rod", 1).restore(snapshot)


PLANT = """
mechanism: plant
sensor_seed: 3
integrator: {step: 1 ms}
parts:
  arm: {mass: 2, center: [0, 0, -0.3], inertia: [0.06, 0.06, 0.001], points: {tip: [0, 0, -0.6]}}
  block: {mass: 1}
joints:
  hinge: {type: revolute, between: [ground, arm], axis: [0, -1, 0], position: 0.8, limits: {lower: -0.5, upper: 1.2}}
  rail: {type: prismatic, between: [ground, block], axis: [1, 0, 0], friction: {coulomb: 2, static: 3, sticking: true}}
forces:
  link: {type: spring, between: [arm.tip, block], stiffness: 60, length: 0.3}
actuators:
  drive:
    type: dc_motor
    joint: hinge
    torque_constant: 0.05
    resistance: 1.2
    inductance: 2 mH
    gear_ratio: 20
    servo: {controls: position, kp: 30, ki: 20, kd: 1, sample_rate: 250 Hz}
    delay: 3 ms
sensors:
  imu: {type: imu, at: arm.tip, rate: 200 Hz, delay: 12 ms, angular_velocity: {noise_density: 0.01, bias_walk: 0.001}, drop_out: 0.2}
  angle: {type: encoder, joint: hinge, resolution: 0.001, rate: 100 Hz, delay: 20 ms}
"""
OTHERS = ["rocking", "backlash", "slider_crank_friction", "tippe_top", "hydraulic_scissor_lift", "balancing_pendulum"]


def all_of(sim):
    """The state and everything that can be read of sensors, actuators and contacts."""
    measured = {
        name: (one.time, one.sample, {k: v.tolist() for k, v in one.values.items()})
        for name, one in sim.sensors().items()
    }
    return *everything(sim), sim.samples.tobytes(), measured, contents(sim.actuators()), contents(sim.contacts())


@pytest.mark.parametrize("name", ["plant", *OTHERS])
def test_contacts_actuators_and_sensors_continue_bit_for_bit(name):
    def build():
        return Simulation.from_text(PLANT) if name == "plant" else Simulation.from_file(name)

    sim = build()
    if name == "plant":
        sim.set_commands({"drive": 1.0})
        sim.step(601)
        sim.set_commands({"drive": -0.4})  # still on its way at the snapshot
        sim.step(2)
    else:
        sim.step(397)
    snapshot, copies = pickle.loads(pickle.dumps(sim.snapshot())), [sim.copy(), copy.copy(sim), copy.deepcopy(sim)]
    before = all_of(sim)
    sim.step(311)
    expected = all_of(sim)
    for other in (build(), *copies[:1], sim):
        if other is not copies[0]:
            other.restore(snapshot)
        assert all_of(other) == before
        for part in (1, 10, 300):
            other.step(part)
        assert all_of(other) == expected
    assert all(all_of(one) == before and type(one) is Simulation for one in copies[1:])


def test_a_copy_goes_on_by_itself(builds):
    sim = builds[0]
    disturbed(sim)
    other, before = sim.copy(), everything(sim)
    other.set_live({"gravity[2]": -1.0})
    other.set_efforts([5.0, 5.0])
    other.step(20)
    assert everything(sim) == before and other.live["gravity[2]"] == -1.0
    with pytest.raises(TypeError, match=r"Pickle its snapshot\(\)"):
        pickle.dumps(sim)


def test_a_reset_takes_coordinates_and_speeds_by_name():
    sim = Simulation.from_file("double_rod")
    start = sim.q.copy()
    sim.step(50)
    sim.reset(q={"elbow": 0.3}, u={"shoulder": -1.0})
    assert sim.steps == 0 and sim.q.tolist() == [start[0], 0.3] and sim.u.tolist() == [-1.0, 0.0]
    assert sim.energies.residual == 0.0
    before = everything(sim)
    for arguments in ({"q": {"elbo": 0.3}}, {"u": {"elbow": np.nan}}):
        with pytest.raises(CommandError, match="elbow"):
            sim.reset(**arguments)
        assert everything(sim) == before


def test_coordinates_by_name_stay_while_a_loop_follows():
    sim = Simulation.from_file("four_bar")
    first = sim.coordinate_names[0]
    sim.reset(q={first: float(sim.q[0]) + 0.4}, u={first: 2.0})
    assert sim.q[0] == sim.model.start[0] + 0.4 and sim.u[0] == 2.0
    assert sim.violation.position < 1e-12 and sim.violation.velocity < 1e-12


def test_parameters_are_given_by_name():
    one = Simulation.from_file("double_rod", parameters={"l": 0.8})
    other = Simulation.from_file("double_rod", set={"parameters.l": 0.8})
    for sim in (one, other):
        sim.step(10)
    assert one.state.tobytes() == other.state.tobytes() and one.mechanism.parameters["l"] == 0.8
    with pytest.raises(MechanismError, match="length"):
        Simulation.from_file("double_rod", parameters={"length": 0.8})
    with pytest.raises(ValueError, match="'l' is given in `set` and in `parameters`"):
        Simulation.from_file("double_rod", set={"l": 1.0}, parameters={"l": 0.8})


@pytest.mark.parametrize("mechanism", ["double_rod", "spherical_top", "tumbling", "moving_support_pendulum"])
def test_the_state_is_recovered_from_its_joint_states(mechanism):
    simulation = Simulation.from_file(mechanism)
    start = simulation.state
    simulation.step(50)
    model = simulation.model
    position, velocity, effort = joint_state_arrays(model, simulation.time, simulation.y, simulation.inputs)
    assert len(position) == len(velocity) == len(effort) == len(joint_state_names(model))
    state = recorded_state(model, start, position, velocity)
    state[-3:] = integrated_energies(simulation.energies)
    poses = (model.pose_array(simulation.time, y, simulation.inputs) for y in (state, simulation.y))
    np.testing.assert_allclose(*poses, rtol=0.0, atol=1e-13)  # a quaternion and its negative are the same orientation
    np.testing.assert_array_equal(state[model.u_range], simulation.u)
    np.testing.assert_array_equal(state[-3:], simulation.y[-3:])
    assert np.any(state != start)


def test_driven_coordinates_come_last_with_the_forces_of_their_drives():
    simulation = Simulation.from_file("moving_support_pendulum")
    simulation.step(50)
    model = simulation.model
    names = joint_state_names(model)
    arrays = joint_state_arrays(model, simulation.time, simulation.y, simulation.inputs)
    drives = simulation.drives()
    assert names[-len(drives) :] == tuple(drives)
    for index, name in enumerate(names[-len(drives) :], len(names) - len(drives)):
        assert tuple(values[index] for values in arrays) == tuple(drives[name])
