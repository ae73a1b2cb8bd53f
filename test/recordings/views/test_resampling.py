"""Resampling of runs: each column by its interpolation, exact where this one is, and empty outside its values."""

from pathlib import Path

import numpy as np
import pytest

from mbd_sim import InputError
from mbd_sim.recordings.views.resampling import resampled
from mbd_sim.recordings.views.table import RunTable


def table(times, position, velocity, requested=(), steps=None):
    times = np.asarray(times, dtype=float)
    one = np.asarray(position, dtype=float)[:, None]
    return RunTable(
        Path("run.mcap"), True, "run", ("a",), ("rad",), times,
        np.arange(len(times)) if steps is None else steps, one, np.asarray(velocity, dtype=float)[:, None],
        np.full_like(one, np.nan), None, (), dict(requested),
    )  # fmt: skip


def test_positions_follow_cubics_and_velocities_lines():
    times = np.array([0.0, 0.1, 0.25, 0.5, 1.0])
    cubic = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.7])
    found, ways = resampled(table(times, cubic(times), cubic.deriv()(times)), 64.0)
    assert len(found["time_s"]) == 65 and found["time_s"][-1] == 1.0
    assert np.allclose(found["a.position_rad"], cubic(found["time_s"]), atol=1e-14)
    assert np.allclose(found["a.velocity_rad_s"], np.interp(found["time_s"], times, cubic.deriv()(times)))
    assert found["step"].tolist() == (np.searchsorted(times, found["time_s"], side="right") - 1).tolist()
    assert ways == {"step": "held", "a.position_rad": "cubic", "a.velocity_rad_s": "linear"}


def test_a_slower_topic_is_joined_between_its_own_values():
    times = np.arange(5.0)
    slow = np.array([np.nan, 2.0, np.nan, 6.0, np.nan])
    found, _ = resampled(table(times, times, np.ones(5), {"reaction.a.force_x_N": slow}), 2.0)
    assert np.allclose(found["reaction.a.force_x_N"], [np.nan, np.nan, 2, 3, 4, 5, 6, np.nan, np.nan], equal_nan=True)


def test_quaternions_keep_unit_length_on_the_shorter_way():
    half = np.radians([0.0, 40.0, 80.0])
    signs = np.array([1.0, -1.0, 1.0])  # the same rotations
    pose = {f"pose.p.q{letter}": np.zeros(3) for letter in "xyzw"}
    pose["pose.p.qz"], pose["pose.p.qw"] = signs * np.sin(half), signs * np.cos(half)
    found, ways = resampled(table([0, 1, 2], [0, 1, 2], [1, 1, 1], pose), 2.0)
    angles = np.arctan2(found["pose.p.qz"], found["pose.p.qw"])
    assert np.allclose(np.degrees(angles), [0, 20, 40, 60, 80]) and ways["pose.p.qw"] == "linear, unit length"


def test_runs_whose_times_repeat_are_refused():
    with pytest.raises(InputError, match="do not increase at 0 s"):
        resampled(table([0, 1, 0, 1], [0, 1, 0, 1], [1] * 4), 10.0)
