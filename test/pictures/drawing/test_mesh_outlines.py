"""Meshes in pictures: outlines with holes, few points, and no collision shapes beside them."""

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.cli.main import main
from mbd_sim.pictures.drawing import draw
from mbd_sim.pictures.drawing.animation import Animation
from mbd_sim.pictures.drawing.mesh_outlines import MOST_POINTS, outlines
from mbd_sim.pictures.drawing.picture import compose
from mbd_sim.pictures.drawing.sheet import BODIES
from test.generators import mesh_files

ROBOT = """<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
  <visual><geometry><mesh filename="package://pack/meshes/a.dae"/></geometry></visual>
    <collision><geometry><box size="1 1 1"/></geometry></collision></link></robot>"""


def square(low, high):
    a, b, c, d = (low, low), (high, low), (high, high), (low, high)
    return [[a, b, c], [a, c, d]]


def frame(inner, outer):
    """A square ring, in points."""
    around = []
    for turn in range(4):
        rotation = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), turn)
        a, b, c, d = np.array([[outer, -outer], [outer, outer], [inner, inner], [inner, -inner]]) @ rotation.T
        around += [[a, b, c], [a, c, d]]
    return np.array(around)


def area(ring):
    x, y = np.array(ring).T
    return (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


def robot(folder):
    (folder / "pack" / "meshes").mkdir(parents=True)
    (folder / "pack" / "meshes" / "a.dae").write_text(mesh_files.collada())
    (folder / "r.urdf").write_text(ROBOT)
    return folder / "r.urdf"


def test_the_outline_of_a_square_has_its_corners_and_its_area():
    ((ring,),) = outlines(np.array(square(-40.0, 60.0)))
    assert len(ring) <= 12
    np.testing.assert_allclose([ring.min(axis=0), ring.max(axis=0)], [[-40.0] * 2, [60.0] * 2], atol=0.3)
    assert abs(area(ring)) == pytest.approx(100.0**2, rel=5e-3)


def test_a_hole_is_an_outline_of_its_own_that_turns_the_other_way():
    ((outer, hole),) = outlines(frame(20.0, 50.0))
    assert abs(area(outer)) == pytest.approx(100.0**2, rel=1e-2)
    assert area(hole) == pytest.approx(-np.sign(area(outer)) * 40.0**2, rel=2e-2)


def test_separate_pieces_are_separate_outlines_and_specks_are_left_out():
    pieces = outlines(np.array(square(0.0, 30.0) + square(50.0, 70.0) + square(80.0, 80.2)))
    assert [round(abs(area(piece[0])) / 100.0) for piece in pieces] == [9, 4]


def test_an_outline_has_few_points_however_fine_the_mesh_is():
    rng = np.random.default_rng(0)
    places = rng.uniform(-200.0, 200.0, (1200, 1, 2))
    pieces = outlines(places + rng.uniform(-6.0, 6.0, (1200, 3, 2)))
    assert sum(len(ring) for piece in pieces for ring in piece) <= MOST_POINTS


def test_a_mesh_seen_edge_on_is_a_line():
    ((ring,),) = outlines(np.array([[[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]]]))
    assert np.ptp(ring[:, 0]) == pytest.approx(100.0, abs=0.5) and np.ptp(ring[:, 1]) < 0.5


def test_a_mesh_is_drawn_instead_of_the_collision_shape(tmp_path):
    mechanism = load_mechanism(robot(tmp_path), base="free")
    simulation = Simulation(mechanism)
    paths = compose(mechanism, simulation.poses()).sheet.paths
    (body,) = [path for path in paths if path.layer == BODIES and path.fill and path.edge is None]
    assert len(body.points) <= 12  # of a tetrahedron, not of a box
    assert Animation(simulation.model).frame(simulation.poses()).min() < 200


def test_the_same_mesh_gives_the_same_svg_of_bounded_size(tmp_path):
    simulation = Simulation(load_mechanism(robot(tmp_path), base="free"))
    for name in ("a.svg", "b.svg"):
        draw(simulation.mechanism, simulation.poses(), tmp_path / name)
    first = (tmp_path / "a.svg").read_bytes()
    assert first == (tmp_path / "b.svg").read_bytes()
    assert len(first) < 60_000


def test_meshes_that_a_picture_lacks_are_named(tmp_path, capsys):
    path = robot(tmp_path)
    (tmp_path / "pack" / "meshes" / "a.dae").unlink()
    assert main(["check", str(path), "--draw", str(tmp_path / "a.png")]) == 0
    assert "note: meshes that are not drawn: package://pack/meshes/a.dae (not found)" in capsys.readouterr().err
