"""Forces at contacts satisfy their conditions, whatever the contacts have in common."""

import numpy as np
import pytest
from scipy.optimize import minimize

from mbd_sim.simulation.contact.compiled.library import called
from mbd_sim.simulation.contact.complementarity import independent, lemke, solve
from mbd_sim.simulation.contact.problem import (
    ContactProblem,
    FrictionLimit,
    NoSolutionError,
    contact_forces,
    nearest_forces,
)


def violations(problem, forces):
    """How far each condition is from satisfied, relative to the forces and rates."""
    rates = problem.matrix @ forces + problem.free
    size, speed = 1.0 + np.max(np.abs(forces)), 1.0 + np.max(np.abs(problem.free))
    for row in problem.normals:
        yield max(0.0, -forces[row]) / size
        yield max(0.0, -rates[row]) / speed
        yield abs(forces[row] * rates[row]) / size / speed
    for friction in problem.frictions:
        rows = list(friction.rows)
        limit = friction.size * (1.0 if friction.normal is None else forces[friction.normal])
        force, slip = np.linalg.norm(forces[rows]), np.linalg.norm(rates[rows])
        yield max(0.0, force - limit) / size
        yield abs(forces[rows] @ rates[rows] + limit * slip) / size / speed  # against the slip, at its limit


def random_problem(seed):
    random = np.random.default_rng(seed)
    contacts, along = int(random.integers(1, 5)), int(random.integers(1, 3))
    gradient = random.normal(size=(contacts * (1 + along), int(random.integers(2, 7))))
    if seed % 3 == 0:
        gradient[-1] = gradient[0]  # rows that depend on each other
    free = gradient @ random.normal(size=gradient.shape[1]) * random.choice([1e-3, 1.0, 1e3])
    frictions = [
        FrictionLimit(
            tuple(range(contacts + index * along, contacts + (index + 1) * along)),
            index if random.random() < 0.8 else None,
            float(random.choice([0.0, 0.1, 0.5, 1.5])),
        )
        for index in range(contacts)
    ]
    return ContactProblem(gradient @ gradient.T, free, range(contacts), frictions)


def test_random_problems_are_solved():
    for seed in range(200):
        problem = random_problem(seed)
        assert max(violations(problem, contact_forces(problem))) < 1e-9, seed


def test_problems_that_have_nothing_to_do_with_each_other_are_solved_as_if_alone():
    """In whatever order their rows are among each other; some of them have several solutions."""
    for seed in range(0, 60, 3):
        parts = [random_problem(seed + k) for k in range(3)]
        owner = np.repeat(range(3), [len(part.free) for part in parts])
        owner = np.random.default_rng(seed).permutation(owner)
        matrix, free, normals, frictions, expected = np.zeros((len(owner),) * 2), np.zeros(len(owner)), [], [], []
        for part, rows in ((parts[k], np.flatnonzero(owner == k)) for k in range(3)):
            matrix[np.ix_(rows, rows)], free[rows] = part.matrix, part.free
            normals += rows[list(part.normals)].tolist()
            for one in part.frictions:
                normal = None if one.normal is None else int(rows[one.normal])
                frictions.append(FrictionLimit(tuple(rows[list(one.rows)].tolist()), normal, one.size))
            expected.append(contact_forces(part))
        found = contact_forces(ContactProblem(matrix, free, normals, frictions))
        for k in range(3):
            np.testing.assert_array_equal(found[owner == k], expected[k], err_msg=str(seed))


def test_a_block_that_is_pushed_sticks_slides_or_lifts_off():
    matrix = np.eye(2)  # a particle of 1 kg: the rates of its height and along the plane
    friction = [FrictionLimit((1,), 0, 0.5)]

    def forces(pull, push):
        return contact_forces(ContactProblem(matrix, np.array([pull - 10.0, push]), [0], friction)).tolist()

    assert forces(0.0, 3.0) == pytest.approx([10.0, -3.0], abs=1e-14)
    assert forces(0.0, 7.0) == pytest.approx([10.0, -5.0], abs=1e-14)
    assert forces(0.0, -7.0) == pytest.approx([10.0, 5.0], abs=1e-14)
    assert forces(12.0, 7.0) == pytest.approx([0.0, 0.0], abs=1e-14)


def test_a_rod_that_slides_with_too_much_friction_has_no_forces():
    """Painlevé: the friction of sliding makes the diagonal negative."""
    with pytest.raises(NoSolutionError):
        contact_forces(ContactProblem(np.array([[-0.5]]), np.array([-1.0]), [0], []))


def test_lemkes_method_solves_a_problem_of_cottle_pang_and_stone():
    matrix = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert lemke(matrix, np.array([-5.0, -6.0])) == pytest.approx([4.0 / 3.0, 7.0 / 3.0], abs=1e-14)
    assert lemke(np.array([[-1.0]]), np.array([-1.0])) is None


def test_elimination_leaves_out_what_depends_on_other_rows():
    random = np.random.default_rng(0)
    gradient = random.normal(size=(5, 3))
    matrix = gradient @ gradient.T
    assert independent(matrix, [4, 0, 1, 2, 3]) == [4, 0, 1]
    right = matrix @ random.normal(size=5)
    assert matrix @ solve(matrix, right) == pytest.approx(right, abs=1e-12)


def shared_load(chance, contacts, load):
    """Friction at rest of some contacts of a body in a plane, up to 1 each: the rows (2 n, 3), the free rates, limits."""
    places = chance.uniform(-1.0, 1.0, (contacts, 2))
    rows = np.array([row for x, y in places for row in ((1.0, 0.0, -y), (0.0, 1.0, x))])
    wrench = chance.normal(size=3)
    return rows, rows @ (load * wrench), [FrictionLimit((2 * i, 2 * i + 1), None, 1.0) for i in range(contacts)]


def least_forces(rows, free, contacts):
    """By a general optimizer."""
    wanted, pairs = np.linalg.lstsq(rows, free, rcond=None)[0], np.kron(np.eye(contacts), [1.0, 1.0])
    found = minimize(
        lambda x: x @ x,
        np.zeros(2 * contacts),
        jac=lambda x: 2.0 * x,
        method="SLSQP",
        constraints=[
            {"type": "eq", "fun": lambda x: rows.T @ x + wanted, "jac": lambda x: rows.T},
            {"type": "ineq", "fun": lambda x: 1.0 - pairs @ x**2, "jac": lambda x: -2.0 * pairs * x},
        ],
        options={"maxiter": 500, "ftol": 1e-14},
    )
    return found.x if found.success else None


@pytest.mark.parametrize("seed", range(4))
def test_friction_at_rest_is_least_within_its_limits_in_any_order(seed):
    """It was what Newton's method happened to find, so it depended on the order where one was at its limit."""
    chance, contacts, load = np.random.default_rng(seed), 4, 0.0
    state = chance.bit_generator.state
    while True:  # the largest load of a series at which there still is a distribution, with several at their limits
        chance.bit_generator.state = state
        rows, free, limits = shared_load(chance, contacts, load + 0.1)
        if least_forces(rows, free, contacts) is None:
            break
        load += 0.1
    chance.bit_generator.state = state
    rows, free, limits = shared_load(chance, contacts, load)
    expected = least_forces(rows, free, contacts)
    found = contact_forces(ContactProblem(rows @ rows.T, free, [], limits))
    assert found == pytest.approx(expected, abs=1e-5)
    assert found @ found == pytest.approx(expected @ expected, rel=1e-7)
    assert np.max(np.abs(rows @ rows.T @ found + free)) < 1e-10
    order = np.random.default_rng(seed).permutation(contacts)
    moved = [row for contact in order for row in (2 * contact, 2 * contact + 1)]
    other = contact_forces(ContactProblem((rows @ rows.T)[moved][:, moved], free[moved], [], limits))
    assert other == pytest.approx(found[moved], abs=1e-9)


def wheels_on_an_axle(seed):
    """Of each contact, one row of friction is along the axle: these are the same, but for their rates."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 5))
    gradient = random.normal(size=(3 * n, 3 * n))
    gradient[:n] = 0.3 * gradient[:n] + np.eye(n, 3 * n)
    along = [n + 2 * contact + 1 for contact in range(n)]
    gradient[along] = gradient[along[0]]
    free = np.concatenate([random.uniform(-15.0, -5.0, n), random.normal(size=2 * n)])
    free[along] = free[along[0]] + 10.0 ** random.uniform(-6.0, -1.0) * random.normal(size=n)
    frictions = [FrictionLimit((n + 2 * k, n + 2 * k + 1), k, float(random.choice([0.5, 1.0]))) for k in range(n)]
    return ContactProblem(gradient @ gradient.T, free, range(n), frictions)


def test_where_rows_depend_on_each_other_and_cannot_all_rest_some_slide():
    for seed in range(25):
        problem = wheels_on_an_axle(seed)
        assert max(violations(problem, contact_forces(problem))) < 1e-9, seed


def test_the_nearest_forces_solve_what_can_be_solved_beside_a_contact_that_jams():
    """Nothing moves the first gap, which closes by the time alone; the second contact slides beside it."""
    matrix = np.zeros((3, 3))
    matrix[1:, 1:] = [[2.0, 0.5], [0.5, 1.0]]
    problem = ContactProblem(matrix, np.array([-1.0, -4.0, 3.0]), [0, 1], [FrictionLimit((2,), 1, 0.3)])
    forces, residual = nearest_forces(problem)
    assert residual > 0.1
    normal = 4.0 / (2.0 - 0.3 * 0.5)
    assert forces[1:] == pytest.approx([normal, -0.3 * normal], rel=1e-12)


def test_sweeps_approach_the_forces():
    """Newton's method starts from them where all else fails; friction along one and two directions, with and without load."""
    random = np.random.default_rng(4)
    gradient = random.normal(size=(7, 12)) + 3.0 * np.eye(7, 12)
    frictions = [FrictionLimit((2, 3), 0, 0.4), FrictionLimit((4,), 1, 0.6), FrictionLimit((5, 6), None, 0.2)]
    problem = ContactProblem(gradient @ gradient.T, np.array([-8.0, -5, 3, 4, -9, 9, 1]), [0, 1], frictions)
    swept = np.zeros(7)
    called("sweep", problem.packed, 400, swept)
    assert swept == pytest.approx(contact_forces(problem), abs=1e-12)
