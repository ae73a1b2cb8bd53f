"""What the errors of a state are compared with."""

import pytest

from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.natural_units import NaturalUnits, natural_units

TURNED = """
mechanism: blades
parts:
  blade: {{shape: {{type: block, mass: 40 g, size: [16 cm, 2 mm, 1 cm]}}}}
  other: {{mass: 40 g, shape: {{type: block, size: [16 cm, 2 mm, 1 cm], at: [0, {offset} mm, 0]}}}}
joints:
  hand: {{type: free, between: [ground, blade]}}
  pin: {{type: revolute, between: [blade, other], axis: [0, 1, 0]}}
"""


@pytest.mark.parametrize("offset", [0.0, 0.002, 2.0, 20.0])
def test_the_size_of_a_mechanism_is_that_of_its_bodies_where_its_points_are_closer_together(offset):
    """Blades of 16 cm whose centers are 2 mm apart had a natural length of 1 mm, and round-off counted as an error."""
    assert natural_units(parse_mechanism(TURNED.format(offset=offset)), 1e-3) == NaturalUnits(1.0, 1.0, 1.0)
