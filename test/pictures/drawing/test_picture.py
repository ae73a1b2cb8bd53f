"""Drawings as files: formats, errors, and reproducible bytes."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from mbd_sim.cli.main import main
from mbd_sim.pictures.drawing import DrawingError, draw
from mbd_sim.pictures.drawing.picture import compose
from test.pictures.start import AtStart


@pytest.fixture(scope="module")
def pendulum():
    return AtStart.from_file("cart_pendulum_spring")


def test_a_png_is_readable_at_800_pixels_and_not_empty(pendulum, tmp_path):
    from matplotlib.image import imread

    draw(pendulum.mechanism, pendulum.poses(), tmp_path / "a.png", title="Cart and pendulum")
    pixels = imread(tmp_path / "a.png")[:, :, :3]
    height, width, _ = pixels.shape
    assert width >= 800 and height > 300
    assert 0.02 < np.mean(np.any(pixels < 0.98, axis=2)) < 0.6
    assert np.all(pixels[[0, -1]] > 0.98) and np.all(pixels[:, [0, -1]] > 0.98)


def test_the_same_mechanism_gives_the_same_svg(pendulum, tmp_path):
    for name in ("a.svg", "b.SVG"):
        draw(pendulum.mechanism, pendulum.poses(), tmp_path / name)
    first = (tmp_path / "a.svg").read_bytes()
    assert first == (tmp_path / "b.SVG").read_bytes()
    assert b"<dc:date>" not in first
    assert ElementTree.fromstring(first).tag.endswith("svg")


def test_the_users_matplotlib_settings_have_no_effect(pendulum, tmp_path):
    import matplotlib as mpl

    draw(pendulum.mechanism, pendulum.poses(), tmp_path / "a.svg")
    own = {"svg.fonttype": "none", "savefig.bbox": "tight", "path.sketch": (1, 100, 2), "font.family": "serif"}
    with mpl.rc_context(own):
        draw(pendulum.mechanism, pendulum.poses(), tmp_path / "b.svg")
        assert mpl.rcParams["svg.fonttype"] == "none"
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.jpg", "the suffix is '.jpg'. Use a file name that ends in .png, .svg or .pdf."),
        ("a", "the suffix is missing. Use a file name that ends in .png, .svg or .pdf."),
        ("none/a.png", "No such file or directory. Choose a file in a folder that you may write to."),
    ],
)
def test_the_error_for_an_unwritable_file_contains_a_remedy(pendulum, tmp_path, name, words):
    with pytest.raises(DrawingError) as caught:
        draw(pendulum.mechanism, pendulum.poses(), tmp_path / name)
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_the_command_draws_in_addition_to_its_report(tmp_path, capsys):
    assert main(["check", "rod_pendulum", "--draw", str(tmp_path / "a.svg")]) == 0
    assert "Degrees of freedom" in capsys.readouterr().out
    assert (tmp_path / "a.svg").stat().st_size > 1000
    assert main(["check", "rod_pendulum", "--draw", str(tmp_path / "a.gif")]) == 1
    assert ".png, .svg or .pdf" in capsys.readouterr().err


def test_an_actuator_between_two_points_is_drawn_as_a_damper_between_them():
    text = "mechanism: a\nparts: {bob: {mass: 1, inertia: [1, 1, 1], shape: {type: sphere, radius: 0.1}, points: {top: [0, 0, 0.1]}}}\n"
    text += "joints: {rail: {type: prismatic, between: [ground, bob], axis: [1, 0, 0], position: 1}}\nSECTION\n"
    actuator = "actuators: {push: {type: effort, between: [ground, bob.top]}}"
    damper = "forces: {push: {type: damper, between: [ground, bob.top], coefficient: 1}}"
    paths = []
    for section in (actuator, damper, ""):
        simulation = AtStart.from_text(text.replace("SECTION", section))
        paths.append(len(compose(simulation.mechanism, simulation.poses()).sheet.paths))
    assert paths[0] == paths[1] != paths[2]
