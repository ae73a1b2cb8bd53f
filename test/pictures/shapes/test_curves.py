"""Curves and surfaces given by equations: what is drawn lies on them."""

import numpy as np
import pytest

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.load import load_mechanism
from mbd_sim.mechanism.elements.constraints import Surface
from mbd_sim.pictures.drawing.constraints import constraint_curves
from mbd_sim.pictures.drawing.picture import compose
from mbd_sim.pictures.drawing.sheet import view_of
from mbd_sim.pictures.shapes.curves import follow_curve, section_lines
from test.pictures.start import AtStart

SURFACE = """
mechanism: surface
ground: {points: {base: {at: [0.1, 0.2, 0.3], rotate: {axis: [1, 0, 0], angle: 20 deg}}}}
parts: {p: {mass: 1, shape: {type: sphere, radius: 0.02}}}
joints: {flight: {type: free, between: [ground, p], position: PLACE}}
constraints: {kept: {type: on_surface, point: p, frame: FRAME, equation: EQUATION}}
"""


def lines_of(simulation):
    mechanism, poses = simulation.mechanism, simulation.poses()
    return constraint_curves(mechanism, poses, view_of(mechanism, poses))


def drawn_surface(place, equation, frame="ground"):
    text = SURFACE.replace("PLACE", place).replace("EQUATION", equation).replace("FRAME", frame)
    return lines_of(AtStart.from_text(text))


def test_a_curve_is_followed_in_both_directions_over_its_whole_length():
    (curve,) = lines_of(AtStart.from_file("bead_on_wire"))
    x, y, z = curve.points.T
    np.testing.assert_allclose(y, 0.3 * np.sin(4.0 * x), atol=1e-9)
    np.testing.assert_allclose(z, (x**2 + y**2) / 1.6, atol=1e-9)
    assert x.min() < -0.9 and x.max() > 0.9 and curve.kind == "curve"
    steps = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
    assert steps.max() < 1.5 * np.median(steps)


def test_a_sphere_has_a_round_outline_and_lines_on_both_sides():
    simulation = AtStart.from_file("insect_on_sphere")
    toward = view_of(simulation.mechanism, simulation.poses()).toward
    lines = lines_of(simulation)
    for line in lines:
        np.testing.assert_allclose(np.linalg.norm(line.points, axis=1), 0.3, atol=1e-9)
    (outline,) = (line for line in lines if line.kind == "outline")
    np.testing.assert_allclose(outline.points @ toward, 0.0, atol=1e-9)
    np.testing.assert_array_equal(outline.points[0], outline.points[-1])
    sides = {front: np.mean([np.mean(line.points @ toward) for line in lines if line.kind == "net" and line.front is front])
             for front in (True, False)}  # fmt: skip
    assert sides[True] > 0.05 and sides[False] < -0.05


@pytest.mark.parametrize(
    ("place", "equation", "value"),
    [
        ("[0.5, 0.2, 0.21]", "z - x**2 + y**2", lambda x, y, z: z - x**2 + y**2),
        ("[0.5, 0, 0.1]", "x**2 + y**2 - 0.25", lambda x, y, z: x**2 + y**2 - 0.25),
        ("[0, 0, 0]", "z - x**2", lambda x, y, z: z - x**2),
        ("[0.3, 0.3, 0]", "z", lambda x, y, z: z),
    ],
)
def test_open_surfaces_and_points_at_their_base_are_drawn(place, equation, value):
    lines = drawn_surface(place, equation)
    assert len(lines) > 5
    for line in lines:
        np.testing.assert_allclose(value(*line.points.T), 0.0, atol=1e-8)


def test_the_frame_of_the_equations_is_used():
    lines = drawn_surface("[0.1, 0.2, 0.8]", "(x**2 + y**2 + z**2 - 0.25)", "ground.base")
    for line in lines:
        np.testing.assert_allclose(np.linalg.norm(line.points - [0.1, 0.2, 0.3], axis=1), 0.5, atol=1e-8)


def test_in_a_planar_view_only_the_section_is_drawn():
    simulation = AtStart.from_text("""
mechanism: bowl
parts: {carrier: {mass: 0}, p: {mass: 1}}
joints:
  x: {type: prismatic, between: [ground, carrier], axis: [1, 0, 0], position: 0.5}
  z: {type: prismatic, between: [carrier, p], axis: [0, 0, 1], position: 0.25, guess: true}
constraints: {bowl: {type: on_surface, point: p, equation: z - x**2 + y}}
""")
    (cut,) = lines_of(simulation)
    np.testing.assert_allclose(cut.points[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(cut.points[:, 2], cut.points[:, 0] ** 2, atol=1e-9)
    assert np.all(np.isfinite(compose(simulation.mechanism, simulation.poses()).size))


def test_a_curve_ends_where_its_direction_or_value_is_undefined():
    def ending(point):
        x, y, z = point
        root = np.sqrt(x) if x >= 0.0 else np.nan
        return np.array([y - root, z]), np.array([[-0.5 / root if root else np.nan, 1.0, 0.0], [0.0, 0.0, 1.0]])

    line = follow_curve(ending, np.array([1.0, 1.0, 0.0]), 0.05, lambda point: point[0] < 2.0)
    assert len(line) > 20 and np.all(line[:, 0] > 0.0) and np.all(line[:, 0] < 2.0)
    flat = follow_curve(lambda point: (np.zeros(2), np.zeros((2, 3))), np.zeros(3), 0.1, lambda point: True)
    np.testing.assert_array_equal(flat, np.zeros((1, 3)))


def test_the_outline_that_a_point_touches_from_outside_is_drawn_though_the_point_is_away_from_it():
    mechanism = load_mechanism("ratchet_and_pawl")
    ground, tip = Pose(np.zeros(3), np.eye(3)), np.array([-1e-3, 0.0, 0.059])
    for constraint in mechanism.constraints:
        assert isinstance(constraint, Surface)
        (line,) = section_lines(constraint, tip, ground, np.array([0.0, -1.0, 0.0]))
        radii, angles = np.hypot(line.points[:, 0], line.points[:, 2]), np.arctan2(line.points[:, 2], line.points[:, 0])
        assert np.max(np.abs(radii - 0.05)) == pytest.approx(4e-3 * np.arcsin(0.9), rel=1e-2)
        assert np.max(np.diff(np.sort(angles))) < 0.1
