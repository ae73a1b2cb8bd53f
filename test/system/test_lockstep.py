"""Lockstep with a real node: the same bits as without ROS, and an orderly beginning and end."""

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from mbd_sim import CommandError
from mbd_sim.examples.pd_hold.pd_hold import PdHold
from mbd_sim.ros.node.lockstep import Lockstep, LockstepError
from test.system.nodes import as_in_the_node, nanoseconds, running
from test.system.test_actuator_node import ARM
from test.waiting import PATIENCE


@pytest.fixture(scope="module")
def listener(tmp_path_factory):
    with running(tmp_path_factory.mktemp("lockstep"), mechanism="double_pendulum", publish_rate=50) as (_, received):
        yield received


def test_control_cycles_give_the_same_bits_as_without_ros(listener):
    sim = as_in_the_node("double_pendulum")
    law, target = PdHold(sim.mechanism, stiffness=15.0, damping=0.4), np.array([2.0, 0.8])
    with Lockstep(steps=4, context=listener.context, timeout=PATIENCE) as lockstep:
        for cycles in (10, 200):  # the second time after a reset in mid-motion
            state = lockstep.reset()
            sim.reset()
            for cycle in range(cycles):
                assert (state.q.tolist(), state.u.tolist()) == (sim.q.tolist(), sim.u.tolist()), f"cycle {cycle}"
                assert state.time == pytest.approx(sim.time, abs=1e-9)
                state = lockstep.step(law.efforts(state.q, state.u, target))
                sim.set_efforts(law.efforts(sim.q, sim.u, target))
                sim.step(4)
                assert state.efforts.tolist() == sim.efforts.tolist()
        assert lockstep.names == ("shoulder", "elbow")


def test_the_parameters_of_the_simulator_are_restored_and_mistakes_are_reported(listener):
    listener.set_parameter("step_on_command", False)
    listener.set_parameter("publish_rate", 50.0)
    with Lockstep(context=listener.context, timeout=PATIENCE) as lockstep:
        assert listener.parameter("step_on_command") is True
        with pytest.raises(CommandError, match="not finite"):
            lockstep.step([np.nan, 0.0])
        lockstep.timeout = 1.0
        with pytest.raises(LockstepError, match="its log says why"):
            lockstep.step([1.0])
        lockstep.timeout = PATIENCE
        assert lockstep.step([1.0, 0.0]).time == pytest.approx(0.001)
    assert listener.parameter("step_on_command") is False
    assert listener.parameter("publish_rate") == 50.0
    with pytest.raises(LockstepError, match="'other' did not answer"):
        Lockstep("other", context=listener.context, timeout=0.2)


def test_each_command_brings_its_steps_while_paused(listener):
    listener.ready_to_command()
    listener.pause(True)
    listener.set_parameter("reset_rewinds_clock", True)
    listener.reset()
    listener.set_parameter("step_count", 10)
    listener.set_parameter("publish_rate", 0.0)
    listener.set_parameter("step_on_command", True)
    listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) == 0, "the reset")
    listener.by_name.publish(JointState(name=["elbow"], effort=[2.0]))
    listener.until(lambda: listener.states[-1].effort[1] == 2.0, "the steps")
    listener.by_order.publish(Float64MultiArray(data=[1.0]))  # rejected: no steps
    listener.by_order.publish(Float64MultiArray(data=[1.0, 3.0]))
    listener.until(lambda: listener.states[-1].effort[1] == 3.0, "the steps")
    stamps = {nanoseconds(state.header.stamp) for state in listener.states if state.effort[1] in (2.0, 3.0)}
    assert stamps == {10_000_000, 20_000_000}


def test_actuators_in_lockstep_give_the_same_bits_as_without_ros(tmp_path):
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    sim = as_in_the_node(tmp_path / "arm.yaml")
    with (
        running(tmp_path, mechanism=str(tmp_path / "arm.yaml"), start_paused=True) as (_, listener),
        Lockstep(steps=3, context=listener.context, timeout=PATIENCE) as lockstep,
    ):
        state = lockstep.reset()
        for cycle in range(40):
            assert (state.q.tolist(), state.u.tolist()) == (sim.q.tolist(), sim.u.tolist()), f"cycle {cycle}"
            target, torque = 0.2 + np.sin(0.1 * cycle), -0.3 * state.u[1] + 0.01
            state = lockstep.command([target, 0.1, torque])
            sim.set_commands({"drive": {"position": target, "velocity": 0.1}, "spin": torque})
            sim.step(3)
        with pytest.raises(CommandError, match="a command is not finite"):
            lockstep.command([np.inf, 0.0, 0.0])
    assert abs(state.q[0] - 0.2) > 0.2
