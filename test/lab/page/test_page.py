"""The page in a real browser, without a network: taking hold, several pages, a saved file, a phone."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim.lab.session.bench import Bench
from test.waiting import wait_until

BrowserPage = pytest.importorskip("test.lab.page.browser_page").BrowserPage


def test_dragging_a_paused_mechanism_moves_it_with_loops_closed(opened):
    before = opened.frame.positions
    opened.drag("rocker", np.array([0.8, 0.0, 0.0]), 60, 10, lambda: abs(opened.frame.positions - before).max() > 0.05)
    opened.page.mouse.up()
    wait_until(lambda: opened.frame.pull is None, "the hand to let go")
    assert opened.lab.session.bench.simulation.violation.position < 1e-9
    assert opened.frame.time == 0.0


def test_pulling_exerts_a_force_until_the_hand_lets_go(opened):
    opened.lab.session.ask("speed", lambda session: session.set_speed(0.02))
    opened.press("Play", lambda: opened.frame.running, "the run")
    opened.drag("rocker", np.array([0.5, 0.0, 0.0]), 80, -20, lambda: opened.frame.pull is not None)
    opened.page.get_by_text(re.compile(r"pulled with .* N of at most")).first.wait_for()
    opened.page.mouse.up()
    wait_until(lambda: opened.frame.pull is None, "the hand to let go")
    assert opened.frame.energies[3] != 0.0
    assert abs(opened.frame.energies[6]) < 1e-6


def test_a_notice_leaves_the_scene_below_it_to_the_mouse(opened):
    """One of a download lay over a part that was to be dragged, and stayed while the mouse was over it."""
    others = opened.page.locator(".mantine-Notifications-notification button")
    others.evaluate_all("all => all.forEach(one => one.click())")  # several of them would reach beyond the window
    notice = opened.lab.page.server.get_clients()[opened.client].add_notification("Saved", "In a file.")
    shown = opened.page.locator(".mantine-Notifications-notification", has_text="Saved")
    at_its_middle = """one => {
        const {x, y, width, height} = one.getBoundingClientRect();
        return document.elementFromPoint(x + width / 2, y + height / 2)?.tagName;
    }"""
    wait_until(lambda: shown.evaluate(at_its_middle) == "CANVAS", "the scene below it")
    shown.get_by_role("button").click()
    shown.wait_for(state="detached")
    notice.remove()


def test_the_page_follows_the_file_and_shows_its_mistakes(opened):
    file, generation = opened.lab._watch._path, opened.frame.generation
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("density*coupler", "density*kupler"), encoding="utf-8")
    opened.page.get_by_text(re.compile("kupler")).first.wait_for()
    assert opened.frame.generation == generation
    file.write_text(text.replace("density: 1 ", "density: 3 "), encoding="utf-8")
    wait_until(lambda: opened.frame.generation == generation + 1, "the new mechanism")
    opened.page.get_by_text("kupler").first.wait_for(state="detached")
    assert isinstance(opened.lab.session.bench, Bench)
    file.write_text(text, encoding="utf-8")
    wait_until(lambda: opened.frame.generation == generation + 2, "the file of before")


def test_a_phone_sees_the_same_with_the_mechanism_above_the_panel(opened, chromium):
    phone = BrowserPage(chromium, opened.lab, {"width": 390, "height": 844})
    wait_until(phone.has_tabs_in_one_line, "the tabs in one line")
    wait_until(lambda: phone.page.evaluate("document.documentElement.scrollWidth") <= 390, "the width of the screen")
    panel = phone.page.get_by_role("button", name="Play").locator("xpath=ancestor::*[contains(@style, 'fixed')]").first
    extent, box = opened.lab.page._extent, {}

    def is_wide():
        box.update(panel.bounding_box() or {"width": 0.0})  # none while the page is drawing it
        return box["width"] == 390.0 and box["x"] == 0.0

    def is_above():
        is_wide()
        pixels = map(phone.pixel, (extent.lower, extent.upper))
        return all(0.0 < x < 390.0 and 0.0 < y < box["y"] for x, y in pixels)

    wait_until(is_wide, "the panel")
    wait_until(lambda: abs(phone.camera().fov - np.radians(30.0)) < 1e-6, "the camera")
    wait_until(is_above, "the mechanism above the panel")
    phone.enter("rocker (m)", "1.25", lambda: opened.frame.values["parameters.rocker"] == 1.25, "the length")
    opened.tab("Change")
    opened.page.locator("input[value='1.25']").first.wait_for(state="attached")
    phone.press("rocker: 1.2", lambda: opened.frame.values["parameters.rocker"] == 1.2, "the file's length")
    phone.close()


def test_a_first_view_that_a_slow_browser_applies_late_is_corrected(opened):
    """viser sends a view to all pages, and a phone's page would then show a part of the mechanism; a user's view stays."""
    page, updates = opened.lab.page, []
    first = np.array(page.server.initial_camera.position)
    camera = SimpleNamespace(
        image_width=390, image_height=844, aspect=390 / 844, position=first, on_update=updates.append
    )
    page._opened(SimpleNamespace(camera=camera, client_id=-1))
    (update,) = updates
    update(None)
    aimed = camera.position
    assert not np.allclose(aimed, first)
    camera.position = first
    update(None)
    assert camera.position == aimed
    camera.position = (9.0, 9.0, 9.0)
    update(None)
    assert camera.position == (9.0, 9.0, 9.0)
    page._closed(SimpleNamespace(client_id=-1))


def test_the_status_has_two_lines_whatever_happens(opened):
    """With one line while it is paused and two in a run, the tabs below would jump."""
    frame = opened.frame
    pull = frame.poses[0, :3], frame.poses[0, :3], np.array([12.0, 0.0, 0.0]), 30.0
    for shown in (frame, replace(frame, running=True, rate=0.998), replace(frame, running=True, pull=pull)):
        assert len(opened.lab.page._status(shown).splitlines()) == 2


def test_no_other_address_was_asked_for(opened):
    assert all(url.startswith((opened.lab.url, "blob:", "data:")) for url in opened.requests)
