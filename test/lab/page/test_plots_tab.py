"""The plots are drawn, one for each unit, with a chosen reading."""

import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.lab import Lab
from mbd_sim.lab.page.plots_tab import readings_of
from mbd_sim.lab.session.bench import Bench
from test.waiting import wait_until

DRAWN = "[...document.querySelectorAll('.uplot canvas')].filter(e => e.checkVisibility() && e.width > 100).length"


def test_the_plots_are_drawn(opened):
    opened.tab("Plots")
    opened.press("Play", lambda: opened.frame.time > 0.3, "the run")
    opened.press("Pause", lambda: not opened.frame.running, "the pause")
    opened.page.get_by_text("Phase portrait").first.wait_for()
    wait_until(lambda: opened.page.evaluate(DRAWN) == 5, "the plots")


def test_a_reading_is_chosen(opened):
    opened.tab("Plots")
    opened.select(
        "Reading", "force through crank_pin (N)", lambda: opened.lab.session.reading is not None, "the choice"
    )
    opened.press("Step", lambda: len(opened.lab.session.samples.rows), "the sample", first=60.0)
    simulation = opened.lab.session.bench.simulation
    force = simulation.reactions()["crank_pin"].force
    assert abs(opened.lab.session.samples.rows[-1][-1] - (force @ force) ** 0.5) < 1e-12


def test_meters_and_degrees_are_drawn_apart_and_the_reading_has_its_name():
    """On one axis, the way of a cart was a flat line below the angle of its pendulum."""
    with Lab(load_mechanism("cart_servo"), port=0, running=True) as lab:
        plots = lab.page._plots
        titles = [plot.title for plot in (*plots._motion.values(), *plots._rates.values())]
        assert titles == ["Coordinates (m)", "Coordinates (deg)", "Speeds (m/s)", "Speeds (deg/s)"]
        assert plots._phase.title == "Phase portrait: rail (m, m/s)"
        wait_until(lambda: len(plots._motion["deg"].data[0]) > 3, "the samples")
        lab.session.pause()
        angle = plots._motion["deg"]
        assert [one["label"] for one in angle.series] == ["t (s)", "pin"]
        assert len(angle.data) == 2
        assert max(angle.data[1]) == pytest.approx(30.0, abs=2.0)
        plots.choose("effort of motor (N)")
        assert plots._reading.title == "effort of motor (N)"
        assert plots._reading.series[1]["label"] == "effort of motor (N)"
        plots.choose("none")
        assert plots._reading.title == "Reading: none chosen"


def test_every_reading_has_a_unit():
    for name in ("motor_drive", "balancing_pendulum", "cart_servo", "bounce"):
        for reading in readings_of(Bench.of(load_mechanism(name))):
            assert reading.endswith(")"), (name, reading)
    assert "velocity of drive (rad/s)" in readings_of(Bench.of(load_mechanism("motor_drive")))
