"""The motion in a file: forms follow each change of a length at once, and what was chosen on the page is in it."""

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.scene.keep import mechanisms_at
from mbd_sim.lab.scene.scene import Scene
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.pictures.drawing.animation import Animation
from mbd_sim.pictures.shapes.extent import extent_of
from test.lab.scene.recording_scene import RecordingScene


@pytest.fixture
def session():
    """A run in which the crank becomes shorter, and as long as before again."""
    session = OwnSession(Bench.of(load_mechanism("four_bar")), running=False)
    for length in (0.5, 0.3, 0.5):
        session.change("parameters.crank", length)
        session.step(10)
    return session


def new_scene(model, **options):
    nodes = RecordingScene()
    return nodes, Scene(nodes, model, extent_of(model), None, dark=False, **options)


def crank_lengths(nodes):
    """Those of the rods of the crank that are visible."""
    rods = [
        node
        for name, node in nodes.nodes.items()
        if name.startswith("/parts/crank/parts_") and node.kind == "add_cylinder" and node.visible
    ]
    return [rod.height for rod in rods]


def test_in_a_file_nothing_is_drawn_anew_when_a_length_changes(session):
    """A player shows a form that is drawn anew later than the poses: the coupler would hang beside the crank."""
    model = session.bench.simulation.model
    mechanisms = mechanisms_at(model, session.history.points())
    assert [one.parameters["crank"] for one in mechanisms] == [0.5, 0.3, 0.5, 0.5]  # at the start and after each step
    nodes, scene = new_scene(model, in_file=True)
    scene.draw_ahead(mechanisms)
    added = nodes.added
    for mechanism in mechanisms:
        scene.draw_ahead([mechanism])
        assert crank_lengths(nodes) == pytest.approx([mechanism.parameters["crank"]])
    assert nodes.added == added


def test_traces_and_paths_of_the_page_are_in_the_file(session):
    model = session.bench.simulation.model
    _, page = new_scene(model)
    page.traces.choose("crank.tip")
    page.shown.contacts = False
    page.draw_path(np.eye(3))
    _, scene = new_scene(model, in_file=True)
    scene.look_like(page)
    assert (scene.traces.chosen, scene.shown) == ("crank.tip", page.shown)
    assert np.array_equal(scene._path.points, page._path.points)
    assert scene._path.points.shape == (2, 2, 3)


def test_an_animation_follows_the_lengths(session):
    model, points = session.bench.simulation.model, session.history.points()[:2]
    samples = [(float(number), model.poses(time, p.state, p.inputs)) for number, (time, p) in enumerate(points)]
    poses = [one for _, one in samples]
    kept = list(Animation(model, 200, 150, poses).frames(samples, 1.0))
    followed = list(Animation(model, 200, 150, poses).frames(samples, 1.0, mechanisms_at(model, points)))
    assert np.array_equal(kept[0], followed[0])
    assert not np.array_equal(kept[1], followed[1])
