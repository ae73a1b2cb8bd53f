"""Ropes in pictures: straight while they are taut, and of their own length while they are slack."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.pictures.drawing import symbols
from mbd_sim.pictures.drawing.picture import compose
from mbd_sim.pictures.drawing.symbols import hanging
from test.pictures.start import AtStart

DOWN = np.array([0.0, 0.0, -1.0])
SLING = """
mechanism: sling
parts: {load: {shape: {type: particle, mass: 2}}}
joints: {load: {type: prismatic, between: [ground, load], axis: [0, 0, 1], position: -0.5}}
ground: {points: {a: [-0.6, 0, 0], b: [0.6, 0, 0]}}
constraints: {sling: {type: cable, through: [ground.a, load, ground.b], length: LENGTH, bound: at_most}}
"""


def length_of(line):
    return np.linalg.norm(np.diff(line, axis=0), axis=1).sum()


@pytest.mark.parametrize("stop", [[0.8, 0.0, 0.3], [0.0, 0.0, 0.7], [0.0, 0.0, 0.0], [1e-9, 0.0, 0.0]])
@pytest.mark.parametrize("excess", [1e-5, 0.2, 3.0])
def test_a_slack_rope_hangs_between_its_ends_with_its_own_length(stop, excess):
    start, stop = np.zeros(3), np.array(stop)
    line = hanging(start, stop, excess, DOWN)
    assert np.array_equal(line[0], start) and line[-1] == pytest.approx(stop, abs=1e-15)
    assert length_of(line) == pytest.approx(np.linalg.norm(stop) + excess, abs=1e-9)
    straight = np.linspace(start, stop, len(line))
    assert np.all(line[1:-1, 2] < straight[1:-1, 2])
    assert line[:, :2] == pytest.approx(straight[:, :2], abs=1e-15)


def line_of(monkeypatch, simulation):
    drawn, original = [], symbols.cable_paths
    monkeypatch.setattr(
        symbols, "cable_paths", lambda page, line, depth: drawn.append(line) or original(page, line, depth)
    )
    compose(simulation.mechanism, simulation.poses())
    return drawn[-1]  # of all sizes that were tried


def test_a_rope_is_straight_until_it_goes_slack(monkeypatch):
    simulation = Simulation.from_file("rope")
    taut = line_of(monkeypatch, simulation)
    assert taut == pytest.approx(np.array([[0, 0, 0], [0, 0, -1]]), abs=1e-12)
    simulation.run(until=0.9)
    assert simulation.contacts()["rope"].state == "open"
    slack = line_of(monkeypatch, simulation)
    assert length_of(slack) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(("length", "corners"), [(2.0 * np.hypot(0.6, 0.5), 3), (1.8, 66)])
def test_the_parts_of_a_cable_share_its_slack(monkeypatch, length, corners):
    line = line_of(monkeypatch, AtStart.from_text(SLING.replace("LENGTH", f"{length:.17g}")))
    assert len(line) == corners
    assert length_of(line) == pytest.approx(length, abs=1e-9)
