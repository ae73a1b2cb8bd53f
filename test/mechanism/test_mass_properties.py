"""Mass properties against values worked out by hand (Huston & Liu, ch. 7) and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import from_quaternion, from_rpy
from mbd_sim.mechanism.mass_properties import MassProperties, composite, inertia_defect
from test.generators.mechanism_texts import part_of

FOOT, POUND = 0.3048, 0.45359237


def matrix(xx, yy, zz, xy=0.0, xz=0.0, yz=0.0):
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)


def assert_part(part, mass, center, inertia, error=1e-14):
    scale = np.max(np.abs(inertia)) or 1.0
    assert part.mass == pytest.approx(mass, rel=error)
    assert part.center == pytest.approx(np.array(center, dtype=float), abs=error)
    assert np.max(np.abs(part.inertia - inertia)) <= error * scale


PARTICLES = """{shapes: [
  {type: particle, mass: 2, at: [1, 1, 1]},
  {type: particle, mass: 3, at: [2, 2, 4]},
  {type: particle, mass: 4, at: [0, 5, 2]}]}"""


def test_parallel_axes_of_a_body_at_1_3_2():
    body = MassProperties(0.5, np.array([1.0, 3.0, 2.0]), np.zeros((3, 3)))
    assert body.about(np.zeros(3)).tolist() == matrix(6.5, 2.5, 5.0, xy=-1.5, xz=-1.0, yz=-3.0).tolist()
    own = matrix(0.3, 0.4, 0.5, xy=0.1)
    assert MassProperties(0.5, body.center, own).about(body.center).tolist() == own.tolist()


@pytest.mark.parametrize("degrees", [0, 5, 30, 60, 90, -20])
def test_disc_misaligned_on_a_shaft_along_x(degrees):
    m, r, c, s = 3.0, 0.4, math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    expected = m * r**2 * matrix(
        c**2 / 2 + s**2 / 4, s**2 / 2 + c**2 / 4, 1 / 4, xy=c * s / 4
    )  # fmt: skip
    tilted = f"axis: ['cos({degrees}*pi/180)', 'sin({degrees}*pi/180)', 0]"
    turned = f"axis: [1, 0, 0], rotate: {{axis: [0, 0, 1], angle: {degrees} deg}}"
    for orientation in (tilted, turned):
        part = part_of(f"{{mass: 3, shape: {{type: disc, radius: 0.4, {orientation}}}}}")
        assert_part(part, m, [0, 0, 0], expected)


BONDED = """{{{mass} shapes: [
  {{type: plate, {a} size: [2 ft, 4 ft], at: [1 ft, 2 ft, 0]}},
  {{type: plate, {b} size: [2 ft, 2 ft], at: [1 ft, 0, 1 ft], axis: [0, 1, 0]}}]}}"""


@pytest.mark.parametrize(
    "text",
    [BONDED.format(mass="", a="mass: 40 lb,", b="mass: 20 lb,"), BONDED.format(mass="mass: 60 lb,", a="", b="")],
    ids=["own masses", "mass shared by area"],
)
def test_plate_of_40_lb_bonded_at_a_right_angle_to_one_of_20_lb(text):
    # By hand, in lb and ft: G = (1, 4/3, 1/3); the first plate has (160, 40, 200)/3 and lies (0, 2, -1)/3 from G,
    # the second has (20, 40, 20)/3 and lies (0, -4, 2)/3 from G.
    expected = matrix(380 / 3, 40, 380 / 3, yz=80 / 3) * POUND * FOOT**2
    assert_part(part_of(text), 60 * POUND, np.array([1, 4 / 3, 1 / 3]) * FOOT, expected)


@pytest.mark.parametrize(
    ("shape", "mass", "moments"),
    [
        ("{type: particle, mass: 2}", 2.0, (0, 0, 0)),
        ("{type: rod, from: [-0.3, 0, 0], to: [0.3, 0, 0], mass: 2}", 2.0, (0, 0.06, 0.06)),
        ("{type: ring, radius: 0.5, mass: 2}", 2.0, (0.25, 0.25, 0.5)),
        ("{type: disc, radius: 0.5, mass: 2}", 2.0, (0.125, 0.125, 0.25)),
        ("{type: plate, size: [0.6, 1.2], mass: 2}", 2.0, (0.24, 0.06, 0.3)),
        ("{type: block, size: [1, 2, 3], density: 2}", 12.0, (13.0, 10.0, 5.0)),
        (
            "{type: cylinder, radius: 1, length: 3, density: 2}",
            6 * math.pi,
            (6 * math.pi, 6 * math.pi, 3 * math.pi),
        ),
        ("{type: sphere, radius: 0.5, density: 6}", math.pi, (math.pi / 10, math.pi / 10, math.pi / 10)),
        (
            "{type: ellipsoid, radii: [1, 2, 3], density: 5}",
            40 * math.pi,
            (104 * math.pi, 80 * math.pi, 40 * math.pi),
        ),
    ],
)
def test_each_shape_has_its_textbook_moments(shape, mass, moments):
    part = part_of(f"{{shape: {shape}}}")
    assert_part(part, mass, [0, 0, 0], np.diag(moments).astype(float))


def discs(radius, low, high):
    """Mass, height of the mass center, and moments across and along of a body of revolution with 1 kg/m³."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    z, dz = low + (high - low) * (nodes + 1.0) / 2.0, weights * (high - low) / 2.0
    dm = math.pi * radius(z) ** 2 * dz
    mass, center = np.sum(dm), np.sum(z * dm) / np.sum(dm)
    return mass, center, np.sum((radius(z) ** 2 / 4.0 + (z - center) ** 2) * dm), np.sum(radius(z) ** 2 / 2.0 * dm)


@pytest.mark.parametrize(("r", "length"), [(0.5, 2.0), (2.0, 0.3)])
def test_cones_and_capsules_have_the_moments_of_the_discs_they_consist_of(r, length):
    mass, center, across, along = discs(lambda z: r * (1.0 - z / length), 0.0, length)
    cone = part_of(f"{{shape: {{type: cone, radius: {r}, length: {length}, density: 1, at: [0, 0, 1]}}}}")
    assert_part(cone, mass, [0, 0, 1.0 + center], np.diag([across, across, along]))
    barrel = discs(lambda z: r + 0.0 * z, -length / 2.0, length / 2.0)
    dome = discs(lambda z: np.sqrt(r * r - (z - length / 2.0) ** 2), length / 2.0, length / 2.0 + r)
    moments = barrel[2] + 2.0 * (dome[2] + dome[0] * dome[1] ** 2), barrel[3] + 2.0 * dome[3]
    capsule = part_of(f"{{shape: {{type: capsule, radius: {r}, length: {length}, density: 1}}}}")
    assert_part(capsule, barrel[0] + 2.0 * dome[0], [0, 0, 0], np.diag([moments[0], *moments]))


def test_the_axis_of_a_cone_leads_from_its_base_to_its_tip():
    part = part_of("{shape: {type: cone, radius: 1, length: 2, mass: 1, at: [1, 0, 0], axis: [0, -3, 0]}}")
    np.testing.assert_allclose(part.center, [1.0, -0.5, 0.0], atol=1e-15)


@pytest.mark.parametrize("seed", range(6))
def test_a_hull_has_the_moments_of_the_tetrahedra_that_fill_it(seed):
    """Those of Delaunay, each with a rule of four points, which is exact for squares."""
    chance = np.random.default_rng(seed)
    points = (chance.normal(size=(20, 3)) * [1.0, 0.3, 2.0] + [2.0, 0.0, -1.0]).round(3)
    near, far = (5.0 + 3.0 * 5.0**0.5) / 20.0, (5.0 - 5.0**0.5) / 20.0
    mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for tetrahedron in points[Delaunay(points).simplices]:
        share = abs(np.linalg.det(tetrahedron[1:] - tetrahedron[0])) / 24.0
        for point in (np.full((4, 4), far) + (near - far) * np.eye(4)) @ tetrahedron:
            mass, first, second = mass + share, first + share * point, second + share * np.outer(point, point)
    center, turn = first / mass, from_quaternion(np.array([0.5, 0.5, 0.5, 0.5]))
    second -= mass * np.outer(center, center)
    inertia = np.trace(second) * np.eye(3) - second
    place = "at: [1, 2, 3], rotate: {quaternion: [1, 1, 1, 1]}"
    part = part_of(f"{{shape: {{type: hull, points: {points.tolist()}, density: 1, {place}}}}}")
    assert_part(part, mass, [1, 2, 3] + turn @ center, turn @ inertia @ turn.T, error=1e-12)


def test_a_hull_can_be_a_hole_and_share_a_mass():
    cube = "[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1], [0.5, 0.5, 0.5]]"
    hole = f"{{type: hull, points: {cube}, scale: [0.5, 0.5, 0.5], at: [-0.25, -0.25, -0.25], hole: true}}"
    part = part_of(f"{{mass: 7, shapes: [{{type: block, size: [1, 1, 1]}}, {hole}]}}")
    assert_part(part, 7.0, [0, 0, 0], (8.0 - 1.0 / 4.0) / 6.0 * np.eye(3))


def test_a_rod_lies_between_its_ends():
    # The direction is (1, 2, 2)/3, so I = m l²/12 (1 - n nᵀ) with m l²/12 = 1.5.
    part = part_of("{mass: 2, shape: {type: rod, from: [1, 1, 1], to: [2, 3, 3]}}")
    inertia = 1.5 * (np.eye(3) - np.outer([1, 2, 2], [1, 2, 2]) / 9)
    assert_part(part, 2.0, [1.5, 2, 2], inertia)


@pytest.mark.parametrize(("axis", "sides"), [("[0, 0, 1]", (0, 1)), ("[1, 0, 0]", (1, 2)), ("[0, -3, 0]", (2, 0))])
def test_a_plate_normal_to_a_coordinate_axis_has_its_sides_along_the_next_two(axis, sides):
    part = part_of(f"{{mass: 12, shape: {{type: plate, size: [1, 2], axis: {axis}}}}}")
    lengths = np.zeros(3)
    lengths[list(sides)] = 1, 2
    assert np.diag(part.inertia) == pytest.approx(np.sum(lengths**2) - lengths**2)


def test_a_tube_is_a_cylinder_with_a_hole():
    outer, inner, length, density = 0.2, 0.15, 0.8, 1000.0
    part = part_of(
        f"""{{shapes: [
          {{type: cylinder, radius: {outer}, length: {length}, density: {density}}},
          {{type: cylinder, radius: {inner}, length: {length}, density: {density}, hole: true}}]}}"""
    )
    mass = density * math.pi * (outer**2 - inner**2) * length
    along = mass * (outer**2 + inner**2) / 2
    across = mass * (3 * (outer**2 + inner**2) + length**2) / 12
    assert_part(part, mass, [0, 0, 0], np.diag([across, across, along]))


def test_a_hollow_sphere_shares_its_mass_among_material_and_hole():
    outer, inner = 0.5, 0.4
    part = part_of(
        f"{{mass: 3, shapes: [{{type: sphere, radius: {outer}}}, {{type: sphere, radius: {inner}, hole: true}}]}}"
    )
    moment = 0.4 * 3 * (outer**5 - inner**5) / (outer**3 - inner**3)
    assert_part(part, 3.0, [0, 0, 0], moment * np.eye(3))


def test_a_plate_with_a_hole_off_its_center():
    # A square of side 2 less a square of side 1 in its corner is an L of three unit squares of 1 kg each:
    # centers (-½, -½), (½, -½), (-½, ½), G = (-1/6, -1/6), about which
    # I_xx = I_yy = 3·(1/12) + (1/9 + 1/9 + 4/9) = 11/12 and I_xy = -(1/9 - 2/9 - 2/9) = 1/3.
    part = part_of(
        """{mass: 3, shapes: [
          {type: plate, size: [2, 2]},
          {type: plate, size: [1, 1], at: [0.5, 0.5, 0], hole: true}]}"""
    )
    assert_part(part, 3.0, [-1 / 6, -1 / 6, 0], matrix(11 / 12, 11 / 12, 11 / 6, xy=1 / 3))


def test_given_and_shared_masses_add_up():
    part = part_of(
        """{mass: 10, shapes: [
          {type: particle, mass: 4, at: [1, 0, 0]},
          {type: rod, to: [0, 1, 0]},
          {type: rod, to: [0, 0, 2]}]}"""
    )
    assert part.mass == pytest.approx(10.0)
    assert part.center == pytest.approx(np.array([4 * 1, 2 * 0.5, 4 * 1]) / 10)


def test_a_shape_of_mass_zero_is_only_drawn():
    part = part_of("{shapes: [{type: rod, to: [0, 0, -1], mass: 0}, {type: particle, at: [0, 0, -1], mass: 2}]}")
    assert_part(part, 2.0, [0, 0, -1], np.zeros((3, 3)))
    assert [shape.kind for shape in part.shapes] == ["rod", "particle"]


@settings(max_examples=10)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-2, 2)] * 3))
def test_a_block_anywhere_is_eight_particles_at_its_gauss_points(rpy, at):
    # ∫ x² over a side a equals a²/12, which is the square of ±a/√12.
    size = np.array([1.0, 2.0, 3.0])
    block = part_of(f"{{mass: 8, shape: {{type: block, size: [1, 2, 3], at: {[*at]}, rotate: {{rpy: {[*rpy]}}}}}}}")
    corners = [np.array([x, y, z]) * size / math.sqrt(12) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    points = [np.array(at) + from_rpy(*rpy) @ corner for corner in corners]
    second = sum(np.outer(point - at, point - at) for point in points)
    assert block.center == pytest.approx(np.array(at), abs=1e-12)
    assert block.inertia == pytest.approx(np.trace(second) * np.eye(3) - second, abs=1e-10)


def test_mass_properties_in_the_outer_frame_of_a_pose():
    body = MassProperties(2.0, np.array([1.0, 0.0, 0.0]), np.diag([1.0, 2.0, 3.0]))
    placed = body.placed(Pose(np.array([0.0, 0.0, 5.0]), from_rpy(0.0, 0.0, math.pi / 2)))  # x to y, y to -x
    assert placed.mass == 2.0 and placed.center == pytest.approx(np.array([0, 1, 5]))
    assert placed.inertia == pytest.approx(np.diag([2.0, 1.0, 3.0]))


def test_composing_in_steps_changes_nothing():
    bodies = [
        MassProperties(mass, np.array(center), np.diag(moments))
        for mass, center, moments in [
            (1.0, [0.0, 1.0, 2.0], [1.0, 1.0, 1.0]),
            (2.0, [1.0, -1.0, 0.5], [2.0, 3.0, 4.0]),
            (4.0, [-2.0, 0.0, 0.0], [0.1, 0.2, 0.3]),
        ]
    ]
    whole, stepwise = composite(bodies), composite([composite(bodies[:2]), bodies[2]])
    assert whole.mass == 7.0 and stepwise.center == pytest.approx(whole.center)
    assert stepwise.inertia == pytest.approx(whole.inertia)


@pytest.mark.parametrize("moments", [(1, 1, 2), (0, 1, 1), (1, 1, 1), (0, 0, 0), (2, 3, 4), (1e-9, 1e-9, 2e-9)])
def test_possible_moments_pass(moments):
    assert inertia_defect(np.diag(moments).astype(float)) is None


@pytest.mark.parametrize("scale", [1e-40, 1e-9, 1.0, 1e40])
def test_impossible_moments_are_named_at_any_scale(scale):
    assert "violates the triangle inequality" in inertia_defect(np.diag([1, 1, 2.001]) * scale)
    assert "negative principal moment" in inertia_defect(np.diag([-0.001, 1, 1]) * scale)
    assert "negative principal moment" in inertia_defect(matrix(1, 1, 1, xy=1.01) * scale)
    turned = from_rpy(0.3, 0.4, 0.5)
    assert "violates the triangle inequality" in inertia_defect(turned @ np.diag([1, 1, 2.001]) @ turned.T * scale)
