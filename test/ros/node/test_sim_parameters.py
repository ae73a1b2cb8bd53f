"""The text of the parameter `start`."""

import math

import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.ros.node.sim_parameters import start_values

NAMED = {"start": "", "starts.upright": "shoulder = 180 deg, elbow = 0", "starts.broken": "knee = 1"}


@pytest.fixture(scope="module")
def model():
    return Simulation.from_file("double_rod").model


def test_an_empty_text_is_the_start_of_the_file(model):
    assert start_values(" ", NAMED, model) is None


@pytest.mark.parametrize(
    ("text", "positions", "speeds"),
    [
        ("elbow = 0.5", {"elbow": 0.5}, {}),
        ("elbow = 30 deg, shoulder.velocity = 2", {"elbow": math.radians(30)}, {"shoulder": 2.0}),
        ("elbow.velocity=60 rpm", {}, {"elbow": pytest.approx(2.0 * math.pi)}),
        ("upright", {"shoulder": pytest.approx(math.pi), "elbow": 0.0}, {}),
    ],
)
def test_values_are_given_with_units_or_by_the_name_of_a_start(model, text, positions, speeds):
    assert start_values(text, NAMED, model) == (positions, speeds)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("uprigt", "there is no start 'uprigt'. Did you mean 'upright'?"),
        ("broken", "there is no joint 'knee'"),
        ("elbow = 60 mm", "elbow = '60 mm': the unit 'mm' does not fit"),
        ("elbow = 1, elbow = 2", "elbow is given twice"),
        ("elbow = 1, shoulder", "'shoulder' is not of the form joint = value"),
        ("elbow = fast", "elbow = 'fast': "),
    ],
)
def test_a_start_that_does_not_fit_is_refused_with_a_reason(model, text, words):
    with pytest.raises(CommandError) as caught:
        start_values(text, NAMED, model)
    assert words in str(caught.value)
