"""Samples of numbers that are computed at once have the bits of those computed one by one."""

import numpy as np
import pytest

from mbd_sim import parse_mechanism
from mbd_sim.files.checks.override import values_of, with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.studies.algebra import samples
from mbd_sim.studies.algebra import samples as symbolic_values
from mbd_sim.studies.optimization import parameter_inputs


def sampled(name, module, of_variants):
    mechanism = load_mechanism(name)
    start = values_of(mechanism, list(mechanism.parameters))
    return samples.number_samples(lambda changes: with_values(mechanism, changes), start, module._numbers, of_variants)


@pytest.mark.parametrize(
    ("name", "at_once", "module"),
    [
        ("rod_pendulum", True, symbolic_values),
        ("simple_pendulum", True, parameter_inputs),
        ("bounce", False, parameter_inputs),
    ],
)
def test_samples_computed_at_once_have_the_bits_of_those_computed_one_by_one(monkeypatch, module, name, at_once):
    """Where contacts, or decisions on the values, do not fit, they are computed one by one."""
    alone = sampled(name, module, None)
    if at_once:
        monkeypatch.setattr(samples._Sampler, "one_by_one", None)
    found = sampled(name, module, module._numbers_of_variants)
    assert found.keys == alone.keys and found.keys and found.built_in == alone.built_in
    for own, other in zip(
        [*found.samples.slices, found.samples.joint], [*alone.samples.slices, alone.samples.joint], strict=True
    ):
        assert all(np.array_equal(a, b) for a, b in zip(own, other, strict=True))


def test_sampled_loops_that_do_not_close_are_not_mended():
    """Samples of a cut four-bar do not close, and were mended: no formula described where its joints were."""
    mechanism = parse_mechanism(
        """
mechanism: cut
parameters: {crank: 1, coupler: 2.2, rocker: 2.8}
ground: {points: {right: [2.2, 0, 0]}}
parts:
  crank: {mass: 1, shape: {type: sphere, radius: 0.1}, points: {tip: [crank, 0, 0]}}
  coupler: {mass: 1, shape: {type: sphere, radius: 0.1}, points: {tip: [coupler, 0, 0]}}
  rocker: {mass: 1, shape: {type: sphere, radius: 0.1}, points: {tip: [rocker, 0, 0]}}
joints:
  motor: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 180 deg}
  crank_pin: {type: revolute, between: [crank.tip, coupler], axis: [0, -1, 0], position: -130 deg, guess: true}
  pivot: {type: revolute, between: [ground.right, rocker], axis: [0, -1, 0], position: 120 deg, guess: true}
  rocker_pin: {type: revolute, between: [coupler.tip, rocker.tip], axis: [0, -1, 0], cut: true}
"""
    )
    inputs = parameter_inputs.parameter_inputs(mechanism, list(mechanism.parameters))
    lengths = {inputs.numbers.data.paths[index]: column for index, column in _columns(inputs)}
    assert inputs.numbers.base[lengths[0, "closing", "rocker_pin", "parent_pose", "position", 0]] == 2.2
    assert inputs.numbers.base[lengths[0, "closing", "rocker_pin", "child_pose", "position", 0]] == 2.8


def _columns(inputs):
    return zip(inputs.numbers.indices.tolist(), inputs.numbers.columns.tolist(), strict=True)
