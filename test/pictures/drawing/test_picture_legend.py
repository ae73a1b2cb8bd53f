"""The scale below the drawing."""

import pytest

from mbd_sim.pictures.drawing.picture import length_text, nice_length


@pytest.mark.parametrize(
    ("limit", "length"), [(1.0, 1.0), (0.99, 0.5), (4.9, 2.0), (5.0, 5.0), (0.0073, 0.005), (730, 500)]
)
def test_the_scale_has_a_round_length(limit, length):
    assert nice_length(limit) == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize(
    ("length", "text"),
    [(2000, "2 km"), (1.0, "1 m"), (0.5, "50 cm"), (0.01, "1 cm"), (0.005, "5 mm"), (2e-6, "2e-06 m")],
)
def test_a_length_has_a_suitable_unit(length, text):
    assert length_text(length) == text
