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
        show.check(view.label)
        wait_until(lambda key=view.key: key in show.frame.watched, view.label)
    wait_until(lambda: len(scene._views["reactions"]._arrows.points) == 4, "the forces")
    for view in VIEWS:
        show.check(view.label)
        wait_until(lambda key=view.key: key not in show.frame.watched, view.label)


def test_traces_of_a_chosen_point_are_cleared(show):
    traces = show.lab.page._scene.traces
    show.choose("Trace of", "coupler.tip")
    wait_until(lambda: traces.chosen == "coupler.tip", "the choice")
    show.button("Play")
    wait_until(lambda: len(traces._paths["coupler"]) > 10, "the path")
    show.button("Pause")
    wait_until(lambda: not show.frame.running, "the pause")
    show.button("Clear the traces")
    wait_until(lambda: len(traces._paths["coupler"]) < 3, "the cleared path")
    show.check("Traces")
    wait_until(lambda: not show.lab.page._scene.shown.traces, "no traces")
    show.check("Traces")
    wait_until(lambda: show.lab.page._scene.shown.traces, "the traces")
    show.check("Contact forces")
    wait_until(lambda: not show.lab.page._scene.shown.contacts, "no contact forces")
    show.check("Contact forces")
    wait_until(lambda: show.lab.page._scene.shown.contacts, "the contact forces")
    show.choose("Trace of", "tips")
    wait_until(lambda: traces.chosen == "tips", "the tips")


def test_large_text_is_larger(show):
    size = "getComputedStyle(document.documentElement).fontSize"
    before = show.page.evaluate(size)
    show.check("Large text")
    wait_until(lambda: show.page.evaluate(size) != before, "the larger text")
    assert (before, show.page.evaluate(size)) == ("16px", "20px")
    wait_until(show.has_tabs_in_one_line, "the tabs in one line")
    show.check("Large text")
    wait_until(lambda: show.page.evaluate(size) == before, "the text of before")


def test_dark_and_light(show):
    theme = "document.documentElement.dataset.mantineColorScheme"
    for expected in ("dark", "light"):
        show.tab("Show")
        show.check("Dark")
        wait_until(lambda theme=theme, expected=expected: show.page.evaluate(theme) == expected, expected)
