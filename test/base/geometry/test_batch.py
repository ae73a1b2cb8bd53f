"""Batches against the same operations on each variant by itself: to the last bit."""

import math

import numpy as np
import pytest

from mbd_sim.base.geometry.batch import Batch, array, fsum, is_finite, per_variant, uniform
from mbd_sim.base.geometry.rotation import about, skew, unit
from mbd_sim.base.linear_algebra import product
from mbd_sim.mechanism.values.expression import evaluate

COUNT = 9


def batch(*shape, seed=0):
    return Batch(np.random.default_rng(seed).normal(size=(COUNT, *shape)), np.ones(COUNT, dtype=bool))


@pytest.mark.parametrize(
    "function",
    [
        lambda r, v: product(r, v),
        lambda r, v: product(r, r.T),
        lambda r, v: product(-r.T, v) + 2.0 * v / 3.0,
        lambda r, v: product(v, v),
        lambda r, v: np.linalg.norm(v),
        lambda r, v: np.cross(v, np.array([0.0, 1.0, 0.5])),
        lambda r, v: np.where(np.abs(v) <= 0.5 * np.max(np.abs(v)), np.round(v), v),
        lambda r, v: np.block([[r, skew(v)], [np.eye(3), r.T]]),
        lambda r, v: np.linalg.eigvalsh(r + r.T),
        lambda r, v: np.array([1.0, 2.0, 3.0]) * unit(v),
        lambda r, v: about(unit(v), 0.3),
        lambda r, v: evaluate("sin(a)**2 + sqrt(abs(b))/3 + where(a > a, b, max(a, b))", {"a": v[0], "b": v[1]}),
        lambda r, v: v[0] ** 3 + fsum([v[0], 1e100, v[1], -1e100]),
    ],
)
def test_each_variant_gets_the_bits_that_it_gets_alone(function):
    matrices, vectors = batch(3, 3), batch(3, seed=1)
    together = function(matrices, vectors)
    assert matrices.valid.all()
    for index in range(COUNT):
        alone = function(matrices.values[index], vectors.values[index])
        assert np.array_equal(together.values[index], alone)


def test_decisions_follow_the_first_variant_and_mark_the_others():
    length = Batch(np.array([1.0, 2.0, -1.0, 3.0]), np.ones(4, dtype=bool))
    assert length > 0.0
    assert length.valid.tolist() == [True, True, False, True]
    assert length != 3.0
    assert length.valid.tolist() == [True, True, False, False]


def test_what_has_no_value_marks_its_variant():
    divisor = Batch(np.array([1.0, 0.0, 2.0, 4.0]), np.ones(4, dtype=bool))
    assert (1.0 / divisor).values[2] == 0.5
    assert divisor.valid.tolist() == [True, False, True, True]
    argument = Batch(np.array([1.0, 4.0, -1.0, 9.0]), np.ones(4, dtype=bool))
    assert per_variant(math.sqrt)(argument).values[[0, 1, 3]].tolist() == [1.0, 2.0, 3.0]
    assert argument.valid.tolist() == [True, True, False, True]
    infinite = Batch(np.array([1.0, np.inf]), np.ones(2, dtype=bool))
    assert is_finite(infinite)
    assert infinite.valid.tolist() == [True, False]


def test_a_batch_is_no_number():
    with pytest.raises(TypeError, match="not one number"):
        float(batch())
    with pytest.raises(ValueError, match="sequence"):
        np.array([batch(), 1.0], dtype=float)
    with pytest.raises(TypeError, match="neither true nor false"):
        bool(batch(3))


def test_arrays_of_batches_and_numbers():
    number = batch()
    found = array([[0.0, number], [-number, 1]])
    assert found.shape == (2, 2)
    assert np.array_equal(found.values[:, 1, 0], -number.values)
    assert array((1, 2.0)).tolist() == [1.0, 2.0]
    assert uniform(number - number) == 0.0
    assert uniform(number) is number
