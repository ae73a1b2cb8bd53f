"""Forces of many contacts in a step of time stepping, which compiled code finds contact by contact."""

from dataclasses import replace

import numpy as np
import pytest

from mbd_sim.compiler.ir.python_kinds import integers
from mbd_sim.simulation.contact import problem
from mbd_sim.simulation.contact.compiled.library import called
from mbd_sim.simulation.contact.compiled.together import elimination
from mbd_sim.simulation.contact.problem import ContactProblem, FrictionLimit, contact_forces, nearest_forces
from test.simulation.contact.test_problem import violations


def heap(seed, bodies, contacts, pull=2.0):
    """Contacts with friction between random pairs of bodies with six coordinates, at least one for each body."""
    random = np.random.default_rng(seed)
    gradient = np.zeros((3 * contacts, 6 * bodies))
    for contact in range(contacts):
        first, second = contact % bodies, int(random.integers(-1, contact % bodies or 1))
        for body in {first, second} - {-1}:
            gradient[[contact, contacts + 2 * contact, contacts + 2 * contact + 1], 6 * body : 6 * body + 6] = (
                random.normal(size=(3, 6))
            )
    speeds = random.normal(size=6 * bodies)
    free = gradient @ speeds - pull * np.arange(3 * contacts).clip(max=1) * (np.arange(3 * contacts) < contacts)
    rows = [(contacts + 2 * k, contacts + 2 * k + 1) for k in range(contacts)]
    frictions = [FrictionLimit(rows[k], k, float(random.choice([0.1, 0.3]))) for k in range(contacts)]
    return ContactProblem(gradient @ gradient.T, free, range(contacts), frictions)


def table(legs, weight=9.81, push=0.0):
    """A table on many legs, which share its weight and a push along it: three directions of each leg."""
    turns = 2.0 * np.pi * np.arange(legs) / legs
    arms = np.stack([np.cos(turns), np.sin(turns), np.full(legs, -0.5)], axis=1)
    rows = []
    for direction in (2, 0, 1):
        for arm in arms:
            axis = np.eye(3)[direction]
            rows.append(np.concatenate([axis, np.cross(arm, axis)]))
    normals, along, across = np.split(np.array(rows), 3)
    gradient = np.concatenate([normals, np.stack([along, across], axis=1).reshape(-1, 6)])
    free = gradient @ np.array([push, 0.0, -weight, 0.0, 0.0, 0.0])
    frictions = [FrictionLimit((legs + 2 * k, legs + 2 * k + 1), k, 0.5) for k in range(legs)]
    return ContactProblem(gradient @ gradient.T, free, range(legs), frictions)


@pytest.mark.parametrize("seed", range(6))
def test_only_solutions_are_those_of_the_solvers_of_events(seed):
    """Finds contacts that are left out of the elimination, or derivatives in the wrong rows."""
    whole = heap(seed, 12, 14)
    forces, residual = nearest_forces(whole)
    assert residual == 0.0 and np.count_nonzero(forces) > 10
    assert max(violations(whole, forces)) < 1e-10
    assert forces == pytest.approx(contact_forces(whole), rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("push", [0.0, 3.0])
def test_legs_share_a_load_as_equal_elastic_supports(push):
    """Finds forces that are any of the many solutions, as those from which Newton's method began."""
    legs = 8
    whole = table(legs, push=push)
    forces, residual = nearest_forces(whole)
    assert residual == 0.0
    assert max(violations(whole, forces)) < 1e-10
    assert forces == pytest.approx(contact_forces(whole), abs=1e-5)
    if push == 0.0:
        assert forces[:legs] == pytest.approx(np.full(legs, 9.81 / legs), rel=1e-6)


def test_the_order_of_contacts_does_not_matter():
    """Finds shares that depend on which contact is eliminated first."""
    whole, legs = table(7, push=2.0), 7
    order = np.random.default_rng(3).permutation(legs)
    rows = [*order, *(legs + 2 * k + side for k in order for side in range(2))]
    frictions = [FrictionLimit((legs + 2 * k, legs + 2 * k + 1), k, 0.5) for k in range(legs)]
    turned = ContactProblem(whole.matrix[np.ix_(rows, rows)], whole.free[rows], range(legs), frictions)
    assert nearest_forces(turned)[0] == pytest.approx(nearest_forces(whole)[0][rows], abs=1e-5)


def test_elimination_solves_systems_whose_rows_must_be_exchanged_within_a_contact():
    """Finds pivots that are zero, and fill between contacts that the order does not foresee."""
    whole, random = heap(1, 9, 13), np.random.default_rng(2)
    n, p = len(whole.free), replace(whole._for_compiled, matrix=whole.matrix.ravel())
    contacts = integers(n)
    count = elimination.number_contacts(p, contacts)
    e = elimination.Elimination(count, integers(count), integers(count + 1), integers(count * n))
    elimination.find_order(p, contacts, count, e)
    assert sorted(e.coupled[e.begins[k] + i] for k in range(count) for i in range(e.sizes[k])) == list(range(n))
    matrix = np.where(whole.matrix != 0.0, random.normal(size=(n, n)), 0.0) + 4.0 * np.eye(n)
    first, second = np.flatnonzero(contacts == 0)[:2]
    matrix[[first, second]] = matrix[[second, first]]
    right = random.normal(size=n)
    found = right.copy()
    assert elimination.eliminate(e, n, matrix.ravel().copy(), found) > 0.0
    assert matrix @ found == pytest.approx(right, abs=1e-9)
    assert elimination.eliminate(e, n, np.zeros(n * n), found) == 0.0


def test_many_contacts_without_forces_take_no_searches_for_few(monkeypatch):
    """Finds minutes in the solvers of events, where the compiled ones have found nothing: sweeps give the nearest."""

    def without(name, *arguments):
        return False if name == "nearest_forces" else called(name, *arguments)

    def refuse(_):
        raise AssertionError

    whole = heap(0, 15, 20)
    expected, _ = nearest_forces(whole)
    monkeypatch.setattr(problem, "called", without)
    monkeypatch.setattr(problem, "contact_forces", refuse)
    forces, residual = nearest_forces(whole)
    assert residual < 1e-12
    assert forces == pytest.approx(expected, abs=1e-9)
