"""`set_efforts` as compiled code and as a method: the same efforts, the same errors, the same recordings."""

import inspect

import numpy as np
import pytest

from mbd_sim import CommandError, Simulation
from mbd_sim.recordings.run.verification import verify
from mbd_sim.simulation.run.inputs import RunInputs

NAN, INFINITE = float("nan"), float("inf")

TEXT = """
mechanism: limited
parameters: {strength: 5, slack: 0.1}
parts: {one: {mass: 1}, two: {mass: 1}}
joints:
  left: {type: prismatic, between: [ground, one], axis: [1, 0, 0], effort_limit: strength, damping: slack*strength}
  right: {type: prismatic, between: [ground, two], axis: [1, 0, 0]}
"""


class Own(Simulation):
    """A simulation whose method is always called."""

    calls = 0

    def set_efforts(self, efforts):
        self.calls += 1
        super().set_efforts(efforts)


@pytest.fixture
def sim():
    sim = Simulation.from_text(TEXT, live=["parameters.strength"])
    sim.set_efforts([0.5, -0.25])
    assert type(sim.set_efforts) is type(len)  # from its first call on
    return sim


@pytest.mark.parametrize(
    "given",
    [
        np.array([1.0, 2.0]), np.array([1.0, 2.0], dtype=np.float32), np.array([[1.0, 3.0], [2.0, 4.0]])[:, 0],
        [1.0, 2.0], (1, 2), np.array([1, 2]), {"left": 1.0, "right": 2}, np.array([9.0, -1e300]), [-9.0, 1e300],
        {"left": -7}, {}, [-0.0, 0.0], np.array([1.0, 2.0], dtype=">f8"),
    ],
)  # fmt: skip
def test_both_set_the_same_efforts(sim, given):
    sim.set_efforts(given)
    found = sim.efforts.copy()
    sim.set_efforts([0.5, -0.25])
    sim._inputs.set_efforts(given)
    assert sim.efforts.tobytes() == found.tobytes()


def test_what_another_simulation_shows_is_set_by_compiled_code_too(monkeypatch):
    monkeypatch.setattr(RunInputs, "set_efforts", None)
    sim, other = Simulation.from_text(TEXT), Simulation.from_text(TEXT)
    for efforts in ([3.0, -2.0], [1.0, 0.0]):  # by the method, then by the code in its place
        other.set_efforts(efforts)
        sim.set_efforts(other.efforts)
        sim.set_efforts(sim.efforts)
        assert sim.efforts.tolist() == efforts


@pytest.mark.parametrize("kind", [np.array, lambda numbers: np.array(numbers, dtype=np.float32), list, tuple])
@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([1.0], "2 efforts expected, but 1 given. Give one for each of: left, right."),
        ([1.0, 2.0, 3.0], "2 efforts expected, but 3 given. Give one for each of: left, right."),
        ([], "2 efforts expected, but 0 given. Give one for each of: left, right."),
        ([NAN, 1.0], "the effort of left is not finite. Give finite numbers."),
        ([1.0, INFINITE], "the effort of right is not finite. Give finite numbers."),
        ([-INFINITE, NAN], "the effort of left, right is not finite. Give finite numbers."),
    ],
)
def test_rejected_efforts_change_nothing(sim, kind, numbers, message):
    for set_efforts in (sim.set_efforts, sim._inputs.set_efforts):
        with pytest.raises(CommandError) as found:
            set_efforts(kind(numbers))
        assert str(found.value) == message
        assert sim.efforts.tolist() == [0.5, -0.25]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"lefd": 1.0}, "there is no joint 'lefd'. Did you mean 'left'"),
        ({"left": 1.0, "right": NAN}, "the effort of right is not finite"),
        (["1", "2"], "'1' is a text"),
        (np.ones((2, 2)), "an effort is not a number"),
        (None, "an effort is not a number"),
        (1.0, "an effort is not a number"),
    ],
)
def test_what_is_not_an_array_has_the_errors_of_the_method(sim, given, message):
    with pytest.raises(CommandError, match=message):
        sim.set_efforts(given)
    assert sim.efforts.tolist() == [0.5, -0.25]


def test_arguments_are_those_of_the_method(sim):
    sim.set_efforts(efforts=[1.0, 2.0])
    assert sim.efforts.tolist() == [1.0, 2.0]
    for arguments in ((), ([1.0, 2.0], 3)):
        with pytest.raises(TypeError, match=r"set_efforts\(\)"):
            sim.set_efforts(*arguments)
    assert inspect.signature(sim.set_efforts) == inspect.signature(lambda efforts: None)
    assert sim.set_efforts.__doc__.startswith("Set the efforts (N or N·m) from the next step on")
    assert inspect.signature(sim.step) == inspect.signature(lambda n=1: None)


def test_limits_that_change_act_on_both(sim):
    sim.set_live({"parameters.strength": 0.25})
    assert sim.efforts.tolist() == [0.25, -0.25]
    for set_efforts in (sim.set_efforts, sim._inputs.set_efforts):
        set_efforts([-9.0, 9.0])
        assert sim.efforts.tolist() == [-0.25, 9.0]


def test_a_function_that_was_obtained_before_is_recorded(sim, tmp_path):
    set_efforts = sim.set_efforts
    with sim.recording(tmp_path / "run.mcap"):
        set_efforts(np.array([1.0, 2.0]))
        sim.step(5)
    set_efforts(np.array([3.0, 4.0]))
    assert sim.efforts.tolist() == [3.0, 4.0]
    (run,) = verify(tmp_path / "run.mcap")
    assert run.agrees and run.commands["applied_efforts"] == 1


def test_a_subclass_may_override_it():
    own = Own.from_text(TEXT, live=["parameters.strength"])
    for _ in range(3):
        own.set_efforts(np.array([9.0, 2.0]))
    assert own.calls == 3 and own.efforts.tolist() == [5.0, 2.0]


def test_copies_have_their_own_efforts(sim):
    copied = sim.copy()
    copied.set_efforts([1.0, 2.0])
    assert sim.efforts.tolist() == [0.5, -0.25] and copied.efforts.tolist() == [1.0, 2.0]


def test_forward_dynamics_clamps_and_refuses_as_well(sim):
    assert sim.forward_dynamics([9.0, 2.0]).tolist() == [5.0, 2.0]
    assert sim.forward_dynamics({"right": 3}).tolist() == [0.5, 3.0]
    with pytest.raises(CommandError, match="the effort of left is not finite"):
        sim.forward_dynamics(np.array([NAN, 1.0]))
    assert sim.forward_dynamics().tolist() == sim.efforts.tolist() == [0.5, -0.25]
