"""Wrenches on their way to the simulation: accepted or rejected whole, in the named axes, expiring."""

import tracemalloc

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.files.load import load_mechanism
from mbd_sim.lab.session.hold import Hold
from mbd_sim.ros.commands.wrenches import ExpiredWrench, WrenchBuffer, wrench_targets

X = (1.0, 0.0, 0.0)
NONE = (0.0, 0.0, 0.0)


@pytest.fixture
def simulation():
    return Simulation.from_file("double_rod", wrenches=["upper", "lower"])


@pytest.fixture
def buffer(simulation):
    return WrenchBuffer(simulation.wrench_map, simulation.model.part_names, 0.5, frame_prefix="a/")


def test_of_several_wrenches_on_a_part_the_newest_is_due_once(buffer):
    buffer.take("upper", None, "", X, NONE)
    buffer.take("upper", None, "world", (2.0, 0.0, 0.0), NONE)
    buffer.take("lower", None, "ground", NONE, X)
    due = {wrench.part: wrench for wrench in buffer.due(0.0)}
    assert due["upper"].force.tolist() == [2.0, 0.0, 0.0]
    assert due["lower"].couple.tolist() == [1.0, 0.0, 0.0]
    assert list(buffer.due(0.1)) == []
    assert (buffer.accepted, buffer.rejected) == (3, 0)


def test_a_paused_simulation_does_not_collect_wrenches(buffer):
    """Nothing is due while paused, however many messages arrive."""
    buffer.take("upper", None, "", X, NONE)
    tracemalloc.start()
    for _ in range(2_000):
        buffer.take("upper", None, "", X, NONE)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 20_000
    assert len(list(buffer.due(0.0))) == 1


@pytest.mark.parametrize(
    ("frame", "meant"), [("", "ground"), ("a/ground", "ground"), ("a/lower", "lower"), ("upper", "upper")]
)
def test_frames_are_known_with_and_without_their_prefix(buffer, frame, meant):
    buffer.take("upper", None, frame, X, NONE)
    (due,) = buffer.due(0.0)
    assert due.frame == meant


@pytest.mark.parametrize(
    ("frame", "point", "force", "words"),
    [
        ("uper", None, X, "there is no frame 'uper'. Did you mean 'upper'?"),
        ("", "tipp", X, "no point 'tipp'"),
        ("", None, (1.0, float("nan"), 0.0), "not finite"),
    ],
)
def test_a_bad_wrench_is_rejected_whole_and_counted(buffer, frame, point, force, words):
    with pytest.raises(CommandError, match=words.replace("?", r"\?")):
        buffer.take("upper", point, frame, force, NONE)
    assert list(buffer.due(0.0)) == []
    assert (buffer.accepted, buffer.rejected) == (0, 1)


def test_a_wrench_of_zero_does_not_expire(buffer):
    buffer.take("upper", None, "", X, NONE)
    list(buffer.due(0.0))
    buffer.take("upper", None, "", NONE, NONE)
    list(buffer.due(0.1))
    assert list(buffer.due(9.0)) == [] and buffer.expired == 0


def test_each_part_has_a_watchdog_of_its_own(buffer):
    buffer.take("upper", None, "", X, NONE)
    list(buffer.due(0.0))
    buffer.take("lower", None, "", X, NONE)
    list(buffer.due(0.3))
    assert list(buffer.due(0.5)) == [ExpiredWrench("upper")]
    assert list(buffer.due(0.8)) == [ExpiredWrench("lower")]
    assert list(buffer.due(9.0)) == []
    assert buffer.expired == 2


def test_a_timeout_of_zero_never_expires_and_clear_forgets(buffer):
    buffer.timeout = 0.0
    buffer.take("upper", None, "", X, NONE)
    list(buffer.due(0.0))
    assert list(buffer.due(1e9)) == []
    buffer.take("upper", None, "", X, NONE)
    buffer.clear()
    assert list(buffer.due(1e9)) == []


def test_a_wrench_acts_in_the_axes_of_its_frame(simulation, buffer):
    """The upper rod hangs at 90°: its own z axis is along ground's x or against it."""
    turn = simulation.poses()["upper"].rotation
    for frame, expected in (("upper", None), ("lower", simulation.poses()["lower"].rotation @ X), ("", np.array(X))):
        buffer.take("upper", None, frame, X, NONE)
        (due,) = buffer.due(0.0)
        due.apply(simulation)
        numbers = simulation.inputs[simulation.wrench_map.slices["upper"]]
        if expected is None:
            assert numbers[6:9].tolist() == list(X)
            assert not numbers[:6].any()
        else:
            assert numbers[:3] == pytest.approx(expected)
    assert not np.allclose(turn, np.eye(3))


def test_what_takes_wrenches_is_chosen_by_name():
    mechanism = load_mechanism("double_rod")
    assert wrench_targets(mechanism, ["upper"]) == [("upper", None)]
    points = [(name, point) for name, part in mechanism.parts.items() for point in part.points]
    assert set(wrench_targets(mechanism, ["*"])) == {("upper", None), ("lower", None), *points}
    assert wrench_targets(mechanism, []) == []
    with pytest.raises(ValueError, match="Did you mean 'upper'"):
        wrench_targets(mechanism, ["uper"])


def hold(target, part="lower"):
    return Hold(part, np.array([0.1, 0.0, 0.0]), np.array(target), 50.0, 2.0)


def test_a_pull_follows_the_motion_until_it_is_no_longer_repeated(simulation, buffer):
    """It sets the wrench every 2 ms of the run, and expires like that of a sender that has died."""
    forces = []
    for step in range(700):
        if step % 20 == 0 and step < 100:
            buffer.pull(hold([1.0, 0.0, 1.0]))
        now = step * 1e-3
        for due in buffer.due(now):
            due.apply(simulation)
        forces.append(simulation.inputs[simulation.wrench_map.slices["lower"]][:3].copy())
        simulation.step(round(1e-3 / simulation.step_size))
    changes = [step for step in range(1, 700) if np.any(forces[step] != forces[step - 1])]
    assert changes == [*range(2, 581, 2), 581]  # 0.5 s after the last pull
    assert not forces[581].any() and buffer.expired == 1
    assert (buffer.steps_to_pull(1e-3, 100), buffer.accepted) == (100, 5)


def test_a_pull_ends_with_the_next_wrench_on_the_part(simulation, buffer):
    buffer.pull(hold([1.0, 0.0, 1.0]))
    assert len(list(buffer.due(0.0))) == 1
    assert buffer.steps_to_pull(1e-3, 100) == 2
    buffer.take("lower", None, "", NONE, NONE)
    (due,) = buffer.due(0.002)
    assert not due.force.any()
    assert list(buffer.due(0.004)) == []


@pytest.mark.parametrize("bad", [hold([np.nan, 0.0, 0.0]), hold([1.0, 0.0, 0.0], "ground")])
def test_a_bad_pull_is_rejected_whole_and_counted(buffer, bad):
    with pytest.raises(CommandError):
        buffer.pull(bad)
    assert list(buffer.due(0.0)) == []
    assert (buffer.accepted, buffer.rejected) == (0, 1)
