"""The tutorials run as notebooks do, and what they assert holds."""

import re
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from test.docs.notebooks import cells, execute, undrawn

LEARN = Path(__file__).resolve().parents[2] / "docs" / "learn"
NOTEBOOKS = sorted(path for path in LEARN.glob("*.md") if path.name != "index.md")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_tutorial_runs(path, tmp_path, monkeypatch):
    text = path.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    with plt.rc_context(), undrawn():
        for cell in cells(text):
            execute(cell, names)
        plt.close("all")
    assert len(cells(text)) > 1
    assert re.search(r"^    assert |^assert ", text, re.MULTILINE), "a tutorial asserts its result"


def test_every_tutorial_is_listed():
    listed = re.findall(r"^(\w+)$", (LEARN / "index.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == [path.stem for path in NOTEBOOKS]
