"""The camera sees the whole box of the motion, in the part of the window that the panel leaves free."""

from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.scene.camera import FREE_ON_A_PHONE, aim
from mbd_sim.lab.session.bench import Bench
from mbd_sim.pictures.shapes.extent import extent_of


def seen(extent, width, height):
    """The corners of the box on the screen, in halves of the width and height, y upward."""
    camera = SimpleNamespace()
    aim(camera, extent, width / height, width)
    forward = np.array(camera.look_at) - camera.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    box = np.array([extent.lower, extent.upper])
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    arms = corners - camera.position
    depth = arms @ forward
    slope = np.tan(0.5 * camera.fov)
    x, y = arms @ right / depth / slope, arms @ np.cross(right, forward) / depth / slope
    return x * height / width, y


@pytest.mark.parametrize("name", ["four_bar", "bounce", "motor_drive", "six_axis_arm"])
@pytest.mark.parametrize(("width", "height"), [(1080, 900), (920, 720), (390, 844)])
def test_the_box_fills_the_free_part_of_the_window(name, width, height):
    x, y = seen(extent_of(Bench.of(load_mechanism(name)).simulation.model), width, height)
    free = FREE_ON_A_PHONE if width < 576 else 1.0
    assert np.all(np.abs(x) <= 1.0)
    assert np.all(y <= 1.0)
    assert np.all(y >= 1.0 - 2.0 * free - 1e-9)
    assert max(np.ptp(x), np.ptp(y) / free) > 0.8
