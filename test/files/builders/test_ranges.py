"""The ranges of parameters."""

import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.checks.bare_angles import bare_angle_remarks
from mbd_sim.files.checks.override import matching, with_values
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.text.yaml_text import yaml_text

TEXT = """
mechanism: rod
parameters: {l: 800 mm, tilt: 30 deg, two: 2*l}
ranges:
  NAME: RANGE
parts:
  rod: {shape: {type: rod, to: [l, 0, 0], mass: 2 kg}}
joints:
  pin: {type: revolute, between: [ground, rod], axis: [0, -1, 0], position: tilt}
"""


def rod(ends, name="l"):
    return parse_mechanism(TEXT.replace("NAME", name).replace("RANGE", ends))


@pytest.mark.parametrize("ends", ["[0.5, 1200 mm]", "[50 cm, 1.5*l]", "['${1-0.5} m', 120 cm]"])
def test_ends_are_in_si_units(ends):
    assert rod(ends).ranges["l"] == pytest.approx((0.5, 1.2))


@pytest.mark.parametrize(
    ("ends", "name", "message", "remedy"),
    [
        ("[1, 0.5]", "l", "first end must be less", "Exchange"),
        ("[1, 1]", "l", "first end must be less", "different"),
        ("[1, 2]", "l", "value, 800 mm, is outside", "Widen"),
        ("[0.5, 20 deg]", "l", "the unit 'deg' does not fit", "mm"),
        ("[1, 2]", "two", "follows from an expression", "depends on"),
        ("[1, 2]", "tillt", "no such parameter", "Did you mean 'tilt'?"),
        ("[1]", "l", "has 1 value, not 2", "Write it as"),
    ],
)
def test_ranges_that_do_not_fit(ends, name, message, remedy):
    with pytest.raises(MechanismError) as caught:
        rod(ends, name)
    (problem,) = caught.value.problems
    assert (problem.line, problem.key) == (5, f"ranges.{name}")
    assert message in problem.message
    assert remedy in problem.remedy


@pytest.mark.parametrize("key", ["l", "parameters.l"])
def test_a_changed_value_may_be_outside(key):
    mechanism = with_values(rod("[0.5, 1]"), {key: 3.0})
    assert mechanism.parameters["l"] == 3.0
    assert mechanism.ranges == {"l": (0.5, 1.0)}


def test_ends_are_no_values_of_the_motion():
    assert not [key for key in matching(rod("[0.5, 1]"), ["*"]) if key.startswith("ranges")]


def test_an_end_of_an_angle_without_a_unit_is_noted():
    (remark,) = bare_angle_remarks(rod("[0, 90]", "tilt").source)
    assert remark.startswith("ranges.tilt[1] is 90 rad") and "90 deg" in remark
    assert not bare_angle_remarks(rod("[0, 90]", "l").source)


def test_written_ranges_are_read_again():
    mechanism = rod("[500 mm, 1 m]")
    text = yaml_text(mechanism.source.data)
    assert "ranges:\n  l: [500 mm, 1 m]\n" in text
    assert parse_mechanism(text).ranges == mechanism.ranges
