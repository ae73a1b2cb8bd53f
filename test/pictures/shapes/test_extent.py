"""The box that the motion fills."""

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.pictures.shapes.extent import extent_of, upward
from test.generators import mesh_files


def test_the_extent_contains_the_swing_of_the_rods():
    extent = extent_of(Simulation.from_file("double_rod").model)
    assert extent.size == pytest.approx(2.0, abs=0.1)
    assert -2.1 < extent.lower[0] < -1.0
    assert -2.1 < extent.lower[2] < -1.5
    assert extent.upper[0] == pytest.approx(2.0, abs=0.1)
    assert extent.upper[2] < 1.0


@pytest.mark.parametrize(
    ("gravity", "up"),
    [
        ([0, 0, -9.81], [0, 0, 1]), ([0, -9.81, 0], [0, 1, 0]), ([3.0, 0, 0], [-1, 0, 0]), ([0, 0, 9.81], [0, 0, -1]),
        ([0, 0, 0], [0, 0, 1]), ([9.81, 0, -9.81], [0, 0, 1]),
    ],
)  # fmt: skip
def test_upward_is_against_gravity_along_an_axis_and_else_z(gravity, up):
    assert upward(np.array(gravity)).tolist() == up


def test_what_rests_on_a_floor_does_not_fall_through_it_in_the_preview():
    extent = extent_of(Simulation.from_file("bounce").model)
    assert extent.lower[2] > -0.5 * extent.size


def test_points_between_thick_bodies_are_shown_in_front_of_them():
    extent = extent_of(Simulation.from_file("bounce").model)
    points = np.array([[0.1, 0.0, 0.2], [0.1, 0.0, 0.2]])
    moved, kept = extent.in_front(points, np.array([True, False]))
    assert kept.tolist() == points[1].tolist()
    assert moved[[0, 2]].tolist() == [0.1, 0.2]
    assert moved[1] == extent.lower[1] < 0.0  # seen against y


def test_a_part_of_several_that_is_only_a_mesh_counts_with_its_mesh(tmp_path):
    """As the parts of an imported assembly, which have the points of their joints as well."""
    (tmp_path / "a.stl").write_bytes(mesh_files.binary_stl())
    part = "{mass: 1, inertia: [1, 1, 1], mesh: {file: a.stl}, points: {p: [0.01, 0, 0]}}"
    (tmp_path / "m.yaml").write_text(
        f"mechanism: m\ngravity: [0, 0, 0]\nparts: {{a: {part}, b: {part}}}\njoints:\n"
        "  one: {type: revolute, between: [ground, a], axis: [0, 0, 1]}\n"
        "  two: {type: revolute, between: [a.p, b.p], axis: [0, 0, 1]}\n"
    )
    extent = extent_of(Simulation(load_mechanism(tmp_path / "m.yaml")).model)
    assert extent.size == pytest.approx(0.3, abs=1e-6)


def test_the_extent_of_a_single_part_that_is_only_a_mesh_is_that_of_the_mesh(tmp_path):
    (tmp_path / "a.stl").write_bytes(mesh_files.binary_stl())
    (tmp_path / "r.urdf").write_text(
        '<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
        '<visual><geometry><mesh filename="a.stl"/></geometry></visual></link></robot>'
    )
    extent = extent_of(Simulation(load_mechanism(tmp_path / "r.urdf", base="free")).model)
    assert extent.size == pytest.approx(0.3, abs=1e-6)
