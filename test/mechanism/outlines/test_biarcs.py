"""Tabulated curves of outlines: tangent arcs through all points, which approach a smooth curve as its points do."""

import math

import pytest

from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.outlines.pieces import Round
from test.generators.mechanism_texts import problem_of

TEXT = """
mechanism: cam
parts:
  cam: {{shape: {{type: outline, mass: 2, points: [{points}]}}}}
  ball: {{shape: {{type: sphere, radius: 1, mass: 1}}}}
joints:
  cam: {{type: revolute, between: [ground, cam], axis: [0, 0, 1]}}
  ball: {{type: planar, between: [ground, ball], axis: [0, 0, 1], x_axis: [1, 0, 0], position: [9, 0, 0]}}
contacts: {{c: {{between: [ball, cam]}}}}
"""


def pieces_of(points):
    (contact,) = {each.name: each for each in parse_mechanism(TEXT.format(points=points)).contacts}.values()
    return next(body for body in (contact.first, contact.second) if body.at.part == "cam").outline.pieces


def ellipse(count, wide=1.0, high=1.0):
    angles = [2.0 * math.pi * k / count for k in range(count)]
    points = [[wide * math.cos(angle), high * math.sin(angle)] for angle in angles]
    return f"{points[0]}, {{curve: {[*points[1:], points[0]]}}}"


def test_points_of_a_circle_give_arcs_of_it():
    pieces = pieces_of(ellipse(7))
    assert len(pieces) == 14
    for piece in pieces:
        assert piece.radius == pytest.approx(1.0, abs=1e-13)
        assert piece.center == pytest.approx((0.0, 0.0), abs=1e-13)


def off(count):
    """The largest distance of the middles of all arcs from an ellipse, to first order."""
    pieces, found = pieces_of(ellipse(count, 1.0, 0.6)), 0.0
    assert all(isinstance(piece, Round) and piece.radius != 0.0 for piece in pieces)  # no lines, no corners
    for piece in pieces:
        middle = 0.5 * (piece.first + piece.last)
        x, y = (c + piece.radius * f(middle) for c, f in zip(piece.center, (math.cos, math.sin), strict=True))
        found = max(found, abs(x * x + (y / 0.6) ** 2 - 1.0) / (2.0 * math.hypot(x, y / 0.36)))
    return found


def test_the_distance_from_a_smooth_curve_falls_with_the_third_power_of_that_of_its_points():
    assert off(48) < 1e-4
    assert 6.0 < off(24) / off(48) < 12.0


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ("[0, 0], {curve: [[1, 0], [1, 0], [2, 1]]}", "point 2 of the curve is the one before it as well"),
        ("[0, 0], {curve: [[1, 0], [0.1, 0], [0.1, 1]]}", "the curve turns back at point"),
        ("{curve: [[1, 0], [2, 1]]}, [0, 0], [1, 5]", "has no point before it, from which a curve could begin"),
        ("[0, 0], {curve: [[1, 0], [1, 1]], to: [1, 1]}", "needs one of to, polar, curve"),
        ("[0, 0], {curve: [[1, 0], [1, 1]], radius: 1}", "has radius and curve"),
    ],
)
def test_a_curve_that_cannot_be_built_is_reported(points, message):
    problem = problem_of(TEXT.format(points=points))
    assert problem.message.startswith(message)
    assert problem.key.startswith("parts.cam.shape.points")
