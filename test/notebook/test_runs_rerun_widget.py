"""Rerun in a notebook: the widget receives the run."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.packages import MissingPackageError


def test_the_widget_shows_the_run_from_here_to_then():
    pytest.importorskip("rerun_notebook")
    sim, plain = Simulation.from_file("rod_pendulum"), Simulation.from_file("rod_pendulum")
    sim.run(until=0.1)
    widget = sim.view(until=0.15)
    plain.run(until=0.1)
    plain.run(until=0.15)
    np.testing.assert_allclose(sim.state, plain.state, atol=1e-12)
    assert sim.time == plain.time
    ((content, (recording,)),) = widget._event_queue  # it is sent when the viewer has been loaded
    assert content["type"] == "rrd" and bytes(recording[:3]) == b"RRF"


def test_the_missing_package_is_named(monkeypatch):
    sim = Simulation.from_file("rod_pendulum")
    monkeypatch.setattr("mbd_sim.base.packages._is_installed", lambda module: module != "rerun_notebook")
    with pytest.raises(MissingPackageError, match=r"pip install 'rerun-sdk\[notebook\]'; or use animate"):
        sim.view(until=0.1)
    assert sim.time == 0.0
