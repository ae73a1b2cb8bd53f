"""Functions that are compiled when they are first read: from the cache they need no equations, and have the same bits."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.compiler.python.bound_call import CompiledFunction


def readings(simulation, point):
    place, reactions = simulation.point(point), simulation.reactions()
    return [
        *(np.concatenate(reaction) for reaction in reactions.values()),
        *simulation.multipliers().values(),
        simulation.mass_matrix(),
        place.jacobian,
        simulation.momentum().angular,
    ]


@pytest.mark.parametrize(("name", "point"), [("four_bar", "coupler"), ("double_rod", "lower")])
def test_those_that_were_compiled_before_are_read_without_the_equations(own_builds, monkeypatch, tmp_path, name, point):
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path))
    traced = readings(Simulation.from_file(name), point)

    def derived(*_):
        raise AssertionError("the equations are traced")

    monkeypatch.setattr("mbd_sim.dynamics.equations.derive", derived)
    cached = readings(Simulation.from_file(name), point)
    assert [array.tobytes() for array in cached] == [array.tobytes() for array in traced]


def test_places_of_contacts_are_compiled_only_for_readers_and_before_their_first_reading(own_builds, monkeypatch):
    """What publishes contacts asks for them before the run, in which a compilation would make steps late."""
    compiled, compile_ = [], CompiledFunction.of.__func__

    def counted(cls, trace, key=None):
        compiled.append(key)
        return compile_(cls, trace, key)

    monkeypatch.setattr(CompiledFunction, "of", classmethod(counted))
    simulation = Simulation.from_file("rocking")
    simulation.step(5)
    assert not compiled
    names = simulation.model.contact_readings.placed_names()
    assert len(compiled) == 1
    assert set(names) <= simulation.contacts().keys()
    assert len(compiled) == 1


def test_without_a_cache_nothing_is_stored(own_builds, monkeypatch):
    monkeypatch.setenv("MBD_SIM_CACHE", "off")
    simulation = Simulation.from_file("double_rod")
    assert simulation.model.key is None
    assert np.linalg.eigvalsh(simulation.mass_matrix()).min() > 0.0


@pytest.mark.parametrize("name", ["four_bar", "disk_weight", "upright_wheel", "double_rod"])
def test_multipliers_are_those_of_the_equations(name):
    simulation = Simulation.from_file(name)
    simulation.step(50)
    model, arguments = simulation.model, (simulation.time, simulation.y, np.array(simulation.inputs))
    found = simulation.multipliers()
    assert list(found) == list(dict.fromkeys(model.row_names))
    values = np.concatenate([np.zeros(0), *found.values()])
    expected = np.array(model.equations.multipliers(*arguments)).ravel()
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-13 * np.max(np.abs(expected), initial=1.0))
    again = np.concatenate([np.zeros(0), *model.multipliers(*arguments).values()])
    assert again.tobytes() == values.tobytes()
