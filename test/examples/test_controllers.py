"""The control examples as real nodes beside a real `sim_node`, on simulated time alone."""

import math
import signal

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64MultiArray, Header

from mbd_sim import Simulation
from mbd_sim.examples.cascade.cascade import PositionLoop
from mbd_sim.examples.computed_torque.computed_torque import ComputedTorque, sway
from mbd_sim.examples.control_node import Answered
from mbd_sim.examples.imu_balance.imu_balance import Balance
from mbd_sim.examples.pd_hold.pd_hold import PdHold, PdHoldNode
from mbd_sim.examples.swing_up.swing_up import SwingUp, SwingUpNode
from mbd_sim.recordings.run.verification import verify
from test.examples.programs import beside, lockstep
from test.system.growing_recordings import recorded_states
from test.system.nodes import nanoseconds, new_domain
from test.waiting import PATIENCE


def seconds(listener):
    return 1e-9 * nanoseconds(listener.states[-1].header.stamp)


def looped(sim, law, steps, count):
    """States of a simulation under a law of (time, q, u), without ROS."""
    states = [(*sim.q, *sim.u)]
    for _ in range(count):
        sim.set_efforts(law(sim.time, sim.q, sim.u))
        sim.step(steps)
        states.append((*sim.q, *sim.u))
    return states


def test_the_pendulum_is_caught_and_stays_up(tmp_path):
    """How it swings up is a matter of the law alone, which is tested without a node."""
    parameters = {**lockstep("cart_pendulum", 200), "record": True, "record_dir": tmp_path, "start": "pin = 2.9"}
    with beside(tmp_path, parameters, "swing_up.swing_up") as experiment:
        experiment.listener.until(lambda: seconds(experiment.listener) > 1.2, "1.2 s")
        assert experiment.node.end() == 0
    states = recorded_states(tmp_path)
    assert list(states)[:-1] == list(range(0, max(states), 5))  # the last one: where the node ended
    late = [state.position[1] for tick, state in states.items() if tick > 1000]
    assert max(abs(math.remainder(angle - math.pi, 2 * math.pi)) for angle in late) < 0.1
    assert "balancing" in experiment.log.read_text()


def test_the_pendulum_is_balanced_on_noisy_measurements(tmp_path):
    """Each measurement of the inertial sensor, in another process, triggers the steps to the next one."""
    parameters = {**lockstep("balancing_pendulum", 200), "publish_rate": 100.0, "record": True, "record_dir": tmp_path}
    with beside(tmp_path, parameters, "imu_balance.imu_balance", "resume:=false") as experiment:
        experiment.listener.until(lambda: seconds(experiment.listener) > 3.1, "3.1 s")
        assert experiment.node.end() == 0
    states = recorded_states(tmp_path)
    assert list(states)[:-1] == list(range(0, max(states), 5))  # the last one: where the node ended
    assert max(abs(math.degrees(state.position[1])) for tick, state in states.items() if tick > 3000) < 0.5
    assert max(abs(state.position[0]) for state in states.values()) < 0.3
    assert "fallen" not in experiment.log.read_text()
    (recorded,) = tmp_path.glob("*.mcap")
    (found,) = verify(recorded)
    assert found.agrees, found
    assert found.compared["sensors"] > 1150


def test_a_controller_resumes_the_simulator_that_waits_for_it(tmp_path):
    parameters = {"mechanism": "balancing_pendulum", "start_paused": True, "record": False}
    with beside(tmp_path, parameters, "imu_balance.imu_balance") as experiment:
        listener = experiment.listener
        listener.until(lambda: seconds(listener) > 0.3, "0.3 s in real time")
    assert "balancing 'balancing_pendulum'" in experiment.log.read_text()


def test_the_tilt_is_that_of_the_accelerometer_without_the_drift_of_the_rate_gyro():
    sim = Simulation.from_file("balancing_pendulum")
    law, names = Balance(sim.mechanism), [sensor.name for sensor in sim.mechanism.sensors]
    for _ in range(10_000):
        sim.step()
        for number, _ in sim.arrivals:
            found = sim.sensors()[names[number]]
            if names[number] == "wheel":
                law.measure_cart(found.time, found["position"][0])
            else:
                forward, _, upward = found["specific_force"]
                sim.set_efforts([law.force(found.time, found["angular_velocity"][1], forward, upward), 0.0])
    assert abs(math.degrees(sim.q[1])) < 0.2
    assert math.degrees(law.filter.tilt - sim.q[1]) == pytest.approx(-math.degrees(0.05 / 9.81), abs=0.1)
    assert math.degrees(law.filter.bias) == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("start", [[0.0, 0.0], [-0.8, 1.0]])
def test_swinging_up_succeeds_from_anywhere_and_one_period_late(start):
    sim = Simulation.from_file("cart_pendulum")
    law, force = SwingUp(sim.mechanism), 0.0
    sim.reset(q=start)
    for _ in range(200 * 10):
        sim.set_efforts([force, 0.0])
        force = law.force(sim.q, sim.u)
        sim.step(5)
        assert abs(sim.q[0]) < 1.9
    assert abs(math.remainder(sim.q[1] - math.pi, 2 * math.pi)) < 1e-3


def test_a_state_is_answered_once_and_again_when_its_answer_must_have_been_lost():
    answered = Answered()
    received = [(1.0, 0), (2.0, 1), (2.0, 1), (3.0, 2), (3.0, 2), (3.0, 2), (3.0, 2), (3.0, 2), (0.5, 2)]
    states = [JointState(header=Header(stamp=Time(sec=sec)), position=[position]) for position, sec in received]
    accepted = [answered.accepts(state) for state in states]
    assert accepted == [True, True, False, True, False, True, False, True, True]  # the last one: after a reset


def test_the_double_pendulum_is_held_at_its_target(tmp_path):
    parameters = {**lockstep("double_pendulum", 200), "start": "shoulder = 1.99, elbow = 0.79"}
    with beside(tmp_path, parameters, "pd_hold.pd_hold", "target:=[2.0, 0.8]") as experiment:
        listener = experiment.listener
        listener.until(lambda: seconds(listener) > 1.0, "1 s")
        assert list(listener.states[-1].position) == pytest.approx([2.0, 0.8], abs=1e-3)


def test_the_weight_is_carried():
    sim = Simulation.from_file("double_pendulum")
    law = PdHold(sim.mechanism)
    looped(sim, lambda _, q, u: law.efforts(q, u, np.array([-1.0, 1.5])), 5, 1000)
    assert sim.q == pytest.approx([-1.0, 1.5], abs=1e-5)


def test_the_arm_on_a_motor_reaches_one_target_after_the_other(tmp_path):
    options = {**lockstep("motor_drive", 100), "step_count": 40, "record": True, "record_dir": "logs"}
    with beside(tmp_path, options, "cascade.cascade", "targets:=[0.3, 0.1]", "period:=0.6") as experiment:
        listener = experiment.listener
        listener.until(lambda: seconds(listener) > 1.2, "both targets")
        assert experiment.node.end(signal.SIGINT) == 0
    states = recorded_states(tmp_path / "logs")
    assert states[40 * 59].position[0] == pytest.approx(0.3, abs=5e-3)
    assert states[40 * 119].position[0] == pytest.approx(0.1, abs=5e-3)
    assert max(abs(state.effort[0]) for state in states.values()) > 10.0  # that of the motor
    (path,) = (tmp_path / "logs").glob("motor_drive_*.mcap")
    (verification,) = verify(path)
    assert verification.is_intact and verification.agrees and verification.commands["applied_commands"] > 50


def test_the_drive_keeps_current_and_energies_while_a_cascade_turns_the_arm():
    sim, loop, currents = Simulation.from_file("motor_drive"), PositionLoop(), []
    for target in (2.5, -1.0, 1.2):
        for _ in range(150):
            sim.set_commands({"drive": loop.velocity(sim.q[0], target)})
            sim.step(40)
            currents.append(abs(sim.actuators()["drive"].current))
        assert sim.q[0] == pytest.approx(target, abs=2e-3)
    assert 7.9 < max(currents) <= 8.0 * (1.0 + 1e-12)
    account = sim.actuators()["drive"].energies
    assert abs(account.residual) < 1e-9 * account.electrical_work
    assert abs(sim.energies.residual) < 1e-9 * sim.energies.work_applied


def test_the_arm_follows_its_reference(tmp_path):
    errors = []
    with beside(
        tmp_path, lockstep("six_axis_arm", 500), "computed_torque.computed_torque", "frequency:=0.5"
    ) as experiment:
        listener = experiment.listener
        listener.node.create_subscription(
            Float64MultiArray, "computed_torque/tracking_error", lambda m: errors.append(m.data.tolist()), 1000
        )
        listener.until(lambda: len(errors) > 150, "errors")
        assert min(np.ptp([state.position for state in listener.states], axis=0)) > 0.1
        assert np.max(np.abs(errors)) < 5e-3


def test_faster_control_follows_more_closely():
    off = {}
    for steps in (4, 1):
        sim = Simulation.from_file("six_axis_arm")
        law, home = ComputedTorque(sim.mechanism), sim.q.copy()
        looped(sim, lambda t, q, u: law.efforts(q, u, sway(home, 0.8, 0.25, t)), steps, 1000 // steps)  # noqa: B023
        off[steps] = np.max(np.abs(sim.q - sway(home, 0.8, 0.25, sim.time).q))
    assert off[1] < 0.3 * off[4] < 1e-3


# Two joints on a third one, which is driven: it is among the joint states, and takes no efforts.
SHAKEN = """
mechanism: shaken
parts:
  support: {mass: 0}
  upper: {shape: {type: rod, to: [0, 0, -0.5], mass: 1}, points: {tip: [0, 0, -0.5]}}
  lower: {shape: {type: rod, to: [0, 0, -0.5], mass: 1}}
joints:
  shaker: {type: prismatic, between: [ground, support], axis: [1, 0, 0], drive: 0.1*sin(5*t)}
  shoulder: {type: revolute, between: [support, upper], axis: [0, -1, 0]}
  elbow: {type: revolute, between: [upper.tip, lower], axis: [0, -1, 0]}
"""


def test_keys_and_a_joystick_become_efforts_of_joints_that_take_some(tmp_path):
    (tmp_path / "shaken.yaml").write_text(SHAKEN, encoding="utf-8")
    with beside(
        tmp_path, {"mechanism": "shaken.yaml"}, "teleop.teleop", "effort_step:=0.25", keyboard=True
    ) as experiment:
        keyboard, listener = experiment.program, experiment.listener

        def press(keys, efforts):
            keyboard.stdin.write(keys.encode())
            keyboard.stdin.flush()
            listener.until(lambda: list(listener.states[-1].effort[:2]) == efforts, f"the efforts of {keys!r}")

        def names_the_joints():
            keyboard.stdin.write(b" ")
            keyboard.stdin.flush()
            listener.spin(0.2)
            return "shoulder +0.00" in experiment.log.read_text()

        listener.until(names_the_joints, "the node")
        press("dd", [0.5, 0.0])
        press("2\x1b[D", [0.5, -0.25])
        press(" ", [0.0, 0.0])
        assert "rejected" not in experiment.node.text
        joystick = listener.node.create_publisher(Joy, "joy", 10)
        listener.until(joystick.get_subscription_count, "matching")
        joystick.publish(Joy(axes=[0.5, -1.0]))
        listener.until(lambda: list(listener.states[-1].effort[:2]) == [2.5, -5.0], "the stick's efforts")
        keyboard.stdin.write(b"q")
        keyboard.stdin.flush()
        assert keyboard.wait(PATIENCE) == 0
    assert "elbow -0.25" in experiment.log.read_text()


def test_a_joystick_and_keys_move_joints_with_servos_from_where_they_are(tmp_path):
    simulator = {"mechanism": "six_axis_servo_arm", "start": "base = 0.3, elbow = 0.1"}
    with beside(
        tmp_path, simulator, "teleop.teleop", "command:=position", "position_step:=0.2", keyboard=True
    ) as experiment:
        keyboard, listener = experiment.program, experiment.listener
        joystick = listener.node.create_publisher(Joy, "joy", 10)
        listener.until(joystick.get_subscription_count, "matching")

        def names_the_joints():
            keyboard.stdin.write(b"\n")
            keyboard.stdin.flush()
            listener.spin(0.2)
            return "base +0.30" in experiment.log.read_text()

        listener.until(names_the_joints, "the positions")
        keyboard.stdin.write(b"1d")
        keyboard.stdin.flush()
        listener.until(lambda: abs(listener.states[-1].position[0] - 0.5) < 0.02, "the position of the base")
        joystick.publish(Joy(axes=[0.0, 0.5]))  # up to 0.5 rad
        listener.until(lambda: abs(listener.states[-1].position[1] - 0.25) < 0.02, "the position of the shoulder")
        listener.until(lambda: abs(listener.states[-1].position[0]) < 0.02, "the base in the middle of its axis")
        assert "rejected" not in experiment.node.text


def test_parameters_that_do_not_fit_or_act_at_the_start_alone_are_refused():
    rclpy.init(domain_id=new_domain())
    try:
        node = PdHoldNode()
        assert not node.set_parameters([Parameter("target", value=[1.0])])[0].successful
        assert not node.set_parameters([Parameter("target", value=[1.0, math.nan])])[0].successful
        assert node.set_parameters([Parameter("target", value=[1.0, 0.5])])[0].successful
        assert not node.set_parameters([Parameter("stiffness", value=80.0)])[0].successful
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_a_controller_of_another_mechanism_reports_it(capfd):
    rclpy.init(args=["--ros-args", "--log-level", "INFO"], domain_id=new_domain())  # tests before may have raised it
    try:
        node = SwingUpNode()
        node._on_state(JointState(name=["shoulder", "pin"], position=[0.0, 0.0], velocity=[0.0, 0.0]))
        node.destroy_node()
    finally:
        rclpy.shutdown()
    assert "joint_states lacks rail: does the simulator run 'cart_pendulum'?" in capfd.readouterr().err
