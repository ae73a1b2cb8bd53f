"""Motors, efforts and bushings on the sheet."""

from itertools import combinations

import numpy as np
import pytest

from mbd_sim.files.load import parse_mechanism
from mbd_sim.pictures.drawing.forces import AWAY, LETTER, MOTOR, drive_paths, force_paths
from mbd_sim.pictures.drawing.sheet import ScaledView, view_of
from mbd_sim.pictures.shapes.joints import coordinate_frame, driven_coordinates, has_cylinder
from test.pictures.start import AtStart

TEXT = """
mechanism: text
ground: {points: {wall: [-2, 0, 0.5]}}
parts: {cart: {mass: 1}, arm: {mass: 1, inertia: [1, 1, 1]}, ball: {mass: 1, inertia: [1, 1, 1]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], position: 0.3}
  pin: {type: revolute, between: [cart, arm], axis: [0, -1, 0]}
  free: {type: free, between: [ground, ball]}
"""


def drawn(text, page):
    mechanism = parse_mechanism(TEXT + text)
    poses = AtStart(mechanism).poses()
    return drive_paths(page, mechanism, poses) + force_paths(page, mechanism, poses)


@pytest.fixture
def page():
    simulation = AtStart.from_text(TEXT)
    return ScaledView(view_of(simulation.mechanism, simulation.poses()), 100.0)


def test_a_motor_is_a_circle_with_an_m_beside_its_joint(page):
    _, circle, letter = drawn("actuators: {m: {type: effort, joint: pin}}", page)
    center = page.project(np.array([0.3, 0.0, 0.0])) + AWAY
    assert np.hypot(*(circle.points - center).T) == pytest.approx(MOTOR)
    assert letter.points == pytest.approx(center + LETTER)


@pytest.mark.parametrize("sign, axis", [(1.0, "[1, 0, 0]"), (-1.0, "[-1, 0, 0]")])
def test_an_effort_along_a_line_is_an_arrow_in_its_positive_direction(page, sign, axis):
    text = TEXT.replace("axis: [1, 0, 0]", f"axis: {axis}") + "forces: {e: {type: effort, coordinate: rail, effort: 1}}"
    mechanism = parse_mechanism(text)
    line, head = drive_paths(page, mechanism, AtStart(mechanism).poses())
    assert np.sign(line.points[-1] - line.points[0])[0] == sign and len(head.points) >= 3


def test_a_bushing_is_a_ring_at_its_first_point(page):
    paths = drawn("forces: {b: {type: bushing, between: [ground.wall, arm], stiffness: 1}}", page)
    at = page.project(np.array([-2.0, 0.0, 0.5]))
    assert len(paths) == 3
    for path in paths:
        radii = np.hypot(*(path.points - at).T)
        assert radii == pytest.approx(radii[0])


PLANAR = TEXT.replace(
    "free: {type: free, between: [ground, ball]",
    "plane: {type: planar, between: [ground, ball], axis: [0, 1, 0], x_axis: [1, 0, 0]",
)
SEVERAL = TEXT.replace("[ground, ball]", "[ground, ball], position: [0.5, 0, 2]")


@pytest.mark.parametrize("coordinate, direction", [("free.x", [1, 0, 0]), ("free.z", [0, 0, 1])])
def test_an_effort_on_one_of_several_coordinates_is_an_arrow_at_the_moved_part(page, coordinate, direction):
    mechanism = parse_mechanism(SEVERAL + f"forces: {{e: {{type: effort, coordinate: {coordinate}, effort: 1}}}}")
    line, _ = drive_paths(page, mechanism, AtStart(mechanism).poses())
    along = line.points[-1] - line.points[0]
    expected = page.direction(np.array(direction, dtype=float))
    assert along @ expected == pytest.approx(np.hypot(*along) * np.hypot(*expected))
    assert np.hypot(*(line.points.mean(axis=0) - page.project(np.array([0.5, 0.0, 2.0])))) < 20.0


def test_symbols_at_one_joint_do_not_cover_each_other(page):
    names = ("plane.x", "plane.y", "plane.angle")
    actuators = "".join(f"m{n}: {{type: effort, joint: {name}}}, " for n, name in enumerate(names[:2]))
    forces = "".join(f"e{n}: {{type: effort, coordinate: {name}, effort: 1}}, " for n, name in enumerate(names))
    mechanism = parse_mechanism(PLANAR + f"actuators: {{{actuators}}}\nforces: {{{forces}}}\n")
    paths = drive_paths(page, mechanism, AtStart(mechanism).poses())
    centers = [path.points.mean(axis=0) for path in paths if path.closed]
    assert min(np.hypot(*(a - b)) for a, b in combinations(centers, 2)) > 2.0


def test_the_housing_of_a_coordinate_is_on_its_axis():
    mechanism = parse_mechanism(PLANAR + "actuators: {m: {type: effort, joint: plane.y}}")
    ((_, joint, coordinate),) = driven_coordinates(mechanism)
    part, frame = coordinate_frame(joint, coordinate)
    assert part == "ground" and frame.rotation[:, 2] == pytest.approx([0.0, 0.0, -1.0])


@pytest.mark.parametrize("law, shown", [("x.velocity", True), ("x**3", False)])
def test_a_law_without_a_potential_is_shown_as_a_cylinder(law, shown):
    force = f"forces: {{s: {{type: line_force, between: [ground.wall, arm], force: {law}}}}}"
    assert has_cylinder(parse_mechanism(TEXT + force).springs[0]) is shown
