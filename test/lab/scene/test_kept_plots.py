"""The plots of a page with a motion."""

from mbd_sim import Simulation
from mbd_sim.lab.scene.keep import _plots


def plotted(name):
    simulation, points = Simulation.from_file(name), []
    for _ in range(3):
        points.append((simulation.time, simulation.snapshot()))
        simulation.step(10)
    svg = _plots(simulation.model, points, dark=False)
    return [unit for unit in ("m", "deg", "rad, m", "J") if f"<!-- {unit} -->" in svg], svg


def test_each_unit_has_a_plot():
    units, svg = plotted("cart_servo")
    assert units == ["m", "deg", "J"]
    assert svg.count('id="axes_') == 3


def test_a_mechanism_of_angles_has_one_plot_of_them():
    units, svg = plotted("double_rod")
    assert units == ["deg", "J"]
    assert svg.count('id="axes_') == 2
