"""What is drawn, where the eye stands, and the small parts of the viewer."""

import numpy as np
import pytest
from rerun.chunk import RrdReader

from mbd_sim import Simulation
from mbd_sim.appearance import palette
from mbd_sim.appearance.extent import extent_of
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.rotation import quaternions
from mbd_sim.viewer import blueprint
from mbd_sim.viewer.mailbox import Mailbox
from mbd_sim.viewer.rerun_stream import RerunStream
from mbd_sim.viewer.sample_rows import RowWriter
from mbd_sim.viewer.scene_description import DisplayOptions, describe_scene

EVERY_SHAPE = """
mechanism: every_shape
parts:
  cart: {mass: 2 kg, shape: {type: block, size: [0.5, 0.3, 0.2]}}
  wheel:
    shapes:
      - {type: disc, radius: 0.3, axis: [0, 1, 0], mass: 1 kg}
      - {type: particle, at: [0.25, 0, 0], mass: 0.3 kg}
      - {type: ring, radius: 0.3, axis: [0, 1, 0], mass: 1 kg}
    points: {rim: [0, 0, -0.3]}
  flag:
    shapes:
      - {type: plate, size: [0.3, 0.5], axis: [0, 1, 0], at: [0, 0, -0.2], mass: 1 kg}
      - {type: rod, to: [0, 0, -0.4], mass: 0.2 kg}
      - {type: sphere, radius: 0.1, at: [0, 0, -0.5], mass: 1 kg, color: '#ff6600'}
  holed:
    mass: 1 kg
    shapes:
      - {type: cylinder, radius: 0.2, length: 0.1, axis: [0, 1, 0]}
      - {type: cylinder, radius: 0.1, length: 0.1, axis: [0, 1, 0], hole: true}
  lump: {mass: 1 kg, inertia: [0.1, 0.1, 0.1], center: [0.2, 0, 0], points: {a: [0.4, 0, 0]}}
joints:
  slide: {type: prismatic, between: [ground, cart], axis: [1, 0, 0]}
  axle: {type: revolute, between: [cart, wheel], axis: [0, -1, 0]}
  hinge: {type: revolute, between: [wheel.rim, flag], axis: [0, -1, 0]}
  weld: {type: revolute, between: [wheel.rim, holed], axis: [0, -1, 0]}
  last: {type: revolute, between: [wheel.rim, lump], axis: [0, -1, 0]}
"""


def test_every_kind_of_shape_is_drawn(tmp_path):
    sim = Simulation.from_text(EVERY_SHAPE)
    scene = describe_scene(sim.model, RowWriter(sim.model).layout, DisplayOptions())
    RerunStream(scene, str(tmp_path / "a.rrd")).close()
    drawn = {}
    for chunk in RrdReader(tmp_path / "a.rrd").stream().to_chunks():
        if chunk.is_static:
            names = [name for name in chunk.to_record_batch().schema.names if ":" in name]
            drawn.setdefault(chunk.entity_path, {}).update(chunk.to_record_batch().to_pydict())
            drawn[chunk.entity_path]["kind"] = names[0].split(":")[0]
    kinds = {path.removeprefix("/world/"): values["kind"] for path, values in drawn.items()}
    expected = {
        "parts/cart/0_block": "Boxes3D",
        "parts/wheel/0_disc": "Cylinders3D",
        "parts/wheel/1_particle": "Ellipsoids3D",
        "parts/wheel/2_ring": "Mesh3D",
        "parts/flag/0_plate": "Boxes3D",
        "parts/flag/1_rod": "Capsules3D",
        "parts/flag/2_sphere": "Ellipsoids3D",
        "parts/holed/0_cylinder": "Cylinders3D",
        "parts/holed/1_cylinder": "Cylinders3D",
        "parts/lump/center": "Ellipsoids3D",
        "parts/lump/points": "LineStrips3D",
        "ground/joints/slide": "Cylinders3D",
        "parts/cart/joints/axle": "Cylinders3D",
    }
    assert {path: kinds.get(path) for path in expected} == expected
    assert drawn["/world/parts/flag/2_sphere"]["Ellipsoids3D:colors"] == [[0xFF6600FF]]
    solid, wires = 3, 1
    assert drawn["/world/parts/holed/0_cylinder"]["Cylinders3D:fill_mode"] == [[solid]]
    assert drawn["/world/parts/holed/1_cylinder"]["Cylinders3D:fill_mode"] == [[wires]]


def test_a_planar_mechanism_is_seen_from_the_side_with_x_to_the_right():
    extent = extent_of(Simulation.from_file("double_rod").model)
    np.testing.assert_allclose(np.abs(extent.normal), [0.0, 1.0, 0.0], atol=1e-12)
    position, target, up = blueprint.eye(extent)
    forward = (target - position) / np.linalg.norm(target - position)
    assert forward[1] > 0.9
    assert np.cross(forward, up)[0] > 0.9
    assert position[2] > target[2]


def test_the_view_has_room_for_the_swing_of_the_rods():
    extent = extent_of(Simulation.from_file("double_rod").model)
    assert extent.size == pytest.approx(2.0, abs=0.1)
    assert -2.1 < extent.lower[0] < -1.0
    assert -2.1 < extent.lower[2] < -1.5
    assert extent.upper[0] == pytest.approx(2.0, abs=0.1)
    assert extent.upper[2] < 1.0


def test_a_free_body_is_seen_from_a_corner():
    extent = extent_of(Simulation.from_file("tumbling").model)
    assert extent.normal is None
    assert extent.size == pytest.approx(1.4)
    position, _, up = blueprint.eye(extent)
    assert np.all(np.isfinite(position))
    np.testing.assert_array_equal(up, [0.0, 0.0, 1.0])


def test_the_joint_of_a_part_has_the_parts_colour():
    mechanism = Simulation.from_file("double_rod").mechanism
    colors = palette.part_colors(mechanism)
    assert palette.series_colors(mechanism) == [colors["upper"], colors["lower"]]
    assert len(set(palette.series_colors(Simulation.from_file("tumbling").mechanism))) == 6


def test_quaternions_of_many_rotations_at_once():
    random = np.random.default_rng(1)
    wxyz = np.vstack([np.eye(4), random.normal(size=(200, 4))])
    wxyz /= np.linalg.norm(wxyz, axis=1, keepdims=True)
    matrices = np.array([rot.from_quaternion(q) for q in wxyz])
    again = np.roll(quaternions(matrices), 1, axis=1)
    np.testing.assert_allclose(np.abs(np.sum(again * wxyz, axis=1)), 1.0, atol=1e-14)


def test_a_mailbox_keeps_the_newest_and_counts_the_others():
    box = Mailbox(3)
    for number in range(5):
        box.put(number)
    assert len(box) == 3
    assert box.take(2) == [2, 3]
    assert box.dropped == 2
    box.put(5)
    assert box.take(10) == [4, 5]
    assert box.take(10) == []
    assert box.dropped == 2
    with pytest.raises(ValueError, match="at least 1"):
        Mailbox(0)
