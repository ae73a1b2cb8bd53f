"""The `repr` of public objects says in one line what they are."""

import importlib
import inspect
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import mbd_sim
from mbd_sim import Ensemble, Simulation, load_mechanism
from mbd_sim.integrators.methods import METHODS
from mbd_sim.studies.kinematic_analysis import driven_motion
from test.generators.mechanisms import SHIPPED


@pytest.fixture(scope="module")
def simulation():
    simulation = Simulation(load_mechanism("four_bar"))
    simulation.run(until=0.5)
    return simulation


def test_records_and_simulations(simulation):
    mechanism = simulation.mechanism
    assert repr(mechanism) == (
        "<Mechanism four_bar: 3 parts, 4 joints; coordinates crank_pivot, crank_pin, rocker_pivot>"
    )
    assert repr(mechanism.parts["crank"]) == "<Part crank: 0.5 kg, 1 point>"
    assert repr(mechanism.joints["crank_pivot"]) == "<Joint crank_pivot: revolute, ground – crank>"
    assert repr(mechanism.source).endswith("four_bar.yaml>")
    assert repr(simulation) == "<Simulation four_bar at t = 0.5 s: method adams11, step 0.001 s>"
    assert repr(simulation.model) == "<Model four_bar: method adams11>"


def test_studies(simulation):
    ensemble = Ensemble(simulation.mechanism, 3)
    assert repr(ensemble).startswith("<Ensemble of 3 × four_bar at t = 0 s: method ")
    motion = driven_motion(simulation.mechanism, {"crank_pivot": (0.0, 1.0)}, 5)
    assert repr(motion) == "<DrivenMotion of four_bar: 5 positions of crank_pivot, speed 1>"
    system = simulation.state_space()
    assert repr(system).startswith(f"<StateSpace: states {system.states[0]}, ")


PACKAGES = [
    mbd_sim, *(importlib.import_module(f"mbd_sim.{name}") for name in (
        "many.gym", "studies.kinematic_analysis", "studies.linear_analysis", "studies.optimization", "studies.symbolic",
        "studies.synthesis", "pictures.rerun"))
]  # fmt: skip
PUBLIC = sorted(
    {
        one
        for package in PACKAGES
        for one in (getattr(package, name) for name in package.__all__)
        if inspect.isclass(one) and not issubclass(one, Exception)
    },
    key=lambda one: one.__name__,
)
CALLED = (
    "actuators", "contacts", "drives", "linearize", "poses", "reactions", "sensors", "snapshot",
    "state_space",
)  # fmt: skip


@pytest.mark.parametrize("one", PUBLIC, ids=lambda one: one.__name__)
def test_every_public_class_describes_itself(one):
    """Those of `object`, of dataclasses and of named tuples print addresses, or all numbers."""
    code = getattr(one.__repr__, "__code__", None)
    assert code is not None and Path(mbd_sim.__file__).parent in Path(code.co_filename).parents


@pytest.mark.parametrize("name", SHIPPED)
def test_the_records_of_every_shipped_mechanism_are_short_lines(name):
    found = [pair for key, value in members(load_mechanism(name)) for pair in contents(key, value)]
    assert len(found) > 2
    assert [key for key, value in found if not is_short(value)] == []


@pytest.mark.parametrize(
    "name", ["balancing_pendulum", "bounce", "motor_arm", "hydraulic_scissor_lift", "bead_on_wire"]
)
def test_whatever_a_simulation_hands_out_is_one_short_line(name):
    simulation = Simulation.from_file(name)
    simulation.step(3)
    roots = {f"simulation.{key}": value for key, value in members(simulation)}
    roots |= {f"model.{key}": value for key, value in members(simulation.model) if name == "bounce"}  # it compiles
    for key in CALLED:
        try:
            roots[f"{key}()"] = getattr(simulation, key)()
        except mbd_sim.MbdSimError:
            continue
    found = [pair for key, value in roots.items() for pair in contents(key, value)]
    assert len(found) > 10
    assert [key for key, value in found if not is_short(value)] == []


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_methods_do_not_print_their_coefficients(method):
    assert is_short(method) and method.name in repr(method)


def test_names_of_any_length_are_cut():
    arms = ", ".join(f"{'very_long_' * 5}{number}: {{mass: 1}}" for number in range(30))
    joints = ", ".join(
        f"{'joint_' * 7}{number}: {{type: prismatic, between: [ground, {'very_long_' * 5}{number}], axis: [0, 0, 1]}}"
        for number in range(30)
    )
    mechanism = mbd_sim.parse_mechanism(f"mechanism: long\nparts: {{{arms}}}\njoints: {{{joints}}}\n")
    assert is_short(mechanism) and all(is_short(each) for each in mechanism.joints.values())
    assert is_short(Simulation(mechanism).state_space())


def members(value):
    """The public attributes of an object that are no methods, as far as they can be read."""
    for name in dir(value):
        if not name.startswith("_"):
            try:
                found = getattr(value, name)
            except (AttributeError, TypeError, ValueError, mbd_sim.MbdSimError):
                continue
            if not callable(found):
                yield name, found


def contents(name, value, depth=0):
    """An object of ours, or those in a collection."""
    if type(value).__module__.startswith("mbd_sim") and not isinstance(value, np.ndarray):
        yield name, value
    elif depth < 3 and isinstance(value, Mapping):
        for key, each in value.items():
            yield from contents(f"{name}[{key}]", each, depth + 1)
    elif depth < 3 and isinstance(value, tuple | list):
        for number, each in enumerate(value):
            yield from contents(f"{name}[{number}]", each, depth + 1)


def is_short(value):
    text = repr(value)
    return len(text) <= 200 and "\n" not in text and " at 0x" not in text
