"""The first length of a motion in which friction turns slip, beside what collocation misses of a decay."""

from types import SimpleNamespace

import numpy as np
import pytest

from mbd_sim.base.rounded import radau
from mbd_sim.simulation.contact.compiled.collocation import MISSED
from mbd_sim.simulation.contact.compiled.instant.sliding import STAGES
from mbd_sim.simulation.contact.compiled.lengths import ACCURATE, CLOSED, length_of_transient, length_to_close

NODES = np.array(radau(STAGES)[0])
AHEAD = 1e-4  # s


def foreseen(longest, rate, across, direction):
    """The length for one friction element whose slip is turned at a rate, with an acceleration across its direction."""
    c = SimpleNamespace(
        frictions=1, friction_rows=[0, 1], gaps=0, rows=2, guards=0, pair_places=[0], unit_speed=1.0, unit_rate=1.0
    )
    x, y = np.cos(direction), np.sin(direction)
    before, ahead = np.array([0.0, x, y, 0.0, 0.0, rate]), np.zeros(6)
    ahead[1:3] = np.array([x, y]) + AHEAD * across * np.array([-y, x])
    sliding = SimpleNamespace(turning=[1], directions=[x, y])
    return length_of_transient(c, SimpleNamespace(sliding=sliding, before=before, span=[AHEAD]), longest, ahead)


def error(length, rate, across):
    """That of a motion in which an acceleration decays: by its polynomial through the nodes, at the start."""
    powers = np.vander(NODES, STAGES, increasing=True)
    return MISSED * length * abs(across * (1.0 - np.linalg.solve(powers, np.exp(-rate * length * NODES))[0]))


@pytest.mark.parametrize("seed", range(40))
def test_a_decay_is_accurate_in_its_first_length(seed):
    """A wrong power of the rate or of the length would miss by decades."""
    rng = np.random.default_rng(seed)
    rate, across = 10.0 ** rng.uniform(3.0, 7.0), 10.0 ** rng.uniform(-1.0, 2.0)
    length = foreseen(1.0, rate, across, rng.uniform(0.0, 6.0))
    assert ACCURATE / 30.0 < error(length, rate, across) < 2.5 * ACCURATE


def test_a_length_that_is_nearly_accurate_is_tried():
    assert foreseen(1e-3, 100.0, 1.0, 0.3) == 1e-3


@pytest.mark.parametrize(("height", "rate", "pull"), [(0.0, 1e-4, 250.0), (1e-10, 3e-4, 20.0), (2e-9, 1e-9, 9.81)])
def test_a_gap_that_closes_soon_limits_a_length(height, rate, pull):
    """Beside the root of its parabola; not where it closes later, moves away, or has not risen beyond round-off."""

    def limited(rate, pull, height=height):
        c = SimpleNamespace(
            gaps=1, rows=1, first_mode=0, clutches=[0], slots=[0], tolerance=1e-13, gap_units=[1.0], row_speeds=[1.0]
        )
        before, ahead = np.array([0.0, height, rate]), np.array([0.0, 0.0, rate - 1e-3 * pull])
        return length_to_close(c, SimpleNamespace(before=before, inputs=[0.0]), 1e-3, ahead)

    roots = np.roots([-0.5 * pull, rate, height])
    assert limited(rate, pull) == pytest.approx(CLOSED * max(roots))
    assert limited(rate, -pull) == 1e-3
    assert limited(1e-3 * pull, pull) == 1e-3
    assert limited(1e-3 * np.sqrt(1e-13 * pull), pull, 0.0) == 1e-3
