"""A small mechanism file to break in tests, and its problems."""

import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism

PENDULUM = """\
mechanism: pendulum
parameters:
  m: 2 kg
  l: 1.5 m
parts:
  rod:
    mass: m
    shape: {type: rod, to: [0, 0, -l]}
    points: {tip: [0, 0, -l]}
joints:
  pin:
    type: revolute
    between: [ground, rod]
    axis: [0, -1, 0]
    position: 90 deg
"""


def changed(*replacements, text=PENDULUM):
    """The file with each (old, new) text replaced; every old text must stand in it once."""
    for old, new in replacements:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def problems_of(text):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text, "file.yaml")
    for problem in caught.value.problems:
        assert problem.file == "file.yaml" and problem.line >= 1 and problem.message
        assert str(problem) in str(caught.value)
    return caught.value.problems


def problem_of(text):
    """The only problem of a file."""
    (problem,) = problems_of(text)
    return problem


def part_of(text):
    """The part `body` of a file that describes it by the YAML text of its record, on one joint."""
    file = f"mechanism: one\nparts:\n  body: {text}\njoints:\n  flight: {{type: free, between: [ground, body]}}\n"
    return parse_mechanism(file, "file.yaml").parts["body"]
