"""Animations of the gallery: small, at a pace that can be followed, and repeated where the motion is."""

import numpy as np
import pytest
from PIL import Image

from mbd_sim.base.errors import MbdSimError
from mbd_sim.pictures.drawing import gallery
from mbd_sim.pictures.drawing.gallery import animate, cropped, description, repetition


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(gallery, "FRAMES", 8)
    monkeypatch.setattr(gallery, "SIZE", (120, 90))


def test_an_animation_is_small_and_says_how_fast_it_is(short, tmp_path, monkeypatch):
    path = animate("rod_pendulum", tmp_path)
    with Image.open(path) as picture:
        assert picture.n_frames > 4 and max(picture.size) <= 120
    assert "real time" in description(path)
    content = path.read_bytes()
    assert animate("rod_pendulum", tmp_path).read_bytes() == content  # the same file each time
    monkeypatch.setattr(gallery, "LARGEST", 1000)
    with pytest.raises(MbdSimError, match=r"rod_pendulum has \d+ bytes, more than 1000"):
        animate("rod_pendulum", tmp_path)


def test_a_mechanism_at_rest_has_no_animation(short, tmp_path):
    assert animate("cart_pendulum", tmp_path) is None
    assert not list(tmp_path.iterdir())


def test_a_periodic_motion_is_shown_once():
    angles = 2.0 * np.pi * np.arange(36)[:, None] / 20
    circle = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=2)
    assert repetition(circle) == 20
    assert repetition(circle[:18]) == 18  # less than one revolution
    swing = np.stack([np.cos(angles), 0.0 * angles, 0.0 * angles], axis=2)
    assert repetition(swing) == 20  # not where it passes the same place in the other direction


def test_margins_are_cut_off_where_nothing_is_ever_drawn():
    frames = [np.full((40, 60, 3), 255, np.uint8) for _ in range(2)]
    frames[0][20, 15], frames[1][25, 30] = 0, 0
    assert [frame.shape for frame in cropped(frames)] == [(18, 28, 3)] * 2
