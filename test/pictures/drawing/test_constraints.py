"""Symbols of gears, racks and knife edges, and of springs, dampers and friction laws in joints."""

import functools

import numpy as np
import pytest

from mbd_sim.pictures.drawing.constraints import constraint_paths, coupling_paths
from mbd_sim.pictures.drawing.picture import compose
from mbd_sim.pictures.drawing.sheet import GRAY, ScaledView, view_of
from test.pictures.start import AtStart

GEARS = """
mechanism: gears
ground: {points: {out: [DISTANCE, 0, 0]}}
parts:
  a: {mass: 1, shape: {type: disc, radius: 0.1, axis: [0, 1, 0]}}
  b: {mass: 1, shape: {type: ring, radius: 0.3, axis: [0, 1, 0]}}
joints:
  small: {type: revolute, between: [ground.out, a], axis: [0, 1, 0]}
  large: {type: revolute, between: [ground, b], axis: [0, SIGN, 0]}
constraints: {teeth: {type: gear, joints: [small, large], radii: [0.1, 0.3], internal: INTERNAL}}
"""


def paths(simulation):
    mechanism, poses = simulation.mechanism, simulation.poses()
    page = ScaledView(view_of(mechanism, poses), 1000.0)
    return coupling_paths(page, mechanism, poses, mechanism.constraints[0])


def circles(found):
    """Center and radius in m of each dash-dotted circle."""
    rounds = [path.points / 1000.0 for path in found if path.dash and len(path.points) > 10]
    middles = [np.mean(points[:-1], axis=0) for points in rounds]
    return [(m, np.linalg.norm(points - m, axis=1).mean()) for m, points in zip(middles, rounds, strict=True)]


@pytest.mark.parametrize(("distance", "internal", "sign"), [(0.4, "false", 1), (0.2, "false", -1)])
def test_pitch_circles_touch(distance, internal, sign):
    text = GEARS.replace("DISTANCE", str(distance)).replace("INTERNAL", internal).replace("SIGN", str(sign))
    (first, small), (second, large) = circles(paths(AtStart.from_text(text)))
    np.testing.assert_allclose([small, large], [0.1, 0.3], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(first - second), distance, atol=1e-9)


def test_a_pitch_circle_is_drawn_on_the_wheel():
    simulation = AtStart.from_file("driveline")
    page = ScaledView(view_of(simulation.mechanism, simulation.poses()), 1000.0)
    drawn = paths(simulation)
    (counter,) = (path for path in drawn if path.dash and np.ptp(path.points[:, 1]) > 150.0)
    start = simulation.poses()["counter"]
    center = page.project(start.position + start.rotation @ [0.2, 0.0, 0.0])
    assert np.linalg.norm(np.mean(counter.points[:-1], axis=0) - center) < 20.0


def test_a_rack_has_a_pitch_line_that_touches_its_pinion():
    found = paths(AtStart.from_file("rack_and_pinion"))
    ((center, radius),) = circles(found)
    (line,) = (path.points / 1000.0 for path in found if path.dash and len(path.points) == 2)
    np.testing.assert_allclose(radius, 0.05, atol=1e-9)
    np.testing.assert_allclose(center[1] - line[:, 1], radius, atol=1e-9)
    np.testing.assert_allclose(np.ptp(line[:, 0]), 0.4, atol=1e-9)


def test_a_weight_beyond_its_drum_hangs_on_a_cable():
    found = paths(AtStart.from_file("disk_weight"))
    assert not any(path.dash for path in found)
    run = found[-1].points / 1000.0
    np.testing.assert_allclose(np.abs(run[:, 0]), 0.3, atol=1e-9)


def test_wheels_on_skew_axes_and_general_couplings_are_not_drawn():
    text = GEARS.replace("DISTANCE", "0.4").replace("INTERNAL", "false").replace("[0, SIGN, 0]", "[1, 0, 0]")
    assert paths(AtStart.from_text(text)) == []
    text = GEARS.split("constraints:")[0].replace("DISTANCE", "0.4").replace("SIGN", "1")
    assert paths(AtStart.from_text(text + "constraints: {c: {type: coupling, terms: {small: 1, large: 2}}}")) == []


LAWS = """
mechanism: laws
parts:
  block: {mass: 2, shape: {type: block, size: [0.2, 0.1, 0.1]}}
  arm: {mass: 1, shape: {type: rod, to: [0.8, 0, 0]}}
joints:
  rail: {type: prismatic, between: [ground, block], axis: [1, 0, 0]RAIL}
  hinge: {type: revolute, between: [block, arm], axis: [0, SLANT, -1]HINGE}
"""


@functools.cache
def paths_drawn(text, slant):
    simulation = AtStart.from_text(text.replace("RAIL", "").replace("HINGE", "").replace("SLANT", str(slant)))
    return len(compose(simulation.mechanism, simulation.poses()).sheet.paths)


@pytest.mark.parametrize("slant", [0, 1])
@pytest.mark.parametrize(
    ("joint", "law"),
    [
        ("RAIL", ", spring: {force: 3*x^3}"),
        ("RAIL", ", damper: {coefficient: 4, exponent: 2}"),
        ("RAIL", ", friction: {coulomb: 2 N}"),
        ("HINGE", ", spring: {table: [[-1, -6], [0, 0], [1, 9]]}"),
        ("HINGE", ", friction: {coulomb: 0.5}"),
    ],
)
def test_laws_in_joints_have_symbols(joint, law, slant):
    assert paths_drawn(LAWS.replace(joint, law), slant) > paths_drawn(LAWS, slant)


def test_a_blade_points_along_its_edge():
    simulation = AtStart.from_file("knife_edge")
    without = AtStart.from_text(simulation.mechanism.source.text.split("constraints:")[0])
    pictures = [compose(s.mechanism, s.poses()).sheet.paths for s in (simulation, without)]
    assert len(pictures[0]) == len(pictures[1]) + 1


@pytest.mark.parametrize(("bound", "side"), [("at_least", -1.0), ("at_most", 1.0)])
@pytest.mark.parametrize("carrier", ["ground", "table"])
def test_a_one_sided_plane_is_hatched_where_the_point_cannot_be(bound, side, carrier):
    simulation = AtStart.from_text(f"""
mechanism: hatched
parts:
  table: {{shape: {{type: block, mass: 1, size: [1, 0.1, 0.1]}}, points: {{top: [0, 0, 0]}}}}
  ball: {{shape: {{type: particle, mass: 1, radius: 0.02}}}}
joints:
  table: {{type: prismatic, between: [ground, table], axis: [1, 0, 0]}}
  ball: {{type: prismatic, between: [table, ball], axis: [0, 0, 1], position: {-0.2 * side}}}
constraints: {{bound: {{type: on_plane, point: ball, plane: {carrier}, bound: {bound}}}}}
""")
    mechanism, poses = simulation.mechanism, simulation.poses()
    page = ScaledView(view_of(mechanism, poses), 1000.0)
    strokes = [path.points for path in constraint_paths(page, mechanism, poses, 1.0) if path.edge == GRAY]
    assert len(strokes) > 10
    assert all(np.sign(stroke[1, 1] - stroke[0, 1]) == side for stroke in strokes)
