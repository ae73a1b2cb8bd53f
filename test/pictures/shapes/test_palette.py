"""The colors of parts and of the curves of their joints."""

from mbd_sim import Simulation
from mbd_sim.pictures.shapes import palette


def test_the_joint_of_a_part_has_the_parts_color():
    mechanism = Simulation.from_file("double_rod").mechanism
    colors = palette.part_colors(mechanism)
    assert palette.series_colors(mechanism) == [colors["upper"], colors["lower"]]
    assert len(set(palette.series_colors(Simulation.from_file("tumbling").mechanism))) == 6
