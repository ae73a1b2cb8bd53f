"""Samples of numbers that are computed at once have the bits of those computed one by one."""

import numpy as np
import pytest

from mbd_sim.files.checks.override import values_of, with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.studies.algebra import samples
from mbd_sim.studies.algebra import samples as symbolic_values
from mbd_sim.studies.optimization import parameter_inputs


def sampled(name, module, of_variants):
    mechanism = load_mechanism(name)
    start = values_of(mechanism, list(mechanism.parameters))
    return samples.number_samples(lambda changes: with_values(mechanism, changes), start, module._numbers, of_variants)


@pytest.mark.parametrize("module", [symbolic_values, parameter_inputs])
@pytest.mark.parametrize(("name", "at_once"), [("rod_pendulum", True), ("simple_pendulum", True), ("bounce", False)])
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
