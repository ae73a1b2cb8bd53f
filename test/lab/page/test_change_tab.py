"""Sliders: typed values, back to the file, and the lines for the file."""

import contextlib
import re

import numpy as np
import pytest

from mbd_sim import load_mechanism, parse_mechanism
from mbd_sim.lab.lab import Lab
from mbd_sim.lab.page import touched
from mbd_sim.lab.page.change_tab import NO_ACTUATORS, ChangeTab, driven_text, may_be_typed
from mbd_sim.lab.page.touched import Touched
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.lab.session.sliders import settings_of
from test.waiting import wait_until


@pytest.fixture
def change(opened):
    opened.tab("Change")
    yield opened
    for key, value in (("coupler", 1.4), ("crank", 0.5), ("density", 1.0)):
        opened.lab.page._preparer.ask(f"parameters.{key}", value)
    wait_until(lambda: opened.frame.values["parameters.coupler"] == 1.4, "the file's values")


def test_a_typed_length_changes_the_linkage_is_copied_and_goes_back(change):
    change.enter("coupler (m)", "1.3", lambda: change.frame.values["parameters.coupler"] == 1.3, "the length")
    simulation = change.lab.session.bench.simulation
    tip, crank = simulation.point("coupler.tip").position, simulation.point("crank.tip").position
    assert np.linalg.norm(tip - crank) == pytest.approx(1.3, abs=1e-9)
    change.page.get_by_text(re.compile("coupler: 1.3 m")).first.wait_for()
    change.press(
        "Copy as YAML", lambda: "coupler: 1.3 m" in change.page.evaluate("getSelection().toString()"), "the selection"
    )
    change.press("coupler: 1.4", lambda: change.frame.values["parameters.coupler"] == 1.4, "the file's value")


def test_a_typed_value_may_lie_outside_of_its_slider(change):
    (density,) = (one for one in change.lab.page._change._settings if one.key == "parameters.density")
    change.enter("density", "7.25", lambda: change.frame.values["parameters.density"] == 7.25, "the value")
    assert density.high < 7.25
    change.enter("crank (m)", "0.6", lambda: change.frame.values["parameters.crank"] == 0.6, "the length")
    change.press("all", lambda: change.frame.values["parameters.density"] == 1.0, "the file's density")
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
    with Lab(load_mechanism("rod_pendulum"), port=0, running=False) as lab:
        page = lab.page
        (group,) = (one for one in page._change._groups if "parameters.l" in one._sliders)
        slider = group._sliders["parameters.l"]
        wait_until(lambda: "parameters.l" in group._followed, "the slider to follow")
        slider.value = 1.3
        for _ in range(3):
            page._change.show(lab.session.frame)
        assert slider.value == 1.3
        (setting,) = (one for one in group._settings if one.key == "parameters.l")
        group.moved(setting)
        wait_until(lambda: lab.session.frame.values["parameters.l"] == 1.3, "the value")
        lab.session.ask("value", lambda session: session.change("parameters.l", 1.2))
        wait_until(lambda: slider.value == 1.2, "the slider to follow a change of another page")


class Control:
    """A slider, a text or a group of buttons of a page, which keeps what it is given."""

    def __init__(self, **given):
        self.precision = 0
        self.__dict__.update(given)

    def on_update(self, call):
        self.update = call

    on_click = on_update


class Gui:
    """Stands for viser's `gui`."""

    def __init__(self):
        self.sliders, self.texts = {}, []

    def add_folder(self, *_, **__):
        return contextlib.nullcontext()

    def add_slider(self, label, min, max, step, initial_value):
        self.sliders[label] = Control(min=min, max=max, step=step, value=initial_value)
        return self.sliders[label]

    def add_button_group(self, *_, **__):
        return Control()

    def add_markdown(self, text):
        self.texts.append(text)

    def add_html(self, text):
        return Control(content=text)


class Event:
    client = "a browser"


class Tab:
    """A tab without a browser; `type` gives a slider a number, with or without the call that viser makes later."""

    def __init__(self, name, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr("time.monotonic", lambda: self.now)
        self.session, self.gui = OwnSession(Bench.of(load_mechanism(name)), running=False), Gui()
        self.tab = ChangeTab(self.gui, self.session, None, settings_of(self.session.bench, 1.0), Touched())
        self.applied, apply = [], self.tab.apply
        self.tab.apply = lambda setting, shown: (self.applied.append(shown), apply(setting, shown))
        self.wait(0.0)

    def type(self, label, value, *, called=True):
        slider = self.gui.sliders[label]
        slider.value = value
        if called:
            slider.update(Event)

    def wait(self, seconds):
        self.now += seconds
        self.session.turn()
        self.tab.show(self.session.frame)


def test_a_typed_number_acts_when_it_is_complete(monkeypatch):
    """viser sends each keystroke: gains of 1 and 10 acted before that of 100."""
    tab = Tab("cart_servo", monkeypatch)
    for value in (1.0, 10.0, 100.0):
        tab.type("kp (N/m)", value)
        tab.wait(0.2)
    assert tab.applied == []
    tab.wait(0.2)
    tab.wait(0.2)
    assert tab.applied == [100.0]
    assert tab.session.frame.values["parameters.kp"] == 100.0


def test_a_slider_that_is_dragged_acts_at_once(monkeypatch):
    tab = Tab("cart_servo", monkeypatch)
    for value in (21.0, 35.5, 47.0):
        tab.type("kp (N/m)", value)
        tab.wait(0.02)
    assert tab.applied == [35.5, 47.0]


def test_a_number_whose_call_is_late_is_not_replaced_by_the_one_before(monkeypatch):
    """On a busy machine a typed 100 became the 10 on the way to it."""
    tab = Tab("cart_servo", monkeypatch)
    tab.type("kp (N/m)", 10.0)
    tab.wait(0.4)
    tab.wait(0.2)
    assert tab.session.frame.values["parameters.kp"] == 10.0
    tab.type("kp (N/m)", 100.0, called=False)
    tab.wait(touched.UNTOUCHED + 0.1)
    assert tab.gui.sliders["kp (N/m)"].value == 100.0
    tab.type("kp (N/m)", 100.0)
    tab.wait(0.4)
    tab.wait(0.2)
    assert tab.session.frame.values["parameters.kp"] == 100.0
    tab.session.change("parameters.kp", 50.0)
    tab.wait(touched.UNTOUCHED + 0.1)
    assert tab.gui.sliders["kp (N/m)"].value == 50.0  # it follows again


@pytest.mark.parametrize(
    ("last", "shown", "typed"),
    [
        (1.0, 10.0, True), (10.0, 100.0, True), (0.0, 0.05, True), (-1.0, -12.0, True), (12.0, 1.0, True),
        (1.0, 2.0, False), (35.5, 36.0, False), (-1.0, 1.0, False),
    ],
)  # fmt: skip
def test_digits_that_are_continued_may_be_typed(last, shown, typed):
    assert may_be_typed(last, shown) is typed


def test_a_mechanism_without_actuators_names_one_with_a_controller(monkeypatch):
    assert NO_ACTUATORS in Tab("cart_pendulum", monkeypatch).gui.texts
    assert NO_ACTUATORS not in Tab("cart_servo", monkeypatch).gui.texts
    assert "cart_servo" in NO_ACTUATORS
