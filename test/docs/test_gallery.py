"""The gallery contains every shipped mechanism and is up to date; its animations are small and can be followed."""

import sys
import xml.etree.ElementTree as ElementTree
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mbd_sim.base.errors import MbdSimError
from mbd_sim.files.text.library import shipped

DOCS = Path(__file__).resolve().parents[2] / "docs"
sys.path.append(str(DOCS))
gallery = import_module("gallery_pictures")


def test_every_shipped_mechanism_says_what_it_is_and_what_to_watch():
    assert {entry.name for entry in gallery.entries()} == set(shipped())


def test_the_page_is_up_to_date():
    written = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert written == gallery.page(gallery.entries()), "docs/gallery.md is out of date: run `make gallery`"


def test_every_mechanism_has_a_readable_picture():
    missing = [name for name in shipped() if not (DOCS / "gallery" / f"{name}.svg").is_file()]
    assert not missing, f"there are no pictures of {', '.join(missing)}: run `make gallery`"
    stale = {path.stem for path in (DOCS / "gallery").iterdir()} - set(shipped())
    assert not stale, f"pictures of mechanisms that are not shipped: {', '.join(sorted(stale))}: run `make gallery`"
    for name in shipped():
        assert ElementTree.parse(DOCS / "gallery" / f"{name}.svg").getroot().tag.endswith("svg")


def test_animations_are_small():
    sizes = {path.name: path.stat().st_size for path in (DOCS / "gallery").glob("*.webp")}
    assert len(sizes) > 60
    assert max(sizes.values()) <= gallery.LARGEST and sum(sizes.values()) < 4e6


def test_a_picture_can_be_generated(tmp_path):
    (entry,) = [entry for entry in gallery.entries() if entry.name == "double_rod"]
    assert ElementTree.parse(gallery.picture(entry, tmp_path)).getroot().tag.endswith("svg")


def test_the_error_names_a_file_without_its_texts_and_the_remedy(tmp_path, monkeypatch):
    (tmp_path / "open_chains").mkdir()
    file = tmp_path / "open_chains" / "new.yaml"
    file.write_text(
        "# A rod.\nmechanism: rod_pendulum\n" + shipped()["rod_pendulum"].read_text(encoding="utf-8").split("\n", 3)[3]
    )
    monkeypatch.setattr(gallery, "shipped", lambda: {"new": file})
    with pytest.raises(MbdSimError, match=r"config/open_chains/new\.yaml.*'# Watch:'.*make gallery"):
        gallery.entries()


def test_the_comment_is_split_where_it_says_watch():
    text = "# yaml-language-server: $schema=x\n# A rod\n# on a pin (Book 3).\n# Watch: it\n# swings.\nmechanism: x\n# not this\n"
    assert gallery.comment(text) == ("A rod on a pin (Book 3).", "it swings.")
    assert gallery.comment("mechanism: x\n") == ("", "")


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(gallery, "FRAMES", 8)
    monkeypatch.setattr(gallery, "SIZE", (120, 90))


def test_an_animation_is_small_and_says_how_fast_it_is(short, tmp_path, monkeypatch):
    path = gallery.animate("rod_pendulum", tmp_path)
    with Image.open(path) as picture:
        assert picture.n_frames > 4 and max(picture.size) <= 120
    assert "real time" in gallery.description(path)
    content = path.read_bytes()
    assert gallery.animate("rod_pendulum", tmp_path).read_bytes() == content  # the same file each time
    monkeypatch.setattr(gallery, "LARGEST", 1000)
    with pytest.raises(MbdSimError, match=r"rod_pendulum has \d+ bytes, more than 1000"):
        gallery.animate("rod_pendulum", tmp_path)


def test_a_mechanism_at_rest_has_no_animation(short, tmp_path):
    assert gallery.animate("cart_pendulum", tmp_path) is None
    assert not list(tmp_path.iterdir())


def test_a_periodic_motion_is_shown_once():
    angles = 2.0 * np.pi * np.arange(36)[:, None] / 20
    circle = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=2)
    assert gallery.repetition(circle) == 20
    assert gallery.repetition(circle[:18]) == 18  # less than one revolution
    swing = np.stack([np.cos(angles), 0.0 * angles, 0.0 * angles], axis=2)
    assert gallery.repetition(swing) == 20  # not where it passes the same place in the other direction


def test_margins_are_cut_off_where_nothing_is_ever_drawn():
    frames = [np.full((40, 60, 3), 255, np.uint8) for _ in range(2)]
    frames[0][20, 15], frames[1][25, 30] = 0, 0
    assert [frame.shape for frame in gallery.cropped(frames)] == [(18, 28, 3)] * 2
