"""The gallery contains every shipped mechanism and is up to date."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from mbd_sim.base.errors import MbdSimError
from mbd_sim.files.text.library import shipped
from mbd_sim.pictures.drawing import gallery
from mbd_sim.pictures.drawing.gallery import LARGEST

DOCS = Path(__file__).resolve().parents[3] / "docs"


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
    assert max(sizes.values()) <= LARGEST and sum(sizes.values()) < 4e6


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
