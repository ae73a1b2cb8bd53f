"""The plots are drawn, with a chosen reading."""

from test.waiting import wait_until

DRAWN = "[...document.querySelectorAll('.uplot canvas')].filter(e => e.checkVisibility() && e.width > 100).length"


def test_the_plots_are_drawn(opened):
    opened.tab("Plots")
    opened.button("Play")
    wait_until(lambda: opened.frame.time > 0.3, "the run")
    opened.button("Pause")
    opened.page.get_by_text("Phase portrait").first.wait_for()
    wait_until(lambda: opened.page.evaluate(DRAWN) == 5, "the plots")


def test_a_reading_is_chosen(opened):
    opened.tab("Plots")
    opened.choose("Reading", "force through crank_pin (N)")
    wait_until(lambda: opened.lab.session.reading is not None, "the choice")
    opened.button("Step")
    wait_until(lambda: len(opened.lab.session.samples.rows), "the sample")
    simulation = opened.lab.session.bench.simulation
    force = simulation.reactions()["crank_pin"].force
    assert abs(opened.lab.session.samples.rows[-1][-1] - (force @ force) ** 0.5) < 1e-12
