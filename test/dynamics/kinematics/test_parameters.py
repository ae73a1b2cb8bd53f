import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.kinematics.parameters import StructureError, SymbolicParameters, equation_data, varying_parameters
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism

NAMES = ("air_spring", "stick_slip", "knife_edge", "follower_force", "spring_chain", "four_bar", "rotating_frame_mass")


def all_free(mechanism) -> SymbolicParameters:
    """All numbers that can be symbols."""
    data = equation_data(mechanism)
    indices = np.arange(len(data.free))
    return SymbolicParameters(data, indices, indices, data.free)


@pytest.mark.parametrize("name", NAMES)
def test_equations_with_every_number_symbolic_are_the_same(name):
    mechanism = load_mechanism(name)
    plain, free = derive(mechanism), derive(mechanism, (), all_free(mechanism))
    random = np.random.default_rng(4)
    y = plain.start_state + 0.05 * random.normal(size=plain.start_state.size)
    if plain.project is not None:
        y = np.array(plain.project(0.1, y)).ravel()
    efforts = random.normal(size=plain.layout.nv)
    inputs = np.concatenate([efforts, free.parameters.base])
    expected = np.array(plain.rates.call([0.1, y, efforts])[0]).ravel()
    found = np.array(free.rates.call([0.1, y, inputs])[0]).ravel()
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    for one, other in ((plain.energies, free.energies), (plain.poses, free.poses), (plain.violation, free.violation)):
        there = np.array(one(0.1, y)).ravel()
        assert np.array(other(0.1, y, inputs)).ravel() == pytest.approx(there, rel=1e-11, abs=1e-11)


CHANGES = {
    "double_rod": {"l": 1.3, "m": 0.7, "gravity[2]": -3.0, "joints.elbow.damping": 0.4},
    "four_bar": {"crank": 0.45, "density": 2.0},
    "cart_pendulum_spring": {"gravity[2]": -5.0},
    "stick_slip": {},
    "slider_crank": {},
}


@pytest.mark.parametrize("name", [name for name, changes in CHANGES.items() if changes])
def test_the_values_of_another_mechanism_give_its_equations(name):
    base = load_mechanism(name)
    other = with_values(base, CHANGES[name])
    parameters = varying_parameters(equation_data(base), [equation_data(other)])
    free, plain = derive(base, (), parameters), derive(other)
    given = parameters.checked_values_in(equation_data(other))
    y = plain.start_state
    rates = np.array(plain.rates.call([0.0, y, np.zeros(plain.layout.nv)])[0]).ravel()
    found = np.array(free.rates.call([0.0, y, np.concatenate([np.zeros(plain.layout.nv), given])])[0]).ravel()
    assert found == pytest.approx(rates, rel=1e-12, abs=1e-12 * np.abs(rates).max())


def test_equal_numbers_share_a_parameter():
    base = load_mechanism("double_rod")
    parameters = varying_parameters(equation_data(base), [equation_data(with_values(base, {"m": 2.0}))])
    assert len(parameters.base) < len(parameters.indices)
    assert ca.SX(parameters.symbols).shape == (len(parameters.base), 1)


OBLIQUE = """
mechanism: oblique
parameters: {{l: {length}}}
parts: {{arm: {{mass: 1.3, center: [0.05, 0.02, -l/2], inertia: {{xx: 0.02, yy: 0.03, zz: 0.015, xy: 0.002, xz: -0.001, yz: 0.003}}}}}}
joints: {{pin: {{type: revolute, between: [ground, arm], axis: [1, 2, -1]}}}}
"""


def test_turned_inertias_may_differ_from_their_transposes_by_round_off():
    lengths = (0.4, 0.44, *np.linspace(0.3, 0.6, 13).tolist())
    base, probe, *others = [equation_data(parse_mechanism(OBLIQUE.format(length=length))) for length in lengths]
    parameters = varying_parameters(base, [probe])
    exact = []
    for other in others:
        expected = base.free.copy()
        expected[parameters.indices] = parameters.checked_values_in(other)[parameters.columns]
        exact.append(np.array_equal(expected, other.free))
        assert np.allclose(expected, other.free, rtol=0, atol=1e-15)
    assert not all(exact)
    heavier = parse_mechanism(OBLIQUE.format(length=0.4).replace("1.3", "1.3000000000005"))
    with pytest.raises(StructureError, match="not among the values"):
        parameters.checked_values_in(equation_data(heavier))


def test_what_is_built_into_the_equations_cannot_vary():
    base = load_mechanism("double_rod")
    turned = parse_mechanism(base.source.text.replace("axis: [0, -1, 0]", "axis: [0, 1, 0]"))
    with pytest.raises(StructureError, match="axis"):
        varying_parameters(equation_data(base), [equation_data(turned)])
    parameters = varying_parameters(equation_data(base), [equation_data(with_values(base, {"m": 2.0}))])
    with pytest.raises(StructureError, match="not among the values"):
        parameters.checked_values_in(equation_data(with_values(base, {"l": 2.0})))
    with pytest.raises(StructureError, match="different parts"):
        parameters.checked_values_in(equation_data(load_mechanism("four_bar")))
