"""The check of the built site finds what is wrong with a page."""

import re
import runpy
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[2] / "docs"))

from check_site import main

import mbd_sim

HEAD = '<html><head><meta name="viewport" content="x"><title>t</title></head><body><h1 id="top">T</h1>'


def found(folder, capsys, **pages):
    for name, body in pages.items():
        (folder / f"{name}.html").write_text(f"{HEAD}{body}</body></html>", encoding="utf-8")
    main(folder)
    return capsys.readouterr().out.splitlines()[1:]


def test_a_sound_site_has_no_problems(tmp_path, capsys):
    assert found(tmp_path, capsys, index='<p>a<p>b<br><a href="other.html#top">o</a>', other="") == []


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ('<a href="none.html">x</a>', "index.html: a leads nowhere: none.html"),
        ('<a href="#none">x</a>', "index.html: a leads nowhere: #none"),
        ('<img src="none.png" alt="x">', "index.html: img leads nowhere: none.png"),
        ('<img src="data:," alt="">', "index.html: a picture without a text: data:,"),
        (
            '<script src="https://x.example/y.js"></script>',
            "index.html: loaded from the network: https://x.example/y.js",
        ),
        ('<span class="problematic">x</span>', "index.html: a message of Sphinx (problematic)"),
        ("<pre>/bin/sh: 1: mbd_sim: not found\n</pre>", "index.html: a command of a notebook: mbd_sim: not found"),
        ("<h1>again</h1>", "index.html: 2 headings of the first level"),
        ("<div><span></div>", "index.html: </div> at 1 closes ['span']"),
    ],
)
def test_a_broken_page_is_reported(tmp_path, capsys, body, problem):
    assert found(tmp_path, capsys, index=body)[0] == problem


def test_the_reference_of_the_python_interface_lists_every_public_name():
    path = Path(__file__).resolve().parents[2] / "docs" / "site_pages" / "python_interface.py"
    pages = runpy.run_path(str(path))["pages"]()  # without its package, which needs Sphinx
    listed = set(re.findall(r"^## (\w+)$", "".join(pages.values()), re.MULTILINE))
    assert set(mbd_sim.__all__) - {"__version__"} <= listed


def test_a_page_that_no_other_leads_to_is_reported(tmp_path, capsys):
    assert found(tmp_path, capsys, index="", lost="") == ["lost.html: no page leads here"]
