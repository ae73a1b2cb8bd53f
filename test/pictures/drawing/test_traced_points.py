"""Bars from the shapes of parts to traced points and pins beside them."""

import numpy as np
import pytest

from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.files.load import parse_mechanism
from mbd_sim.pictures.drawing.animation import traced_point_paths
from mbd_sim.pictures.drawing.parts import pin_bar_paths
from mbd_sim.pictures.drawing.sheet import ScaledView, view_of
from mbd_sim.pictures.shapes.joints import traced_points
from mbd_sim.pictures.shapes.palette import part_colors
from mbd_sim.simulation.run.simulation import BaseSimulation

COUPLER = """mechanism: coupler
parts:
  bar:
    shapes:
      - {type: rod, to: [1, 0, 0], mass: 1}
      - {type: block, size: [0.2, 0.1, 0.1], at: [1, 0, 0.5], mass: 1}
    points: {tracer: [0.5, 0, -0.4], tip: [1, 0, 0], corner: [1.1, 0.05, 0.55], above: [1, 0, 0.8]}
joints: {pin: {type: revolute, between: [ground, bar], axis: [0, -1, 0], position: 0.3}}
"""


@pytest.fixture(scope="module")
def simulation():
    return BaseSimulation.from_text(COUPLER)


def paths(simulation, point):
    mechanism, poses = simulation.mechanism, simulation.poses()
    page = ScaledView(view_of(mechanism, poses), 100.0)
    return page, poses, traced_point_paths(page, mechanism, traced_points(mechanism, [point]), poses)


@pytest.mark.parametrize(
    ("point", "ends"), [("tracer", [[0.5, 0, 0], [0.5, 0, -0.4]]), ("above", [[1, 0, 0.55], [1, 0, 0.8]])]
)
def test_a_point_beside_its_part_is_joined_to_the_nearest_shape(simulation, point, ends):
    page, poses, (path,) = paths(simulation, f"bar.{point}")
    first, second = page.project(poses["bar"].position + np.array(ends) @ poses["bar"].rotation.T)
    along = (second - first) / np.linalg.norm(second - first)
    reach = (path.points - first) @ along
    aside = (path.points - first) @ np.array([-along[1], along[0]])
    assert reach.max() == pytest.approx(np.linalg.norm(second - first), abs=np.ptp(aside))
    assert reach.min() == pytest.approx(0.0, abs=np.ptp(aside)) and np.ptp(aside) < 6.0


@pytest.mark.parametrize("point", ["tip", "corner"])
def test_a_point_on_a_shape_needs_no_bar(simulation, point):
    assert paths(simulation, f"bar.{point}")[2] == []


@pytest.mark.parametrize(("point", "bars"), [("tracer", 1), ("tip", 0)])
def test_a_pin_beside_its_rod_is_joined_to_it(point, bars):
    text = COUPLER.replace(
        "joints: {",
        f"  link: {{mass: 1}}\njoints: {{p: {{type: revolute, between: [bar.{point}, link], axis: [0, -1, 0]}}, ",
    )
    mechanism = parse_mechanism(text)
    poses = Kinematics(mechanism).poses()
    page = ScaledView(view_of(mechanism, poses), 100.0)
    found = pin_bar_paths(page, mechanism, poses, part_colors(mechanism))
    assert len(found) == bars
    if bars:
        (traced,) = traced_point_paths(page, mechanism, traced_points(mechanism, [f"bar.{point}"]), poses)
        (bar,) = found
        assert np.mean(bar.points, axis=0) == pytest.approx(np.mean(traced.points, axis=0), abs=1.0)
        assert bar.edge == traced.edge and bar.fill == traced.fill
