"""The factorization of G M⁻¹ Gᵀ, the multipliers, and the projection."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.recursion.multipliers import GuardedFactors, minimum_degree
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.loops import random_mechanisms, state_near_start, with_same_mechanisms
from test.oracles import kane


def symbolic(matrix):
    """A symmetric matrix with a symbol for each nonzero entry of its upper triangle; the symbols and their values."""
    size, symbols, values = len(matrix), [], []
    result = ca.SX(size, size)
    for i in range(size):
        for j in range(i, size):
            if matrix[i, j]:
                symbols.append(ca.SX.sym(f"m{i}_{j}"))
                values.append(matrix[i, j])
                result[i, j] = result[j, i] = symbols[-1]
    return result, ca.vertcat(*symbols), values


def solved(matrix, right, floors=None):
    """The solution from the factors, and its number of instructions."""
    matrix_symbols, symbols, values = symbolic(matrix)
    right_symbol = ca.SX.sym("b", len(right))
    floors = np.full(len(right), 1e-13) if floors is None else floors
    found = ca.Function("solve", [symbols, right_symbol], [GuardedFactors(matrix_symbols, floors).solve(right_symbol)])
    return np.array(found(values, right)).ravel(), found.n_instructions()


def sparse_definite(rng, size, density):
    root = rng.normal(size=(size, size)) * (rng.random((size, size)) < density) + 2.0 * np.eye(size)
    return root @ root.T


def test_factors_solve_like_numpy():
    rng = np.random.default_rng(1)
    for size in (1, 2, 5, 9):
        for density in (0.1, 0.5, 1.0):
            matrix, right = sparse_definite(rng, size, density), rng.normal(size=size)
            expected = np.linalg.solve(matrix, right)
            allowed = 1e-15 * np.linalg.cond(matrix) * np.linalg.norm(expected)
            assert solved(matrix, right)[0] == pytest.approx(expected, abs=10.0 * allowed)


def test_the_solution_does_not_depend_on_the_units_of_the_rows():
    rng = np.random.default_rng(2)
    matrix, right, units = sparse_definite(rng, 6, 0.5), rng.normal(size=6), 10.0 ** rng.uniform(-6, 6, 6)
    scaled = solved(matrix * np.outer(units, units), right * units, 1e-13 * units**2 * np.diag(matrix))[0]
    assert scaled * units == pytest.approx(solved(matrix, right)[0], rel=1e-11)


def test_an_arrow_matrix_is_eliminated_without_fill_in():
    """Its full row is the first; eliminating it first would fill the matrix."""
    size = 30
    matrix = 3.0 * np.eye(size)
    matrix[0, 1:] = matrix[1:, 0] = 0.1
    found, instructions = solved(matrix, np.ones(size))
    assert found == pytest.approx(np.linalg.solve(matrix, np.ones(size)), rel=1e-13)
    assert instructions < 20 * size


def test_the_cost_of_a_band_matrix_is_proportional_to_its_size():
    counts = []
    for size in (20, 40):
        matrix = 3.0 * np.eye(size) + np.eye(size, k=1) + np.eye(size, k=-1)
        counts.append(solved(matrix, np.ones(size))[1])
    assert counts[1] < 2.2 * counts[0]


def test_minimum_degree_takes_the_row_with_the_fewest_neighbors():
    star = {0: {0, 1, 2, 3}, 1: {0, 1}, 2: {0, 2}, 3: {0, 3}}
    assert minimum_degree(star)[:2] == [1, 2]
    chain = {0: {1}, 1: {0, 2}, 2: {1, 3}, 3: {2}}
    assert minimum_degree(chain)[0] in (0, 3)
    rng = np.random.default_rng(3)
    pattern = rng.random((12, 12)) < 0.3
    pattern |= pattern.T
    assert sorted(
        minimum_degree({index: set(np.flatnonzero(row).tolist()) for index, row in enumerate(pattern)})
    ) == list(range(12))


def test_a_dependent_row_is_left_out():
    """The other rows of a singular matrix are solved; the unknown of the dependent row is zero."""
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(3, 5))
    rows = np.vstack([rows, rows[0] - 2.0 * rows[2]])
    matrix = rows @ rows.T
    right = matrix @ rng.normal(size=4)
    found, _ = solved(matrix, right, np.full(4, 1e-12))
    assert np.sum(found == 0.0) == 1
    assert matrix @ found == pytest.approx(right, rel=1e-10)


def test_an_empty_row_is_left_out():
    matrix = np.diag([2.0, 0.0, 4.0])
    assert solved(matrix, np.array([2.0, 5.0, 8.0]))[0].tolist() == [1.0, 0.0, 2.0]


@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.3, np.pi / 2.0])
def test_rows_with_the_large_inverse_mass_of_a_light_part_are_judged_by_what_the_others_leave(angle):
    """K a aᵀ + b bᵀ with a large K, here exactly: the unit vectors a and b do not depend on each other at any angle."""
    along, across = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    matrix = 1e9 * np.outer(along, along) + np.outer(across, across)
    symbols, names, values = symbolic(matrix)
    factors = GuardedFactors(symbols, np.full(2, 1e-2), np.array([True, True]))
    solve = ca.Function("solve", [names], [factors.solve(ca.SX([1.0, 1.0])), factors.pivots[0]])
    found, pivot = solve(values)
    assert np.array(found).ravel() == pytest.approx(np.linalg.solve(matrix, np.ones(2)), rel=1e-6, abs=1e-9)
    assert float(pivot) == pytest.approx(1.0 / np.linalg.inv(matrix)[0, 0], rel=1e-6)


def test_of_rows_with_the_large_inverse_mass_of_a_light_part_the_weak_one_is_left_out():
    """K a aᵀ + b bᵀ with b nearly along a: the pivot K sin² of the first row is large, but the second one repeats it."""
    angle = 1e-3
    along, axis = np.array([np.sin(angle), np.cos(angle)]), np.array([0.0, 1.0])
    symbols, names, values = symbolic(1e9 * np.outer(along, along) + np.outer(axis, axis))
    for light, left_out in ((True, True), (False, False)):
        factors = GuardedFactors(symbols, np.full(2, 1e-2), np.full(2, light))
        found = ca.Function("solve", [names], [factors.solve(ca.SX([1.0, 1.0]))])(values)
        assert (float(found[0]) == 0.0) == left_out
        assert float(found[1]) != 0.0


def in_mass_metric(mechanism, q):
    """Speeds (nv, nv) with a unit mass matrix."""
    nv = kane.coordinate_slices(mechanism)[2]
    mass = kane.equations(mechanism, q, np.zeros(nv), np.zeros(nv)).mass
    return np.linalg.inv(np.linalg.cholesky(mass)).T


def least_change(mechanism, q, defect, gradient):
    """The smallest change in the metric of M that removes a defect."""
    unit = in_mass_metric(mechanism, q)
    return -unit @ np.linalg.lstsq(gradient @ unit, defect, rcond=1e-9)[0]


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "a04_bricard"])
def test_the_projection_changes_velocities_by_the_least_kinetic_energy(name):
    mechanism = load_mechanism(name)
    derived, rng = derive(mechanism), np.random.default_rng(5)
    q, u, _ = state_near_start(mechanism, derived, rng, 0.0)
    off = u + rng.normal(size=len(u))
    projected = np.array(derived.project(0.0, np.concatenate([q, off, np.zeros(3)]))).ravel()
    gradient, _, defect = kane.constraint_rows(mechanism, q, off, 0.0)
    expected = off + least_change(mechanism, q, defect, gradient)
    found = projected[len(q) : len(q) + len(u)]
    assert found == pytest.approx(expected, abs=1e-10)
    again = np.array(derived.project(0.0, projected)).ravel()
    assert again == pytest.approx(projected, abs=1e-12)


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "a04_bricard"])
def test_the_projection_changes_positions_by_the_smallest_displacement(name):
    """To first order in the violation, with an error of second order."""
    mechanism = load_mechanism(name)
    derived, rng = derive(mechanism), np.random.default_rng(6)
    q, u, _ = state_near_start(mechanism, derived, rng, 0.0)
    away = 1e-5 * rng.normal(size=len(u))
    projected = np.array(
        derived.project(0.0, np.concatenate([derived.constraints.displaced(q, away), u, np.zeros(3)]))
    ).ravel()
    gradient = kane.constraint_rows(mechanism, q, u, 0.0)[0]
    expected = derived.constraints.displaced(q, away + least_change(mechanism, q, gradient @ away, gradient))
    assert projected[: len(q)] == pytest.approx(expected, abs=1e-8)
    violation = np.array(derived.violation(0.0, projected))
    assert np.max(np.abs(violation[:, 0])) <= 1e-8


@with_same_mechanisms
@given(random_mechanisms())
def test_multipliers_are_the_forces_that_the_accelerations_require(drawn):
    """M u' - f = Gᵀ λ with the engine's own G, also in mechanisms with redundant rows."""
    text, rng = drawn
    mechanism = parse_mechanism(text)
    try:
        derived = derive(mechanism)
    except MechanismError:
        return  # contradicts its drives
    if not derived.rows or (state := state_near_start(mechanism, derived, rng, 0.05)) is None:
        return
    q, u, efforts = state
    y = np.concatenate([q, u, np.zeros(3)])
    oracle = kane.equations(mechanism, q, u, efforts, 0.05)
    multipliers = np.array(derived.multipliers(0.05, y, efforts)).ravel()
    forces = derived.constraints.gradient(0.05, q).T @ multipliers
    needed = oracle.mass @ oracle.accelerations - oracle.forces
    scale = oracle.scale
    size = 1.0 + np.linalg.norm(oracle.forces / scale) + np.linalg.norm(needed / scale)
    assert (
        np.linalg.norm((forces - needed) / scale)
        <= 1e-13 * oracle.condition * max(oracle.constraint_condition, 10.0) * size
    )
    unused = [row for row in range(len(derived.rows)) if row not in derived.start.active]
    assert not multipliers[unused].any()


def test_a_loop_with_a_rod_far_lighter_than_other_parts_stays_closed():
    """C θ'' + C' θ'²/2 + m g r cos(θ)/2 = 0, C = m r²/3 + M x'², x' = r (sin φ cos θ/cos φ - sin θ), l sin φ = -r sin θ."""
    simulation = Simulation.from_text("""
mechanism: light_rod
parts:
  crank: {mass: 1, shape: {type: rod, to: [0.1, 0, 0]}, points: {tip: [0.1, 0, 0]}}
  rod: {mass: 1e-9, shape: {type: rod, to: [0.3, 0, 0]}, points: {tip: [0.3, 0, 0]}}
  piston: {mass: 2}
joints:
  main: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 1, velocity: 20}
  pin: {type: revolute, between: [crank.tip, rod], axis: [0, -1, 0], position: -1.3, guess: true}
  bore: {type: prismatic, between: [ground, piston], axis: [1, 0, 0]}
  eye: {type: revolute, between: [rod.tip, piston], axis: [0, -1, 0]}
""")
    simulation.run(until=0.2)
    assert simulation.violation.position < 1e-13
    assert abs(simulation.energies.residual) < 1e-8
    angle, rate = float(simulation.q[0]), float(simulation.u[0])

    def inertia(at):
        lean = -np.arcsin(0.1 * np.sin(at) / 0.3)
        return 0.01 / 3.0 + 2.0 * (0.1 * (np.sin(lean) * np.cos(at) / np.cos(lean) - np.sin(at))) ** 2

    slope = (inertia(angle + 1e-5) - inertia(angle - 1e-5)) / 2e-5
    exact = -(0.5 * slope * rate**2 + 9.81 * 0.05 * np.cos(angle)) / inertia(angle)
    assert simulation.u_rates[0] == pytest.approx(exact, rel=1e-7)
