"""Modes, their shapes and their animation."""

import numpy as np
import pytest
from PIL import Image

from mbd_sim import Simulation
from mbd_sim.analysis.linear.linearization import modes
from mbd_sim.studies.linear_analysis import animate_mode, plots, to_equilibrium
from mbd_sim.studies.linear_analysis.plots import mode_shapes


def test_modes_of_a_chain_of_masses_and_springs():
    """ω = 2 √(k/m) sin(i π / 2(N + 1)), with the shapes sin(i j π / (N + 1))."""
    sim = Simulation.from_file("spring_chain")
    to_equilibrium(sim)
    count, places = len(sim.q), np.arange(1, len(sim.q) + 1)
    for number, shape in enumerate(mode_shapes(sim.linearize()), 1):
        exact = 2 * np.sqrt(200 / 0.5) * np.sin(number * np.pi / (2 * (count + 1)))
        assert 2 * np.pi * shape.mode.frequency == pytest.approx(exact, rel=1e-12)
        form = np.sin(number * np.pi / (count + 1) * places)
        found = shape.displacements * form[np.argmax(np.abs(shape.displacements))]
        assert found == pytest.approx(form, abs=1e-9)


def test_modes_and_shapes_agree_in_a_loop():
    sim = Simulation.from_file("four_bar")
    sim.set_state({"crank_pivot": -0.8})  # beside the stable one
    to_equilibrium(sim)
    linear = sim.linearize()
    (shape,) = mode_shapes(linear)
    assert [shape.mode] == modes(linear)
    gradient = sim.constraint_jacobian()
    assert np.max(np.abs(gradient @ shape.displacements)) < 1e-12


def test_a_mode_is_animated(tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "CYCLE", 4)
    sim = Simulation.from_file("rod_pendulum")
    to_equilibrium(sim)
    (shape,) = mode_shapes(sim.linearize())
    amplitude = animate_mode(sim, shape, tmp_path / "mode.gif")
    assert 0.05 < amplitude < 1.001 * plots.LARGEST_ANGLE
    with Image.open(tmp_path / "mode.gif") as film:
        frames = [np.array(film.convert("RGB")) for number in range(film.n_frames) if film.seek(number) is None]
    assert film.n_frames == 4 or len(frames) >= 3  # equal frames are merged
    assert np.any(frames[0] != frames[2])


def test_efforts_move_the_equilibrium():
    """m g l/2 sin q = e."""
    sim = Simulation.from_file("rod_pendulum")
    sim.set_efforts([2.0])
    m, length = (sim.mechanism.parameters[name] for name in ("m", "l"))
    (q,) = to_equilibrium(sim)
    assert abs(np.sin(q)) == pytest.approx(2.0 / (m * 9.81 * length / 2), rel=1e-9) and sim.efforts == [2.0]
