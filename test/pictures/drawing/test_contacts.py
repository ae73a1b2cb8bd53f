"""Closed contacts and their planes on the sheet."""

import numpy as np
import pytest

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.load import parse_mechanism
from mbd_sim.pictures.drawing.constraints import constraint_paths
from mbd_sim.pictures.drawing.contacts import COLOR, contact_paths
from mbd_sim.pictures.drawing.sheet import ScaledView, view_of
from mbd_sim.pictures.shapes.joints import LONG
from mbd_sim.pictures.shapes.touching import NORMAL, Touching

BLOCKS = """
mechanism: blocks
parts:
  left: {shape: {type: block, mass: 1, size: [0.1, 0.1, 0.1]}}
  right: {shape: {type: block, mass: 1, size: [0.1, 0.1, 0.1]}}
joints:
  left: {type: planar, between: [ground, left], axis: [0, 1, 0], x_axis: [1, 0, 0], position: [-3, -0.05, 0]}
  right: {type: planar, between: [ground, right], axis: [0, 1, 0], x_axis: [1, 0, 0], position: [3, -0.05, 0]}
contacts: {floor: {parts: [left, right], plane: ground}}
"""


def page_of_blocks():
    mechanism = parse_mechanism(BLOCKS)
    poses = {"left": Pose(np.array([-3.0, 0.0, 0.05]), np.eye(3)), "right": Pose(np.array([3.0, 0.0, 0.05]), np.eye(3))}
    return mechanism, poses, ScaledView(view_of(mechanism, poses), 100.0)


def test_a_plane_is_drawn_once_and_below_everything_that_touches_it():
    """It was drawn about the first body alone."""
    mechanism, poses, page = page_of_blocks()
    (line,) = [path for path in constraint_paths(page, mechanism, poses, 1.0) if path.width == 1.4]
    ends = sorted(line.points @ [1.0, 0.0])
    assert ends == pytest.approx([-320.0, 320.0])  # 15 % of the size beyond the outermost corners


def test_a_plane_of_ground_does_not_move_along_with_what_touches_it():
    """Walls of a bin fell with the balls between them."""
    mechanism, poses, page = page_of_blocks()
    fallen = {name: Pose(pose.position + np.array([0.2, 0.0, 0.0]), np.eye(3)) for name, pose in poses.items()}
    (line,) = [path for path in constraint_paths(page, mechanism, fallen, 1.0, start=poses) if path.width == 1.4]
    assert sorted(line.points @ [1.0, 0.0]) == pytest.approx([-320.0, 340.0])


def test_a_contact_has_a_dot_a_line_along_its_normal_and_an_arrow_that_ends_there():
    _, _, page = page_of_blocks()
    points, normals = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), np.tile([0.0, 0.0, 1.0], (2, 1))
    touching = Touching(
        points, np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 0.0]]), normals, np.array([True, True]), np.array([True, True])
    )
    lines = contact_paths(page, touching, 1.0, 10.0)
    assert {path.edge for path in lines if path.fill is None} == {COLOR}
    first, second, shaft = (path.points for path in lines if not path.closed)
    for line, x in ((first, 100.0), (second, 200.0)):
        assert line == pytest.approx(np.array([[x, -100.0 * NORMAL], [x, 100.0 * NORMAL]]))
    assert shaft[0] == pytest.approx([100.0, -50.0 * LONG])
    dots = [path.points[:-1].mean(axis=0) for path in lines if path.closed][1:]
    assert dots == [pytest.approx([100.0, 0.0]), pytest.approx([200.0, 0.0])]
