"""Outlines in a file: what may be wrong with them, where it is reported, and the mass of parts with them."""

import numpy as np
import pytest

from mbd_sim.files.load import parse_mechanism
from test.generators.mechanism_texts import problem_of

TEXT = """
mechanism: plate
parts:
  plate:
    shapes:
      - {type: particle, mass: 0}
      - type: outline
        mass: 2
        OTHERS
        points:
          - [0, 0]
          - POINT
          - [10 cm, 10 cm]
joints:
  hinge: {type: revolute, between: [ground, plate], axis: [0, 0, 1]}
"""
LINE = TEXT.split("POINT")[0].count("\n")


def text_of(point, others="hole: false"):
    return TEXT.replace("POINT", point).replace("OTHERS", others).lstrip("\n")


WRONG = {
    "[0, 0]": "is the point before it as well. Remove one of the two points",
    "{to: [10 cm, 0], radius: 4 cm}": "the ends of the arc are 0.1 m apart, too far for a radius of 0.04 m",
    "{to: [10 cm, 0], center: [4 cm, 0]}": "the arc does not meet its ends, which are 0.04 m and 0.06 m from its center",
    "{to: [10 cm, 0], center: [5 cm, 0]}": "the arc around its center is half a turn, which leads along either side",
    "{to: [10 cm, 0], through: [7 cm, 0]}": "the three points of the arc are on one line",
    "{to: [10 cm, 0], round: 12 cm}": "the corner cannot be rounded with 0.12 m",
    "{to: [10 cm, 0], involute: 2 cm}": "an end of the involute is 0 m from its center, within the base circle of 0.02 m",
    "{to: [10 cm, 0], involute: 2 cm, center: [0, 5 cm]}": "the ends of the involute are 63.43495 deg apart",
    "{to: [10 cm, 0], radius: 1, through: [1, 1]}": "has through and radius",
}


@pytest.mark.parametrize("point", WRONG)
def test_a_point_that_cannot_be_reached_is_reported_at_its_line(point):
    problem = problem_of(text_of(point))
    assert problem.message.startswith(WRONG[point].split(".")[0])
    assert problem.remedy
    assert problem.line == LINE
    assert problem.key == "parts.plate.shapes[1].points[1]"


def test_an_outline_that_crosses_itself_is_reported_with_the_place():
    points = "[3 cm, 10 cm]\n          - [5 cm, -10 cm]"
    problem = problem_of(text_of("[10 cm, 0]").replace("[10 cm, 10 cm]", points))
    assert (
        problem.message == "the outline meets itself at [0.04, 0] m, in its pieces to [0.1, 0] m and to [0.05, -0.1] m"
    )
    assert problem.key == "parts.plate.shapes[1].points"


@pytest.mark.parametrize(("others", "message"), [
    ("repeat: 2.5", "repeat must be a whole number"),
    ("closed: false", "an outline that is not closed has no mass"),
])  # fmt: skip
def test_keys_that_do_not_fit_are_refused(others, message):
    assert message in problem_of(text_of("[10 cm, 0]", others)).message


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
def test_a_rectangle_has_the_mass_properties_of_a_block(plane):
    one, other = ("xyz".index(letter) for letter in plane)
    size = [0.05] * 3
    size[one], size[other] = 0.3, 0.2
    outline = "{type: outline, plane: %s, points: [[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]], thickness: 5 cm, density: 800}"
    block = "{type: block, size: %s, density: 800}"
    at = ", at: [0.1, 0.2, 0.3], rotate: {axis: [1, 2, 3], angle: 0.7}}"
    found = [
        parse_mechanism(
            f"mechanism: m\nparts: {{p: {{shape: {shape[:-1]}{at}}}}}\njoints: {{j: {{type: free, between: [ground, p]}}}}"
        ).parts["p"]
        for shape in (outline % plane, block % size)
    ]
    np.testing.assert_allclose(found[0].mass, found[1].mass, rtol=1e-14)
    np.testing.assert_allclose(found[0].center, found[1].center, atol=1e-15)
    np.testing.assert_allclose(found[0].inertia, found[1].inertia, rtol=1e-12, atol=1e-15)


def test_a_hole_and_the_material_around_it_share_the_mass_by_area():
    text = text_of("[10 cm, 0]", "hole: false").replace("        mass: 2\n", "")
    text = text.replace("  plate:\n", "  plate:\n    mass: 3\n").replace(
        "{type: particle, mass: 0}", "{type: outline, hole: true, points: [[5 cm, 1 cm], [7 cm, 1 cm], [7 cm, 3 cm]]}"
    )
    part = parse_mechanism(text).parts["plate"]
    full, hole = 5e-3, 2e-4
    assert part.mass == pytest.approx(3.0)
    expected = (full * np.array([2.0 / 3.0, 1.0 / 3.0]) * 0.1 - hole * np.array([19.0, 5.0]) / 300.0) / (full - hole)
    np.testing.assert_allclose(part.center[:2], expected, rtol=1e-12)
