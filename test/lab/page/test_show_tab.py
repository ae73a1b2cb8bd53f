"""What the scene shows, the theme and the size of the text."""

import pytest

from mbd_sim.lab.scene.vectors import VIEWS
from test.waiting import wait_until


@pytest.fixture
def show(opened):
    opened.tab("Show")
    return opened


def test_arrows_are_shown_on_request(show):
    scene = show.lab.page._scene
    for view in VIEWS:
        show.check(view.label, True, lambda key=view.key: key in show.frame.watched, view.label)
    wait_until(lambda: len(scene._views["reactions"]._arrows.points) == 4, "the forces")
    for view in VIEWS:
        show.check(view.label, False, lambda key=view.key: key not in show.frame.watched, view.label)


def test_traces_of_a_chosen_point_are_cleared(show):
    traces, shown = show.lab.page._scene.traces, show.lab.page._scene.shown
    show.select("Trace of", "coupler.tip", lambda: traces.chosen == "coupler.tip", "the choice")
    show.press("Play", lambda: len(traces._paths["coupler"]) > 10, "the path")
    show.press("Pause", lambda: not show.frame.running, "the pause")
    show.press("Clear the traces", lambda: len(traces._paths["coupler"]) < 3, "the cleared path")
    for on in (False, True):
        show.check("Traces", on, lambda on=on: shown.traces == on, "the traces")
        show.check("Contact forces", on, lambda on=on: shown.contacts == on, "the contact forces")
    show.select("Trace of", "tips", lambda: traces.chosen == "tips", "the tips")


def test_large_text_is_larger(show):
    size = "getComputedStyle(document.documentElement).fontSize"
    before = show.page.evaluate(size)
    show.check("Large text", True, lambda: show.page.evaluate(size) != before, "the larger text")
    assert (before, show.page.evaluate(size)) == ("16px", "20px")
    wait_until(show.has_tabs_in_one_line, "the tabs in one line")
    show.check("Large text", False, lambda: show.page.evaluate(size) == before, "the text of before")


def test_dark_and_light(show):
    theme = "document.documentElement.dataset.mantineColorScheme"
    for expected in ("dark", "light"):
        show.tab("Show")
        show.check("Dark", expected == "dark", lambda one=expected: show.page.evaluate(theme) == one, expected)
