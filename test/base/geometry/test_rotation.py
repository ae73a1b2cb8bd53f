"""Rotations: their conventions, by what they do to the axes, and their inverses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbd_sim.base.geometry import rotation as rot
from test.generators.mechanism_texts import part_of

X, Y, Z = np.eye(3)
QUARTER = math.pi / 2

angles = st.floats(-10.0, 10.0)
coordinates = st.floats(-1.0, 1.0)
vectors = st.tuples(coordinates, coordinates, coordinates).filter(lambda v: math.hypot(*v) > 1e-3)


def close(a, b, tolerance=1e-12):
    return np.allclose(a, b, rtol=0, atol=tolerance)


def is_rotation(matrix):
    return close(matrix @ matrix.T, np.eye(3)) and math.isclose(np.linalg.det(matrix), 1.0, rel_tol=1e-12)


def test_skew_is_the_cross_product():
    v, w = np.array([1.0, -2.0, 3.0]), np.array([4.0, 5.0, -6.0])
    assert (rot.skew(v) @ w).tolist() == [-3.0, 18.0, 13.0]


@pytest.mark.parametrize("size", [1e-60, 1e-3, 1.0, 1e40, 1e300])
def test_unit_keeps_the_direction_of_any_size(size):
    assert close(rot.unit((3 * size, 0.0, -4 * size)), [0.6, 0.0, -0.8])


def test_a_rotation_is_right_handed_about_its_axis():
    assert close(rot.about(Z, QUARTER) @ X, Y)
    assert close(rot.about(X, QUARTER) @ Y, Z)
    assert close(rot.about(Y, QUARTER) @ Z, X)
    diagonal = rot.unit((1.0, 1.0, 1.0))
    assert close(rot.about(diagonal, 2 * math.pi / 3) @ X, Y)


def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_that_order():
    assert close(rot.from_rpy(QUARTER, 0.0, 0.0) @ Y, Z)
    assert close(rot.from_rpy(0.0, QUARTER, 0.0) @ X, -Z)
    assert close(rot.from_rpy(0.0, 0.0, QUARTER) @ X, Y)
    turned = rot.from_rpy(QUARTER, 0.0, QUARTER)  # x stays x under roll, then goes to y; y goes to z and stays
    assert close(turned @ X, Y) and close(turned @ Y, Z) and close(turned @ Z, X)


def test_a_quaternion_is_the_cosine_then_the_axis_times_the_sine_of_half_the_angle():
    half = math.sqrt(0.5)
    assert close(rot.to_quaternion(rot.about(Z, QUARTER)), [half, 0.0, 0.0, half])
    assert close(rot.from_quaternion(np.array([half, 0.0, 0.0, half])) @ X, Y)
    assert close(rot.from_quaternion(np.array([0.5, 0.5, 0.5, 0.5])) @ X, Y)


@given(vectors, angles)
def test_a_quaternion_gives_its_rotation_back(axis, angle):
    matrix = rot.about(rot.unit(axis), angle)
    quaternion = rot.to_quaternion(matrix)
    assert math.isclose(np.linalg.norm(quaternion), 1.0, rel_tol=1e-12) and quaternion[0] >= 0.0
    assert is_rotation(matrix) and close(rot.from_quaternion(quaternion), matrix, 1e-9)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 2, 0), (1, 1, 1), (1e-9, 0, 1)])
def test_a_half_turn_has_its_axis_as_quaternion(axis):
    unit = rot.unit(axis)
    quaternion = rot.to_quaternion(2.0 * np.outer(unit, unit) - np.eye(3))
    assert close(abs(quaternion[0]), 0.0, 1e-9) and close(np.cross(quaternion[1:], unit), 0.0, 1e-9)


def test_a_product_is_the_second_rotation_followed_by_the_first():
    first, second = rot.of_vector(np.array([0.3, -0.5, 0.9])), rot.of_vector(np.array([-1.1, 0.2, 0.4]))
    assert close(
        rot.from_quaternion(rot.product(first, second)), rot.from_quaternion(first) @ rot.from_quaternion(second)
    )


def test_a_rotation_vector_is_the_axis_times_the_angle():
    vector = np.array([0.3, -0.5, 0.9])
    assert close(rot.from_quaternion(rot.of_vector(vector)), rot.about(rot.unit(vector), float(np.linalg.norm(vector))))
    assert close(rot.of_vector(np.zeros(3)), [1.0, 0.0, 0.0, 0.0])


@given(angles, st.floats(-QUARTER + 1e-3, QUARTER - 1e-3), angles)
def test_roll_pitch_and_yaw_give_their_rotation_back(roll, pitch, yaw):
    matrix = rot.from_rpy(roll, pitch, yaw)
    again = rot.to_rpy(matrix)
    assert close(again[1], pitch, 1e-9) and close(rot.from_rpy(*again), matrix, 1e-9)


@pytest.mark.parametrize("pitch", [QUARTER, -QUARTER])
def test_roll_pitch_and_yaw_give_their_rotation_back_where_pitch_is_a_quarter_turn(pitch):
    matrix = rot.from_rpy(0.3, pitch, -0.8)
    assert close(rot.from_rpy(*rot.to_rpy(matrix)), matrix, 1e-9)


@given(vectors)
def test_aligning_z_takes_z_to_the_axis(axis):
    unit = rot.unit(axis)
    matrix = rot.aligning_z(unit)
    assert is_rotation(matrix) and close(matrix @ Z, unit)


@pytest.mark.parametrize("axis", [X, Y, Z, -X, -Y, -Z])
def test_aligning_z_is_exact_along_the_coordinate_axes(axis):
    matrix = rot.aligning_z(axis)
    assert (matrix @ Z).tolist() == axis.tolist() and set(np.abs(matrix).flat) == {0.0, 1.0}
    assert np.linalg.det(matrix) == 1.0


@pytest.mark.parametrize(
    ("record", "image_of_x"),
    [
        ("{axis: [0, 0, 7], angle: 90 deg}", Y),
        ("{axis: [0, -2, 0], angle: 90 deg}", Z),
        ("{rpy: [0, 90 deg, 0]}", -Z),
        ("{quaternion: [1, 0, 0, 1]}", Y),
        ("{quaternion: [-2, 0, 0, -2]}", Y),
    ],
)
def test_the_forms_of_a_rotation_in_a_file(record, image_of_x):
    point = part_of(f"{{mass: 1, points: {{p: {{rotate: {record}}}}}}}").points["p"]
    assert is_rotation(point.rotation) and close(point.rotation @ X, image_of_x)


def test_quaternions_of_many_rotations_at_once():
    random = np.random.default_rng(1)
    wxyz = np.vstack([np.eye(4), random.normal(size=(200, 4))])
    wxyz /= np.linalg.norm(wxyz, axis=1, keepdims=True)
    matrices = np.array([rot.from_quaternion(q) for q in wxyz])
    again = np.roll(rot.quaternions(matrices), 1, axis=1)
    np.testing.assert_allclose(np.abs(np.sum(again * wxyz, axis=1)), 1.0, atol=1e-14)
