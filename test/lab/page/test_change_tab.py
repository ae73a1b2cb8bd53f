"""Sliders of the page and the values of the session."""

import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.lab import Lab
from test.waiting import wait_until

pytest.importorskip("viser")


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
