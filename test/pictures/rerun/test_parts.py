"""Every kind of shape is drawn as the right archetype of Rerun."""

from mbd_sim import Simulation
from mbd_sim.pictures.rerun.scene import DisplayOptions, RowMaker, describe_scene

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
    from rerun.chunk import RrdReader

    from mbd_sim.pictures.rerun.stream import RerunStream

    sim = Simulation.from_text(EVERY_SHAPE)
    scene = describe_scene(sim.model, RowMaker(sim.model).layout, DisplayOptions())
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
