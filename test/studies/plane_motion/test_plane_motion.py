"""Instant centers by lines of centers are those of velocities; centrodes roll; polygons and circles fit the motion."""

import functools

import numpy as np
import pytest

from mbd_sim import InputError, load_mechanism
from mbd_sim.studies.kinematic_analysis import driven_motion
from mbd_sim.studies.plane_motion import (
    PlanarDrive,
    centrodes,
    draw_plane_motion,
    inflection_circle,
    instant_centers,
    polygons,
)
from mbd_sim.studies.plane_motion.centers import center_by_velocities, kennedy_centers
from mbd_sim.studies.plane_motion.reports import centers_text, centrode_columns, inflection_text, polygons_text


@functools.cache
def plane(name, drive, start, stop, rows):
    return PlanarDrive(driven_motion(load_mechanism(name), {drive: (start, stop)}, rows, speed=3.0))


@pytest.mark.parametrize(("name", "drive"), [("four_bar", "crank_pivot"), ("slider_crank", "pivot")])
def test_all_centers_by_lines_are_those_of_velocities(name, drive):
    motion = plane(name, drive, 1.0, 1.6, 13)
    for row in (0, 7, 12):
        snapshot = motion.at(row)
        by_lines, count = kennedy_centers(snapshot), len(snapshot.links)
        assert len(by_lines) == len(instant_centers(snapshot)) == count * (count - 1) // 2
        for (one, other), (vector, _) in by_lines.items():
            exact = center_by_velocities(snapshot.links[one], snapshot.links[other], snapshot)
            assert np.linalg.norm(np.cross(vector, exact)) < 1e-12


def test_centrodes_roll_on_each_other():
    """Both have the same length between two positions, and the moving one, in its place, touches the fixed one."""
    motion = plane("four_bar", "crank_pivot", 1.2, 1.4, 201)
    found = centrodes(motion, "coupler")
    fixed, moving = (np.sum(np.abs(np.diff(path))) for path in (found.fixed, found.moving))
    assert fixed == pytest.approx(moving, rel=1e-5)
    link = motion.at(100).links["coupler"]
    placed = link.place + link.turn * found.moving
    assert placed[100] == pytest.approx(found.fixed[100], abs=1e-12)
    slopes = [path[101] - path[99] for path in (found.fixed, placed)]
    assert abs(np.imag(slopes[0] / slopes[1])) < 1e-5


def test_points_on_the_inflection_circle_have_no_normal_acceleration():
    snapshot = plane("four_bar", "crank_pivot", 1.0, 1.6, 13).at(4)
    circle = inflection_circle(snapshot, "coupler")
    link = snapshot.links["coupler"]
    for angle in np.arange(1, 8):
        point = circle.center + circle.radius * np.exp(1j * angle)
        velocity, acceleration = link.velocity_of(point), link.acceleration_of(point)
        assert abs(np.imag(np.conj(velocity) * acceleration)) < 1e-9 * abs(velocity) * abs(acceleration)
    assert inflection_circle(plane("slider_crank", "pivot", 1.0, 1.6, 13).at(0), "slider") is None


def test_vectors_of_polygons_are_those_of_the_motion_of_points():
    motion = plane("four_bar", "crank_pivot", 1.0, 1.6, 13)
    snapshot, point = motion.at(5), motion.motion.point("coupler.tip")
    found = polygons(snapshot)
    for vector in found.vectors:
        if vector.joint == "rocker_pin":
            for value, exact in ((vector.velocity, point.velocity[5]), (vector.acceleration, point.acceleration[5])):
                assert value == pytest.approx(complex(exact[0], exact[2]), abs=1e-11)
    for (first, second), (normal, tangential) in found.components.items():
        apart = found.vectors[second].acceleration - found.vectors[first].acceleration
        assert normal + tangential == pytest.approx(apart, abs=1e-11)
    text = polygons_text(found) + centers_text(list(instant_centers(snapshot).values()))
    assert "tangential" in text and "Kennedy" in text


def test_they_are_drawn_and_tabulated(tmp_path):
    motion = plane("slider_crank", "pivot", 1.0, 1.6, 13)
    snapshot, paths = motion.at(0), [centrodes(motion, "conrod" if "conrod" in motion.at(0).links else "coupler")]
    circle = inflection_circle(snapshot, paths[0].part)
    draw_plane_motion(
        tmp_path / "x.svg", snapshot, list(instant_centers(snapshot).values()), polygons(snapshot), paths, [circle]
    )
    assert "Velocity polygon" in (tmp_path / "x.svg").read_text() or (tmp_path / "x.svg").stat().st_size > 10_000
    assert len(centrode_columns(("drive", motion.motion.drive), paths)) == 5
    assert "diameter" in inflection_text(circle)


def test_spatial_mechanisms_and_unknown_parts_are_refused():
    with pytest.raises(InputError, match="does not move in a plane"):
        PlanarDrive(
            driven_motion(load_mechanism("bennett"), {next(iter(load_mechanism("bennett").joints)): (0.1, 0.2)}, 2)
        )
    with pytest.raises(InputError, match="there is no part 'couplr'"):
        centrodes(plane("four_bar", "crank_pivot", 1.0, 1.6, 13), "couplr")
