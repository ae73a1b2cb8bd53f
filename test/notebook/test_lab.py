"""The page of a simulation in notebooks."""

import urllib.request

import numpy as np
import pytest
import rich

from mbd_sim import Simulation, load_mechanism
from mbd_sim.lab.lab import Lab

pytest.importorskip("viser")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("four_bar", {"live": "parameters.*", "wrenches": "coupler", "step": 2e-3}),
        ("motor_drive", {}),
    ],
)
def test_it_starts_where_the_simulation_is_and_goes_on_like_it(name, options):
    simulation = Simulation.from_file(name, **options)
    simulation.run(until=0.3)
    simulation.set_efforts(np.full(simulation.efforts.size, 0.1))
    if options:
        simulation.set_wrench("coupler", force=[1.0, 0.0, 2.0])
        simulation.set_live({"parameters.density": 2.0})
    simulation.run(until=0.5)
    before = simulation.snapshot()
    with simulation.lab() as lab:
        own = lab.session.bench.simulation
        assert np.array_equal(own.q, simulation.q)
        assert np.array_equal(own.u, simulation.u)
        assert not lab.session.frame.running
        own.run(until=0.6)
        assert np.array_equal(before.state, simulation.state)
        simulation.run(until=0.6)
        assert own.steps == simulation.steps
        assert own.q == pytest.approx(simulation.q, rel=1e-9, abs=1e-9)
        assert own.u == pytest.approx(simulation.u, rel=1e-9, abs=1e-9)
        assert own.energies.residual == pytest.approx(simulation.energies.residual, abs=1e-9)


def test_back_to_the_file_is_not_back_to_the_start_of_the_page():
    simulation = Simulation(load_mechanism("rod_pendulum"), live="parameters.*")
    simulation.set_live({"parameters.m": 2.0})
    with simulation.lab() as lab:
        (setting,) = (one for one in lab.page._change._settings if one.key == "parameters.m")
        assert setting.value == 1.0
        assert lab.session.frame.values["parameters.m"] == 2.0


def test_a_notebook_shows_the_page_inline(monkeypatch):
    """Nothing else is shown: in a notebook, rich displays what it prints, whatever becomes of the standard output."""
    shown = []
    monkeypatch.setattr("rich.jupyter.display", lambda segments, text: shown.append(text))
    monkeypatch.setattr(rich.get_console(), "is_jupyter", True)
    with Lab(load_mechanism("rod_pendulum"), port=0, running=False) as lab:
        assert f'<iframe src="{lab.url}"' in lab._repr_html_()
        assert lab.url in repr(lab)
        with urllib.request.urlopen(lab.url) as answer:  # what a browser may show in a frame
            assert "X-Frame-Options" not in answer.headers
            assert "frame-ancestors" not in (answer.headers["Content-Security-Policy"] or "")
    assert not shown
