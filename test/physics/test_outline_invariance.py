"""The motion of outlines in contact does not depend on the axes, the plane, the side or the units it is written in."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.files.load import parse_mechanism

LENGTHS = {"to", "through", "round", "radius"}
PLANES = {"xy": np.eye(3), "xz": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), "yz": np.roll(np.eye(3), 1, axis=0)}
TABLE = [[-0.5, -0.2], [0.5, -0.2], [0.5, 0.0], {"to": [0.2, -0.05], "round": 0.02}, {"to": [-0.1, 0.0], "radius": -0.4}, [-0.5, 0.03]]  # fmt: skip
CAM = [[0.06, 0.0], {"to": [-0.04, 0.0], "through": [0.01, 0.05]}, [-0.03, -0.03], {"to": [0.05, -0.03], "round": 0.01}]
BLOCK = "{type: block, mass: 0.5, size: %s, at: %s, rotate: %s}"


def text(plane="xy", rotate=None, mirror=1.0, length=1.0, block=False):
    """A cam and a block that fall onto a table, in given axes."""
    turned = np.eye(3) if rotate is None else rot.about(rot.unit(rotate[0]), rotate[1])
    axes = turned @ PLANES[plane]

    def scaled(value):
        if isinstance(value, list):
            return [mirror * length * value[0], length * value[1]]
        return length * value

    def entry(point):
        if isinstance(point, list):
            return scaled(point)
        return {key: mirror * scaled(value) if key == "radius" else scaled(value) for key, value in point.items()}

    def vector(x, y, z=0.0):
        return (axes @ (length * np.array([mirror * x, y, z]))).tolist()

    rotation = f"{{axis: {[1, 0, 0] if rotate is None else rotate[0]}, angle: {0.0 if rotate is None else rotate[1]}}}"
    cam, table = ([entry(point) for point in points] for points in (CAM, TABLE))
    size = np.abs(PLANES[plane] @ np.array([0.06, 0.04, 0.02])) * length
    joint = f"type: planar, axis: {axes[:, 2].tolist()}, x_axis: {axes[:, 0].tolist()}"
    dropped = f"  block: {{shape: {BLOCK % (size.tolist(), vector(0.01, 0.0), rotation)}}}"
    m, s = mirror, length
    return f"""
mechanism: outlines
gravity: {vector(0.0, -9.81)}
parts:
  table: {{shape: {{type: outline, mass: 1, plane: {plane}, points: {table}, rotate: {rotation}}}}}
  cam: {{shape: {{type: outline, mass: 1, plane: {plane}, points: {cam}, rotate: {rotation}}}}}
{dropped if block else ""}
joints:
  table: {{type: fixed, between: [ground, table]}}
  cam: {{{joint}, between: [ground, cam], position: [{-m * 0.1 * s}, {0.08 * s}, {m * 0.4}], velocity: [{m * 0.5 * s}, 0, {-m}]}}
{f"  block: {{{joint}, between: [ground, block], position: [{m * 0.25 * s}, {0.05 * s}, {m * 0.2}], velocity: [{-m * 0.3 * s}, 0, {m}]}}" if block else ""}
contacts:
  floor: {{between: [cam, table], friction: 0.3, restitution: 0.4}}
{"  below: {between: [block, table], friction: 0.2}" if block else ""}
{"  beside: {between: [cam, block], friction: 0.1}" if block else ""}
"""


def motion(steps=250, **changes):
    simulation = Simulation(parse_mechanism(text(**changes)), method="tsitouras8")
    simulation.step(steps)
    return np.concatenate([simulation.q, simulation.u]).reshape(-1, 3)


@pytest.fixture(scope="module")
def reference():
    found = motion(block=True)
    assert np.all(found[:2, 1] > -0.1)  # both lie on the table
    return found


def test_a_mirrored_mechanism_in_other_axes_and_another_plane_moves_as_in_a_mirror(reference):
    """Axes of the plane that are wrong in an outline or a block show here.

    In the mirror, arcs turn to the other side, and corners are passed in the other order.
    """
    mirrored = motion(block=True, plane="xz", rotate=([3, -1, 1], -2.1), mirror=-1.0)
    np.testing.assert_allclose(mirrored, reference * [-1.0, 1.0, -1.0], atol=1e-9)


def test_lengths_in_other_units_do_not_change_a_digit():
    """A number with a dimension that is hidden in the code shows, beside micrometers or hundreds of meters.

    Powers of 2 round nothing; of outlines of micrometers the last two digits differ.
    """
    small, large = (motion(200, length=length) / [length, length, 1.0] for length in (2.0**-14, 1024.0))
    np.testing.assert_allclose(small, large, rtol=1e-12, atol=0.0)
