"""A point is brought to a target on the page: with the mouse in the scene, and by numbers."""

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.analysis.mechanics.inverse_kinematics import InverseKinematics
from mbd_sim.lab.page.reach_panel import HELD, NONE, found_text
from test.waiting import wait_until


def test_what_is_left_is_told_in_the_units_of_people():
    mechanism = load_mechanism("cart_pendulum")
    values = {"rail": 0.12345678, "pin": np.pi / 6.0}
    found = InverseKinematics(np.zeros(2), values, False, 0.25, 0.1, ("rail",))
    text = found_text(mechanism, found, searching=True, turns=True)
    head, *rows = text.splitlines()
    assert (
        head
        == "**Not reached:** 0.25 m and 5.73 deg from the target. rail at the limit. Looking from other positions …"
    )
    assert rows[-2:] == ["| rail | 0.12346 m |", "| pin | 30.00 deg |"]


def test_what_is_refused_or_commanded_is_not_told_as_reached():
    mechanism = load_mechanism("cart_pendulum")
    found = InverseKinematics(np.zeros(2), {"rail": 0.1, "pin": 0.2}, True, 0.0, 0.0)
    heads = [
        found_text(mechanism, found, False, refused, commanded=commanded, turns=False).splitlines()[0]
        for refused, commanded in (("", False), ("It would be inside.", False), ("", True))
    ]
    assert heads == [
        "**Reached**, with these joints:",
        "**Not put there:** It would be inside. The joints would be:",
        "**Commanded**, these joints reach it:",
    ]


@pytest.fixture
def reaching(opened):
    opened.tab("Kinematics")
    panel = opened.lab.page._reach
    panel._pose = panel._held = None  # those of tests before
    yield opened, panel
    opened.select("Point", NONE, lambda: panel._point.value == NONE, "no point")


def test_a_point_follows_its_target_and_what_is_left_is_told(reaching):
    opened, panel = reaching
    opened.select("Point", "coupler.P", lambda: panel._pose is not None, "the target")
    start = panel._pose.position
    tip = start + 0.15 * opened.lab.page._extent.size * np.array([0.0, 0.0, 1.0])  # on the arrow along z

    def drag():
        mouse, (x, y) = opened.page.mouse, opened.pixel(tip)
        mouse.move(x, y)
        opened.pause(0.3)
        mouse.down()
        for pixels in range(1, 7):
            mouse.move(x, y - 4 * pixels)
            opened.pause(0.08)
        mouse.up()

    before = opened.frame.q
    opened.act(drag, lambda: panel._pose.position[2] > start[2] + 1e-3, "the target to be dragged")
    wait_until(lambda: np.abs(opened.frame.q - before).max() > 1e-3, "the mechanism to follow")
    opened.enter("x, y, z (m)", "2.5", lambda: panel._pose.position[2] == 2.5, "the height of the target")
    opened.press("Put it there", lambda: panel._reacher.searching, "the search", first=60.0)
    opened.page.get_by_text("Not reached:").first.wait_for()
    opened.page.get_by_role("cell", name="crank_pivot").wait_for()
    assert opened.lab.session.bench.simulation.violation.position < 1e-9


def test_the_point_that_was_held_last_gets_a_target(reaching):
    opened, panel = reaching
    opened.select("Point", HELD, lambda: panel._point.value == HELD, "the choice")
    moved = opened.frame.positions
    opened.drag("rocker", np.array([0.6, 0.0, 0.0]), 40, 10, lambda: abs(opened.frame.positions - moved).max() > 0.02)
    opened.page.mouse.up()
    wait_until(lambda: panel._chosen() is not None, "the held point")
    part, point = panel._chosen()
    assert part == "rocker" and point[0] == pytest.approx(0.6, abs=0.1)
