"""Efforts on their way to the simulation: accepted or rejected whole, expiring."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.dynamics.layouts.vectors import InputLayout
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.simulation.model.commands import EffortMap


@pytest.fixture
def buffer() -> CommandBuffer:
    return CommandBuffer(EffortMap(["hip", "knee", "ankle"], np.array([np.inf, 5.0, np.inf])), timeout=0.5)


def test_nothing_is_due_before_a_command(buffer):
    assert buffer.due(0.0) == []


def test_a_command_is_due_once_as_given_and_counted_if_it_is_beyond_limits(buffer):
    buffer.by_order([1.0, -7.0, 3.0])
    (due,) = buffer.due(0.0)
    assert (due.efforts.tolist(), due.expired) == ([1.0, -7.0, 3.0], ())  # the simulation clamps
    assert (buffer.due(0.001), buffer.limited) == ([], 1)
    assert [buffer.take_excess(), buffer.take_excess()] == ["the effort -7 of 'knee' is beyond 5", ""]
    buffer.by_order([1.0, -5.0, 3.0])
    assert buffer.limited == 1


def test_names_leave_the_other_efforts_and_add_up_between_two_steps(buffer):
    buffer.by_order([1.0, 2.0, 3.0])
    buffer.by_name(["ankle"], [9.0])
    buffer.by_name(["hip"], [-1.0])
    assert buffer.due(0.0)[0].efforts.tolist() == [-1.0, 2.0, 9.0]
    assert buffer.accepted == 3


@pytest.mark.parametrize(
    ("names", "efforts", "words"),
    [
        (None, [1.0], "3 efforts expected, but 1 given. Give one for each of: hip, knee, ankle."),
        (None, [1.0, math.nan, 2.0], "the effort of knee is not finite. Give finite numbers."),
        (["hip", "nee"], [1.0, 2.0], "there is no joint 'nee'. Did you mean 'knee'?"),
        (["hip"], [math.inf], "the effort of hip is not finite. Give finite numbers."),
        (["hip"], [], "'name' and 'effort' differ in length: 1 and 0."),
        (["hip", "hip"], [1.0, 2.0], "'hip' is named twice"),
        ("actuators", [1.0], "the mechanism has no actuators. Send efforts of joints to ~/commands, or"),
    ],
)
def test_a_bad_command_is_rejected_whole_and_counted(buffer, names, efforts, words):
    buffer.by_order([1.0, 2.0, 3.0])
    with pytest.raises(CommandError) as caught:
        if names == "actuators":
            buffer.actuators_by_order(efforts)
        else:
            buffer.by_order(efforts) if names is None else buffer.by_name(names, efforts)
    assert words in str(caught.value)
    assert (buffer.accepted, buffer.rejected) == (1, 1)
    assert buffer.due(0.0)[0].efforts.tolist() == [1.0, 2.0, 3.0]


def test_efforts_expire_once_after_the_timeout_and_the_next_command_recovers(buffer):
    buffer.by_order([1.0, 2.0, 3.0])
    buffer.due(10.0)
    assert buffer.due(10.499) == []
    (expired,) = buffer.due(10.5)
    assert (expired.efforts, expired.expired) == (None, ("hip", "knee", "ankle"))
    assert buffer.due(20.0) == []
    buffer.by_name(["knee"], [1.0])
    assert buffer.due(20.0)[0].efforts.tolist() == [0.0, 1.0, 0.0]
    assert (buffer.accepted, buffer.expired) == (2, 1)


def test_efforts_that_are_zero_already_do_not_expire(buffer):
    buffer.by_order([0.0, 2.0, 0.0])
    buffer.due(0.0)
    (expired,) = buffer.due(0.5)
    assert (expired.expired, buffer.lapsed) == (("knee",), ("knee",))
    buffer.by_order([0.0, 0.0, 0.0])
    buffer.due(0.6)
    assert buffer.due(9.0) == [] and (buffer.lapsed, buffer.expired) == ((), 1)


def test_the_efforts_of_a_joint_expire_though_commands_for_another_one_go_on(buffer):
    buffer.by_name(["hip"], [3.0])
    buffer.by_name(["knee"], [2.0])
    buffer.due(0.0)
    for step in range(1, 5):
        buffer.by_name(["knee"], [1.0 + step])
        (command,) = buffer.due(0.1 * step)
        assert command.efforts.tolist() == [3.0, 1.0 + step, 0.0]
    buffer.by_name(["knee"], [4.0])
    command, expired = buffer.due(0.5)
    assert (command.efforts.tolist(), expired.expired) == ([3.0, 4.0, 0.0], ("hip",))
    assert (buffer.lapsed, buffer.expired) == (("hip",), 1)
    assert buffer.due(0.9) == []
    assert buffer.due(1.0)[0].expired == ("knee",)
    buffer.by_name(["hip"], [1.0])
    assert buffer.due(1.1)[0].efforts.tolist() == [1.0, 0.0, 0.0]
    assert buffer.lapsed == ("knee",)


def test_a_timeout_of_zero_never_expires(buffer):
    buffer.timeout = 0.0
    buffer.by_order([1.0, 2.0, 3.0])
    buffer.due(0.0)
    assert buffer.due(1e9) == []


def test_clear_forgets_the_efforts(buffer):
    buffer.by_order([1.0, 2.0, 3.0])
    buffer.clear()
    assert buffer.due(0.0) == []
    buffer.by_name(["hip"], [1.0])
    assert buffer.due(0.0)[0].efforts.tolist() == [1.0, 0.0, 0.0]


def test_renewed_commands_do_not_expire_until_others_replace_them(buffer):
    """A page renews what it has commanded for as long as it is open, but never what came after."""
    buffer.by_name(["hip", "knee"], [1.0, 2.0])
    buffer.due(0.0)
    buffer.renew({"hip": 1.0, "knee": 3.0}, {})
    assert buffer.due(0.3)[0].efforts.tolist() == [1.0, 2.0, 0.0]
    (expired,) = buffer.due(0.5)
    assert expired.expired == ("knee",)
    buffer.by_name(["hip"], [4.0])
    buffer.due(0.6)
    buffer.renew({"hip": 1.0, "knee": 2.0}, {})
    assert [one.expired for one in buffer.due(1.1)] == [("hip",)]


def test_renewing_one_joint_keeps_the_new_command_of_another(buffer):
    buffer.by_name(["hip"], [1.0])
    buffer.due(0.0)
    buffer.by_name(["knee"], [2.0])
    buffer.renew({"hip": 1.0}, {})
    buffer.due(0.4)
    assert not buffer.due(0.8)
    assert [one.expired for one in buffer.due(0.9)] == [("hip", "knee")]


def test_renewed_commands_of_actuators_do_not_end_a_trajectory():
    simulation = Simulation.from_file("motor_drive")
    buffer = CommandBuffer(simulation.effort_map, 0.5, simulation.command_map)
    buffer.watch_actuators(0.5)
    current = simulation.inputs[simulation.command_map.range]
    (channel,) = simulation.command_map.names
    buffer.actuators_by_name({"drive": {"velocity": 3.0}})
    assert buffer.due_for_actuators(0.0, current).tolist() == [3.0]
    buffer.renew({}, {channel: 3.0})
    assert buffer.due_for_actuators(0.4, current) is None
    assert buffer.due_for_actuators(0.8, current) is None
    buffer.renew({}, {channel: 2.0})
    assert buffer.due_for_actuators(0.9, current).tolist() == [0.0]
    assert buffer.take_expired_actuators() == ["drive"]
    (joint,) = simulation.coordinate_names
    buffer.efforts_by_name({joint: 0.5})  # besides the actuator, by whose name no effort is taken
    assert buffer.due(1.0)[0].efforts.tolist() == [0.5]
    with pytest.raises(CommandError, match="takes no position"):
        buffer.actuators_by_name({"drive": {"position": 1.0}})
    assert buffer.rejected == 1


def test_commands_that_wait_can_be_shown(buffer):
    layout = InputLayout(3)
    inputs = np.zeros(layout.size)
    buffer.by_name(["knee"], [7.0])
    assert buffer.overlay(inputs, layout)[layout.efforts].tolist() == [0.0, 5.0, 0.0]
    assert not inputs.any()
