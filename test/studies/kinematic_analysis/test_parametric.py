"""Derivatives by parameters against differences of the motions of other mechanisms, and tolerances with linear theory."""

import csv

import numpy as np
import pytest

from mbd_sim import InputError, MbdSimError, MechanismError, load_mechanism
from mbd_sim.cli.main import main
from mbd_sim.files.checks.override import with_values
from mbd_sim.studies.kinematic_analysis import MotionSensitivity, ToleranceAnalysis, drive_loads, driven_motion
from test.studies.kinematic_analysis.linkages import four_bar, rocker_angles

DRIVES = {"motor": (0.0, 2.0)}
KEYS = ["a", "b", "d", "px", "parts.rocker.mass"]
SPEED = 3.0


@pytest.fixture(scope="module")
def motion():
    return driven_motion(four_bar(), DRIVES, 4, speed=SPEED)


@pytest.fixture(scope="module")
def sensitivity(motion):
    return MotionSensitivity(four_bar(), motion, KEYS, with_forces=True)


def by_differences(quantity, key, value, h=1e-3):
    """The derivative of a quantity of a motion by a parameter, of fourth order; everything is linear in a mass."""

    def at(k):
        return quantity(driven_motion(with_values(four_bar(), {key: value + k * h}), DRIVES, 4, speed=SPEED))

    if key.endswith("mass"):
        return (at(1) - at(-1)) / (2 * h)
    moved = [at(k) for k in (-2, -1, 1, 2)]
    return (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12 * h)


@pytest.mark.parametrize("key", ["a", "parts.rocker.mass"])
def test_derivatives_are_those_of_differences(sensitivity, key):
    index = KEYS.index(key)

    def everything(motion):
        point, pivot = motion.point("coupler.tracer"), np.array(motion.coordinate("pivot")).T
        effort = drive_loads(motion).efforts["motor"][:, None]
        return np.hstack([point.position, point.velocity, point.acceleration, pivot, effort])

    point, pivot = sensitivity.point("coupler.tracer"), sensitivity.coordinate("pivot")
    found = [point.position[..., index], point.velocity[..., index], point.acceleration[..., index]]
    found.append(np.stack([pivot.position, pivot.velocity, pivot.acceleration], axis=1)[..., index])
    found.append(sensitivity.efforts()[..., index])
    expected = by_differences(everything, key, sensitivity.values[index])
    assert np.max(np.abs(np.hstack(found) - expected)) < 1e-8


def test_derivatives_of_the_rocker_are_those_of_its_closed_form(motion, sensitivity):
    """By Richardson's extrapolation of the closed form, of sixth order."""
    for key in ("a", "b", "d"):
        size = {"a": 0.5, "b": 1.4, "d": 1.5}[key]

        def angle(change, key=key, size=size):
            return rocker_angles(motion.drive, **{key: size + change})[0]

        h = 4e-3
        one, two, three = ((angle(k * h) - angle(-k * h)) / (2 * k * h) for k in (1, 2, 3))
        slopes = sensitivity.coordinate("pivot").position[:, KEYS.index(key)]
        assert np.max(np.abs(slopes - (1.5 * one - 0.6 * two + 0.1 * three))) < 1e-9


def test_lengths_of_an_overconstrained_linkage_are_refused():
    """A pivot that leaves the plane of a linkage whose pins are all parallel."""
    mechanism = load_mechanism("four_bar")
    start = driven_motion(mechanism, {"crank_pivot": (0.6, 0.7)}, 2)
    with pytest.raises(MbdSimError, match="redundant constraints contradict a change of the parameters"):
        MotionSensitivity(mechanism, start, ["ground.points.pivot[1]"])


def test_tolerances_add_up_as_in_linear_theory(motion):
    given = {"a": 1e-4, "b": 2e-4, "px": 1e-4}
    found = ToleranceAnalysis(four_bar(), motion, given, samples=60, seed=4)
    slopes = MotionSensitivity(four_bar(), motion, list(given)).coordinate("pivot").position
    effects = slopes * list(given.values())
    pivot = found.coordinate("pivot")
    assert np.array_equal(pivot.worst_case, np.abs(effects).sum(axis=1))
    assert pivot.root_sum_square == pytest.approx(np.hypot(*effects[:, :2].T), rel=1e-13)
    linear = found.samples @ slopes.T
    assert pivot.deviation == pytest.approx(linear.std(axis=0, ddof=1), rel=2e-3)
    assert pivot.greatest == pytest.approx(linear.max(axis=0), rel=5e-3)
    assert 3.0 * pivot.deviation == pytest.approx(pivot.root_sum_square, rel=0.2)
    tracer = found.point("coupler.tracer")
    assert 3.0 * tracer.deviation[:, 0] == pytest.approx(tracer.root_sum_square[:, 0], rel=0.2)
    assert np.array_equal(found.samples, np.random.default_rng(4).normal(size=(60, 3)) / 3.0 * [1e-4, 2e-4, 1e-4])


def test_uniform_samples_stay_within_the_worst_case(motion):
    found = ToleranceAnalysis(four_bar(), motion, {"a": 1e-5, "c": 1e-5}, samples=30, distribution="uniform")
    pivot = found.coordinate("pivot")
    assert np.all(np.maximum(pivot.greatest, -pivot.least) < 1.001 * pivot.worst_case)
    assert np.all(pivot.greatest > 0.5 * pivot.worst_case)


@pytest.mark.parametrize(
    ("tolerances", "samples", "error", "message"),
    [
        ({}, 0, InputError, "must be positive numbers"),
        ({"a": -1.0}, 0, InputError, "must be positive numbers"),
        ({"a": 1e-4}, 1, InputError, "1 sample cannot have a standard deviation"),
        ({"e": 1e-4}, 0, MechanismError, "e: is not a key of this file"),
        ({"parts.crank.mass": 1e-4}, 0, MechanismError, "the equations do not depend on it"),
    ],
)
def test_wrong_tolerances(motion, tolerances, samples, error, message):
    with pytest.raises(error, match=message):
        ToleranceAnalysis(four_bar(), motion, tolerances, samples=samples)


def test_on_the_command_line(tmp_path, capsys):
    table = tmp_path / "motion.csv"
    words = ["--drive", "crank_pivot=0:360deg:5", "--point", "coupler.tip", "--sensitivity", "rocker"]
    words += ["--tolerance", "crank=0.1mm", "--tolerance", "coupler=0.2 mm", "--samples", "10", "--out", str(table)]
    assert main(["kinematics", "four_bar", *words]) == 0
    out = capsys.readouterr().out
    assert "Sensitivity         by rocker (SI units): rocker_pivot " in out
    assert "Tolerances          rocker_pivot: worst case ±" in out and "Tolerances          coupler.tip x: " in out
    with table.open(encoding="utf-8") as stream:
        row = next(csv.DictReader(stream))
    assert float(row["rocker_pivot.position_rad.worst_case"]) > float(row["rocker_pivot.position_rad.root_sum_square"])
    assert float(row["coupler.tip.y_m.by_rocker"]) == 0.0 and float(row["coupler.tip.x_m.by_rocker"]) != 0.0
    assert main(["kinematics", "four_bar", *words[:2], "--samples", "3"]) == 1
    assert "--samples without tolerances" in capsys.readouterr().err
