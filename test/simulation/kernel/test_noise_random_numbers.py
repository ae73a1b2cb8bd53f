"""Random numbers by address: the published generator, the normal distribution, and logarithms against NumPy and SciPy."""

import hashlib

import numpy as np
from scipy import special

from mbd_sim.simulation.kernel.noise import RandomNumbers, natural_logarithm, normal, uniform


def test_integers_are_those_of_philox_at_any_address():
    numbers = RandomNumbers(7, "imu")
    key = np.frombuffer(hashlib.blake2b(b"7/imu", digest_size=16).digest(), dtype=np.uint64)
    expected = np.random.Philox(key=key, counter=[0, 5, 2, 0]).random_raw(10)
    np.testing.assert_array_equal(numbers.integers(2, 5, 10), expected)
    np.testing.assert_array_equal(numbers.integers(2, 5, 4), expected[:4])
    assert numbers.integers(2, 5, 3).tolist() == [int(value) for value in RandomNumbers(7, "imu").integers(2, 5, 3)]


def test_the_bits_are_those_of_the_first_version():
    """A recording of one version must verify with the next: these numbers must never change."""
    numbers = RandomNumbers(0, "imu")
    assert numbers.integers(0, 3, 2).tolist() == INTEGERS
    assert [value.hex() for value in numbers.normals(0, 3, 3).tolist()] == NORMALS


INTEGERS = [9473092166424988474, 3696582965785781487]
NORMALS = ["0x1.1608916567af8p-5", "-0x1.ae317bdb4b4dbp-1", "-0x1.8a2931eda80fcp-9"]


def test_normal_numbers_are_the_inverse_of_the_distribution():
    tails = 10.0 ** -np.linspace(0.3, 15.6, 2000)
    probability = np.concatenate([np.linspace(1e-3, 0.999, 4000), tails, 1.0 - tails[tails > 1e-15]])
    expected = special.ndtri(probability)
    np.testing.assert_allclose(normal(probability), expected, rtol=2e-14, atol=1e-15)
    assert normal(np.array([0.5]))[0] == 0.0
    integers = RandomNumbers(0, "a").integers(0, 0, 1000)
    np.testing.assert_array_equal(normal(uniform(integers)), -normal(uniform(~integers)))


def test_uniform_numbers_exclude_both_ends():
    ends = uniform(np.array([0, 2**64 - 1], dtype=np.uint64))
    assert ends.tolist() == [2.0**-53, 1.0 - 2.0**-53]
    assert np.all(np.isfinite(normal(ends)))


def test_the_logarithm_is_correct_to_the_last_digits():
    x = np.concatenate([10.0 ** np.linspace(-300, 300, 5001), np.linspace(0.5, 2.0, 5001)])
    np.testing.assert_allclose(natural_logarithm(x), np.log(x), rtol=4e-16, atol=2e-16)
