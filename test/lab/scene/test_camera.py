"""The camera sees the whole box of the motion, in the part of the window that the panel leaves free."""

from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.scene.camera import FREE_ON_A_PHONE, aim
from mbd_sim.lab.scene.ground import _add_grid
from mbd_sim.lab.session.bench import Bench
from mbd_sim.pictures.shapes.extent import Extent, extent_of


def seen(extent, width, height):
    """The corners of the box on the screen, in halves of the width and height, y upward."""
    camera = SimpleNamespace()
    aim(camera, extent, width / height, width)
    forward = np.array(camera.look_at) - camera.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, extent.up)
    right /= np.linalg.norm(right)
    box = np.array([extent.lower, extent.upper])
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    arms = corners - camera.position
    depth = arms @ forward
    slope = np.tan(0.5 * camera.fov)
    x, y = arms @ right / depth / slope, arms @ np.cross(right, forward) / depth / slope
    return x * height / width, y


@pytest.mark.parametrize("name", ["four_bar", "bounce", "motor_drive", "six_axis_arm"])
@pytest.mark.parametrize(("width", "height"), [(1080, 900), (920, 720), (526, 440), (390, 844)])
def test_the_box_fills_the_free_part_of_the_window(name, width, height):
    require_filled(extent_of(Bench.of(load_mechanism(name)).simulation.model), width, height)


@pytest.mark.parametrize("up", [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
@pytest.mark.parametrize("normal", [None, *np.eye(3)])
def test_any_axis_of_ground_can_be_upward_and_planes_are_seen_from_the_same_side(up, normal):
    """Assemblies whose y points upward lie on their side, planar mechanisms are seen from the back, or through a grid."""
    extent = Extent(np.array([-0.3, 0.1, -0.2]), np.array([0.5, 0.6, 0.1]), 0.8, normal, up=up)
    require_filled(extent, 1080, 900)
    camera, drawn = SimpleNamespace(), {}
    aim(camera, extent)
    toward = np.array(camera.position) - camera.look_at
    if normal is None or not abs(up @ normal):
        assert toward @ up > 0.0
    if normal is not None and not abs(up @ normal):
        assert toward @ extent.toward > 0.8 * np.linalg.norm(toward)
    _add_grid(SimpleNamespace(add_grid=lambda name, **options: drawn.update(options)), extent, False)
    front = up if normal is None else extent.toward
    assert (extent.center - drawn["position"]) @ front > 0.0
    assert drawn["plane"] == "".join(letter for letter, one in zip("xyz", front, strict=True) if not one)


def require_filled(extent, width, height):
    x, y = seen(extent, width, height)
    free = FREE_ON_A_PHONE if (width, height) == (390, 844) else 1.0
    assert np.all(np.abs(x) <= 1.0)
    assert np.all(y <= 1.0)
    assert np.all(y >= 1.0 - 2.0 * free - 1e-9)
    assert max(np.ptp(x), np.ptp(y) / free) > 0.8
