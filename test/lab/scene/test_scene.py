"""What the scene draws for a frame."""

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.scene.arrows import Arrows
from mbd_sim.lab.scene.ground import planes
from mbd_sim.lab.scene.scene import Scene
from mbd_sim.lab.scene.vectors import Vectors
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.pictures.shapes.extent import extent_of
from test.lab.scene.recording_scene import RecordingScene


@pytest.fixture
def session():
    return OwnSession(Bench.of(load_mechanism("four_bar")), running=False)


@pytest.fixture
def drawn(session):
    nodes, model = RecordingScene(), session.bench.simulation.model
    scene = Scene(nodes, model, extent_of(model), None, dark=False)
    scene.show(session.frame)
    return nodes, scene


def lengths(nodes):
    return sorted(node.height for node in nodes.nodes.values() if node.kind == "add_cylinder" and node.height > 0.3)


def test_rods_have_the_lengths_of_the_sliders(session, drawn):
    nodes, scene = drawn
    assert lengths(nodes) == pytest.approx([0.5, 1.2, 1.4])
    session.ask("change", lambda session: session.change("parameters.coupler", 1.6))
    session.turn()
    before = nodes.added
    scene.show(session.frame)
    assert lengths(nodes) == pytest.approx([0.5, 1.2, 1.6])
    assert nodes.added - before < 12  # what did not change is not drawn again


def test_a_frame_that_looks_the_same_is_not_sent(session, drawn):
    nodes, scene = drawn
    frames = [node for name, node in nodes.nodes.items() if node.kind == "add_frame"]
    for node in frames:
        node.position = None
    session.turn()
    scene.show(session.frame)
    assert all(node.position is None for node in frames)
    session.step(1)
    session.turn()
    scene.show(session.frame)
    assert all(node.position is not None for node in frames)


def test_the_path_of_a_point_is_its_circle(session, drawn):
    _, scene = drawn
    scene.traces.choose("crank.tip")
    for _ in range(300):
        session.step(5)
        session.turn()
        scene.show(session.frame)
    radii = np.linalg.norm(scene.traces._handles["crank"].points.reshape(-1, 3), axis=1)
    assert len(radii) > 100
    assert radii == pytest.approx(np.full(len(radii), 0.5), abs=1e-6)


def test_kept_paths_stay_under_their_labels_until_they_are_cleared(drawn):
    nodes, scene = drawn
    scene.keep_path("nothing is drawn yet")
    for size, label in ((1.0, "as in the file"), (2.0, "crank = 0.3 m")):
        scene.draw_path(size * np.eye(3))
        scene.keep_path(label)
    scene.draw_path(np.empty((0, 3)))
    assert nodes.nodes["/kept_paths"].points.shape == (4, 2, 3)
    labels = [node for node in nodes.nodes.values() if node.kind == "add_label"]
    assert [label.points for label in labels] == ["as in the file", "crank = 0.3 m"]
    scene.clear_kept_paths()
    assert len(nodes.nodes["/kept_paths"].points) == 0
    assert not [node for node in nodes.nodes.values() if node.kind == "add_label"]


def test_arrows_and_arcs_grow_with_what_they_show():
    nodes = RecordingScene()
    arrows = Arrows(nodes, "loads", (0, 0, 0), 2.0, (10.0, 4.0))
    origin, x = np.zeros(3), np.array([1.0, 0.0, 0.0])
    arrows.show(Vectors([(origin, 10.0 * x), (origin, 1e4 * x), (origin, 1e-9 * x)], [(origin, 4.0 * x)]))
    drawn = nodes.nodes["/loads"].points
    assert drawn[:, 1, 0] == pytest.approx([0.5, 1.2])  # a quarter of the size, and the longest
    arc = nodes.nodes["/loads_arcs"].points.reshape(-1, 3)
    assert arc[:, 0] == pytest.approx(np.zeros(len(arc)))
    assert np.max(np.linalg.norm(arc, axis=1)) < 0.2
    arrows.show(Vectors([(x, 10.0 * x)]), [True])
    assert nodes.nodes["/loads"].points[0, :, 0] == pytest.approx([0.5, 1.0])  # a push ends at its point
    assert len(nodes.nodes["/loads_arcs"].points) == 0


def test_planes_of_ground_are_found_once():
    (plane,) = planes(load_mechanism("bounce"), 1.0)
    assert np.allclose(plane[1], [0.0, 0.0, 1.0])
    assert len(planes(load_mechanism("column_of_beads"), 1.0)) == 1


def test_the_force_of_a_contact_is_an_arrow_that_ends_there():
    session = OwnSession(Bench.of(load_mechanism("bounce")), running=False)
    session.step(6000)  # until it rests
    session.turn()
    nodes, model = RecordingScene(), session.bench.simulation.model
    Scene(nodes, model, extent_of(model), None, dark=False).show(session.frame)
    (arrow,) = nodes.nodes["/contacts"].points
    size = extent_of(model).size
    assert arrow[1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert arrow[0] == pytest.approx([0.0, 0.0, -0.25 * size], rel=1e-5)  # the weight of all parts
    assert nodes.nodes["/contact_points"].points[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    (line,) = nodes.nodes["/contact_normals"].points
    assert line[1] - line[0] == pytest.approx([0.0, 0.0, 0.12 * size], rel=1e-5)


def test_a_spring_appears_with_its_stiffness():
    """Its line was one too many, which ended the thread that shows pictures."""
    session = OwnSession(Bench.of(load_mechanism("cart_pendulum")), running=False)
    nodes, model = RecordingScene(), session.bench.simulation.model
    scene = Scene(nodes, model, extent_of(model), None, dark=False)
    drawn = len(scene._lines)
    for stiffness, lines in ((5.0, drawn + 1), (0.0, drawn)):
        session.change("joints.rail.stiffness", stiffness)
        session.turn()
        scene.show(session.frame)
        assert len(scene._lines) == lines
