"""Pose rows: what is packed comes back, column by column in memory."""

import numpy as np

from mbd_sim import Simulation
from mbd_sim.base.geometry.pose import pack_poses, unpack_poses


def test_a_row_is_the_position_and_the_columns_of_the_rotation():
    rotation = np.arange(9.0).reshape(3, 3)
    row = pack_poses(np.array([10.0, 11.0, 12.0]), rotation)
    assert row.tolist() == [10, 11, 12, 0, 3, 6, 1, 4, 7, 2, 5, 8]


def test_unpacking_inverts_packing_for_any_leading_shape():
    random = np.random.default_rng(1)
    for shape in ((), (4,), (2, 5), (0,)):
        positions, rotations = random.normal(size=(*shape, 3)), random.normal(size=(*shape, 3, 3))
        found = unpack_poses(pack_poses(positions, rotations))
        assert np.array_equal(found[0], positions) and np.array_equal(found[1], rotations)


def test_the_rows_of_a_model_are_its_poses():
    simulation = Simulation.from_file("tumbling")
    simulation.run(until=0.5)
    model = simulation.model
    positions, rotations = unpack_poses(model.pose_array(simulation.time, simulation.state))
    for name, position, rotation in zip(model.part_names, positions, rotations, strict=True):
        assert np.array_equal(simulation.poses()[name].position, position)
        assert np.array_equal(simulation.poses()[name].rotation, rotation)
    assert np.allclose(rotations @ np.swapaxes(rotations, -1, -2), np.eye(3), atol=1e-12)
