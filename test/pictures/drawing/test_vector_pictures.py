"""Pictures in SVG and PDF: lines and texts, no bitmaps; and symbols that hold together and are not cut off."""

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism, parse_mechanism
from mbd_sim.cli.main import main
from mbd_sim.pictures.drawing import draw
from mbd_sim.pictures.drawing.animation import Animation
from mbd_sim.pictures.drawing.joints import slider_paths
from mbd_sim.pictures.drawing.sheet import ScaledView, view_of
from mbd_sim.pictures.drawing.symbols import place_joint
from test.pictures.start import AtStart

POLAR = """
mechanism: polar_arm
parts:
  arm: {{mass: 2, inertia: [0.1, 0.1, 0.1]}}
  hand: {{mass: 1, inertia: [0.01, 0.01, 0.01], center: {center}}}
joints:
  pivot: {{type: revolute, between: [ground, arm], axis: [0, -1, 0], position: 30 deg}}
  slide: {{type: prismatic, between: [arm, hand], axis: [1, 0, 0], position: {position}}}
"""


def test_a_motion_is_drawn_without_a_bitmap(tmp_path):
    path = tmp_path / "k.svg"
    command = ["kinematics", "four_bar", "--drive", "crank_pivot=0:90deg:5", "--show", "mechanism", "--plot", str(path)]
    assert main(command) == 0
    assert b"<image" not in path.read_bytes()


def test_texts_of_a_drawing_are_texts(tmp_path):
    mechanism = load_mechanism("four_bar")
    svg, pdf = tmp_path / "a.svg", tmp_path / "a.pdf"
    for path in (svg, pdf):
        draw(mechanism, AtStart(mechanism).poses(), path)
    text = svg.read_text(encoding="utf-8")
    assert all(f">{name}</text>" in text for name in ("crank", "coupler", "rocker"))
    assert b"/FontFile2" in pdf.read_bytes()
    assert b"/CreationDate" not in pdf.read_bytes()  # the same drawing has the same bytes


@pytest.mark.parametrize("position", [0.8, -0.5, 0.01])
def test_the_guide_of_a_slider_begins_on_a_part_without_shapes(position):
    """It floated between the arm, of which only the pivot is drawn, and the hand."""
    simulation = AtStart(parse_mechanism(POLAR.format(position=position, center=[0.1, 0, -0.3])))
    poses = simulation.poses()
    page = ScaledView(view_of(simulation.mechanism, poses), 100.0)
    placed = place_joint(page, simulation.mechanism, poses, simulation.mechanism.joints["slide"])
    points = np.vstack([path.points for path in slider_paths(page, placed, abs(position))])
    hand = poses["hand"]
    for end in (poses["arm"].position, hand.position + hand.rotation @ [0.1, 0, -0.3]):
        assert np.min(np.linalg.norm(points - page.project(end), axis=1)) < 1e-9


@pytest.mark.parametrize("size", [(600, 400), (80, 300)])
def test_nothing_of_an_animation_is_cut_off(size):
    """Hatched supports reach beyond the parts, and lay outside of the window."""
    simulation = Simulation.from_file("slider_crank")
    poses = [simulation.poses()]
    for _ in range(8):
        simulation.run(until=simulation.time + 0.1)
        poses.append(simulation.poses())
    animation = Animation(simulation.model, *size, poses)
    for one in poses:
        low, high = animation._sheet(one).translated(animation._shift).bounds()
        assert np.all(low >= -3.0) and np.all(high <= np.array(size) + 3.0)
