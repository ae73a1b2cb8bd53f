"""Noise as a function of the sample's number: random access, moments, independence, spectra and Allan deviations."""

import hashlib

import numpy as np
import pytest
from scipy import special

from mbd_sim.mechanism.elements.sensors import ErrorModel
from mbd_sim.simulation.kernel.noise import (
    BLOCK,
    MeasurementErrors,
    Noise,
    RandomNumbers,
    natural_logarithm,
    normal,
    uniform,
)

SAMPLES = 40_000
PERIOD = 0.005


def assert_is_normal(samples):
    from scipy.stats import kstest  # here, as signal below: every process that collects the tests would import them

    assert kstest(samples, "norm").pvalue > 1e-3


@pytest.fixture(scope="module")
def walk():
    noise = Noise(3, "gyro", 3, 0.0)
    return np.array([noise.walk(sample) for sample in range(SAMPLES)])


@pytest.fixture(scope="module")
def white():
    noise = Noise(3, "gyro", 3, 0.0)
    return np.array([noise.white(sample) for sample in range(SAMPLES)])


def allan_deviation(values, count):
    """The deviation of neighboring averages over `count` samples, overlapping (IEEE 952)."""
    sums = np.cumsum(np.concatenate([[0.0], values])) / count
    averages = sums[count:] - sums[:-count]
    return np.sqrt(0.5 * np.mean((averages[count:] - averages[:-count]) ** 2))


def test_any_sample_can_be_computed_alone(walk, white):
    for sample in (SAMPLES - 1, 0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 12_345):
        alone = Noise(3, "gyro", 3, 0.0)
        assert alone.walk(sample).tolist() == walk[sample].tolist()
        assert alone.white(sample).tolist() == white[sample].tolist()
    assert np.all(np.isfinite(Noise(3, "gyro", 3, 0.0).walk(10**12)))


def test_white_noise_is_normal_and_uncorrelated(white):
    for component in white.T:
        assert_is_normal(component)
    correlations = np.corrcoef(np.hstack([white[1:], white[:-1]]).T)
    np.testing.assert_allclose(correlations, np.eye(6), atol=5.0 / np.sqrt(SAMPLES))


def test_a_walk_has_independent_normal_steps_of_variance_one(walk):
    assert not np.any(walk[0])
    steps = np.diff(walk, axis=0)
    for component in steps.T:
        assert_is_normal(component)
    correlations = np.corrcoef(np.hstack([steps[1:], steps[:-1]]).T)
    np.testing.assert_allclose(correlations, np.eye(6), atol=5.0 / np.sqrt(SAMPLES))
    across = steps[BLOCK - 1 :: BLOCK]  # from the last sample of a block to the first of the next
    np.testing.assert_allclose(across.std(), 1.0, atol=0.05)


def test_seeds_and_names_select_independent_noise(white):
    for other in (Noise(4, "gyro", 3, 0.0), Noise(3, "gyr0", 3, 0.0)):
        values = np.array([other.white(sample) for sample in range(4000)])
        correlation = np.corrcoef(np.hstack([values, white[:4000]]).T)[:3, 3:]
        np.testing.assert_allclose(correlation, 0.0, atol=5.0 / np.sqrt(4000))


def test_the_spectrum_of_white_noise_is_its_density():
    from scipy import signal

    density = 0.03
    noise = Noise(1, "tachometer", 1, 0.0)
    errors = MeasurementErrors([ErrorModel(noise_density=density)], [1], PERIOD, noise)
    values = np.array([errors.added(sample)[0] for sample in range(SAMPLES)])
    _, power = signal.welch(values, 1.0 / PERIOD, nperseg=512, return_onesided=False)
    np.testing.assert_allclose(np.mean(power[1:]), density**2, rtol=0.03)
    np.testing.assert_allclose(power[1:], density**2, rtol=0.6)
    for count in (1, 10, 100):
        expected = density / np.sqrt(count * PERIOD)
        np.testing.assert_allclose(allan_deviation(values, count), expected, rtol=0.1)


def test_the_allan_deviation_of_a_walking_bias_rises_with_the_root_of_time():
    walking = 0.02
    noise = Noise(1, "gyro", 1, 0.0)
    errors = MeasurementErrors([ErrorModel(bias_walk=walking)], [1], PERIOD, noise)
    values = np.array([errors.added(sample)[0] for sample in range(SAMPLES)])
    for count in (20, 50, 100, 200):
        expected = walking * np.sqrt(count * PERIOD / 3.0)
        np.testing.assert_allclose(allan_deviation(values, count), expected, rtol=0.15)
    ends = [MeasurementErrors([ErrorModel(bias_walk=walking)], [1], PERIOD, Noise(seed, "g", 1, 0.0)).added(2000)[0]
            for seed in range(200)]  # fmt: skip
    np.testing.assert_allclose(np.std(ends), walking * np.sqrt(2000 * PERIOD), rtol=0.12)


def test_samples_are_lost_with_the_given_probability():
    noise = Noise(1, "range", 1, 0.2)
    lost = np.array([noise.is_lost(sample) for sample in range(20_000)])
    np.testing.assert_allclose(lost.mean(), 0.2, atol=0.015)
    np.testing.assert_allclose(np.mean(lost[1:] & lost[:-1]), 0.04, atol=0.01)
    assert [Noise(1, "range", 1, 0.2).is_lost(sample) for sample in (5, 777, 19_999)] == lost[[5, 777, 19_999]].tolist()
    assert not Noise(1, "range", 1, 0.0).is_lost(3)
    assert all(Noise(1, "range", 1, 1.0).is_lost(sample) for sample in range(100))


def test_values_are_rounded_to_steps_and_limited():
    errors = MeasurementErrors(
        [ErrorModel(resolution=0.25, limit=1.0), ErrorModel()], [3, 1], PERIOD, Noise(0, "a", 4, 0.0)
    )
    assert errors.added(5) is None
    found = errors.rounded_and_limited(np.array([0.3, -0.375, 7.0, 7.1]))
    assert found.tolist() == [0.25, -0.5, 1.0, 7.1]  # a tie goes to the even multiple


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
