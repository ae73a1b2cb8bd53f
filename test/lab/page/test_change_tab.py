"""Sliders: typed values, back to the file, and the lines for the file."""

import re

import numpy as np
import pytest

from mbd_sim import load_mechanism, parse_mechanism
from mbd_sim.lab.lab import Lab
from mbd_sim.lab.page.change_tab import driven_text
from test.waiting import wait_until


@pytest.fixture
def change(opened):
    opened.tab("Change")
    yield opened
    for key, value in (("coupler", 1.4), ("crank", 0.5), ("density", 1.0)):
        opened.lab.page._preparer.ask(f"parameters.{key}", value)
    wait_until(lambda: opened.frame.values["parameters.coupler"] == 1.4, "the file's values")


def test_a_typed_length_changes_the_linkage_and_goes_back(change):
    change.enter("coupler (m)", "1.3", lambda: change.frame.values["parameters.coupler"] == 1.3, "the length")
    simulation = change.lab.session.bench.simulation
    tip, crank = simulation.point("coupler.tip").position, simulation.point("crank.tip").position
    assert np.linalg.norm(tip - crank) == pytest.approx(1.3, abs=1e-9)
    change.button("coupler: 1.4")
    wait_until(lambda: change.frame.values["parameters.coupler"] == 1.4, "the file's value")


def test_the_lines_for_the_file_are_copied(change):
    change.enter("coupler (m)", "1.3", lambda: change.frame.values["parameters.coupler"] == 1.3, "the length")
    change.page.get_by_text(re.compile("coupler: 1.3 m")).first.wait_for()
    change.button("Copy as YAML")
    assert "coupler: 1.3 m" in change.page.evaluate("getSelection().toString()")


def test_a_typed_value_may_lie_outside_of_its_slider(change):
    (density,) = (one for one in change.lab.page._change._settings if one.key == "parameters.density")
    change.enter("density", "7.25", lambda: change.frame.values["parameters.density"] == 7.25, "the value")
    assert density.high < 7.25
    change.enter("crank (m)", "0.6", lambda: change.frame.values["parameters.crank"] == 0.6, "the length")
    change.button("all")
    wait_until(lambda: change.frame.values["parameters.density"] == 1.0, "the file's density")
    wait_until(lambda: change.frame.values["parameters.crank"] == 0.5, "the file's length")


def test_a_value_that_is_impossible_is_refused_with_the_reason(change):
    change.enter("coupler (m)", "9", lambda: change.frame.message, "the refusal")
    assert "parameters.coupler" in change.frame.message
    assert change.frame.values["parameters.coupler"] == 1.4
    change.page.get_by_text(re.compile("parameters.coupler")).first.wait_for()


def test_a_position_and_a_speed_are_set_with_loops_closed(change):
    change.folder("Positions")
    change.enter(
        "crank_pivot (deg)", "120", lambda: abs(change.frame.positions[0] - np.radians(120.0)) < 1e-9, "the position"
    )
    change.folder("Positions")
    change.folder("Speeds")
    change.enter(
        "crank_pivot (deg/s)", "-90", lambda: abs(change.frame.speeds[0] + np.radians(90.0)) < 1e-9, "the speed"
    )
    violation = change.lab.session.bench.simulation.violation
    assert violation.position < 1e-9
    assert violation.velocity < 1e-9


def test_drives_of_the_file_are_told():
    text = driven_text(
        parse_mechanism(
            """
mechanism: shaker
parameters: {a: 20 mm}
parts: {table: {shape: {type: block, size: [1, 1, 1], mass: 1}}}
joints: {shake: {type: prismatic, between: [ground, table], axis: [1, 0, 0], drive: a*sin(3*t)}}
"""
        )
    )
    assert "shake = a*sin(3*t)" in text


def test_a_value_is_not_overwritten_before_the_page_has_asked_for_it():
    """viser gives the new value to the slider, and calls the page a while later, on a busy machine a long while."""
    with Lab(load_mechanism("four_bar"), port=0, running=False) as lab:
        page = lab.page
        (group,) = (one for one in page._change._groups if "parameters.coupler" in one._sliders)
        slider = group._sliders["parameters.coupler"]
        wait_until(lambda: "parameters.coupler" in group._followed, "the slider to follow")
        slider.value = 1.3
        for _ in range(3):
            page._change.show(lab.session.frame)
        assert slider.value == 1.3
        lab.session.ask("value", lambda session: session.change("parameters.coupler", 1.2))
        wait_until(lambda: slider.value == 1.2, "the slider to follow a change of another page")
