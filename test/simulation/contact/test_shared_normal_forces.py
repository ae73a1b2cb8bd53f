"""Normal forces that rigid bodies leave undetermined: those of equal elastic supports, in whatever order they are listed.

The reference is a table that slides flat on the floor, from the equations of its plane motion and the admissible normal
forces with the least sum of squares.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mbd_sim import Simulation
from mbd_sim.simulation.contact.records import ContactChange

G, MASS, INERTIA, TIME = 9.81, 10.0, 1.0, 0.15


def table(legs, center, friction, velocity, order, law=""):
    points = ", ".join(f"p{number}: [{x}, {y}, 0]" for number, (x, y) in enumerate(legs))
    listed = ", ".join(f"top.p{number}" for number in order)
    vx, vy, turning = velocity
    return f"""
mechanism: table
parts: {{top: {{mass: {MASS}, inertia: [{INERTIA}, {INERTIA}, {INERTIA}], center: {[float(part) for part in center]}, points: {{{points}}}}}}}
joints:
  f: {{type: free, between: [ground, top], velocity: [{vx}, {vy}, 0], angular_velocity: [0, 0, {turning}]}}
contacts: {{floor: {{parts: [{listed}], plane: ground, friction: {friction}{law}}}}}
"""


def plane_state(simulation):
    q, u = simulation.q, simulation.u
    return np.array([q[0], q[1], 2.0 * np.arctan2(q[6], q[3]), u[0], u[1], u[5]])


def least_squares(wrenches, load):
    """The admissible forces λ ≥ 0 of least Σ λ², by trying all sets of legs."""
    best = None
    for count in range(1, wrenches.shape[1] + 1):
        for legs in map(list, combinations(range(wrenches.shape[1]), count)):
            forces = np.linalg.lstsq(wrenches[:, legs], load, rcond=None)[0]
            off = np.linalg.norm(wrenches[:, legs] @ forces - load) > 1e-9 * np.linalg.norm(load)
            if not off and forces.min() > -1e-9 and (best is None or forces @ forces < best[0]):
                best = forces @ forces, legs, forces
    found = np.zeros(wrenches.shape[1])
    found[best[1]] = best[2]
    return found


def reference(legs, center, friction, velocity):
    def rates(_, state):
        angle, turning = state[2], state[5]
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        places, middle = legs @ turn.T, turn @ center[:2]
        slip = state[3:5] + turning * np.column_stack([-places[:, 1], places[:, 0]])
        direction = slip / np.linalg.norm(slip, axis=1)[:, None]
        unit = np.column_stack([-friction * direction, np.ones(len(legs))])
        levers = np.column_stack([places - middle, np.full(len(legs), -center[2])])
        moments = np.cross(levers, unit)
        forces = least_squares(np.vstack([unit[:, 2], moments[:, 0], moments[:, 1]]), np.array([MASS * G, 0.0, 0.0]))
        spin = (forces @ moments)[2] / INERTIA
        move = (forces @ unit)[:2] / MASS - spin * np.array([-middle[1], middle[0]]) + turning**2 * middle
        return [*state[3:], *move, spin]

    start = [0.0, 0.0, 0.0, *velocity]
    return solve_ivp(rates, (0.0, TIME), start, method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.03).y[:, -1]


RANDOM_TABLES = {"all legs press": (0, 0.1), "a leg is unloaded": (32, 0.22)}


def random_table(seed, spread):
    """Four to six legs on an ellipse, and a center of mass within `spread`."""
    chance = np.random.default_rng(seed)
    angles = np.sort(chance.uniform(0.0, 2.0 * np.pi, chance.integers(4, 7)))
    legs = np.round(np.column_stack([0.5 * np.cos(angles), 0.4 * np.sin(angles)]), 3)
    center = np.round([*chance.uniform(-spread, spread, 2), chance.uniform(0.02, 0.2)], 3)
    friction = float(np.round(chance.uniform(0.1, 0.4), 2))
    velocity = np.round([*chance.uniform(-2.0, 2.0, 2), chance.uniform(-3.0, 3.0)], 2)
    return legs, center, friction, velocity


@pytest.mark.parametrize("name", RANDOM_TABLES)
def test_a_table_slides_on_its_legs_as_on_equal_elastic_ones(name):
    """Forces of some three of the legs would turn it otherwise: by 9 % after 0.2 s."""
    legs, center, friction, velocity = random_table(*RANDOM_TABLES[name])
    simulation = Simulation.from_text(table(legs, center, friction, velocity, range(len(legs))))
    simulation.run(until=TIME)
    assert plane_state(simulation) == pytest.approx(reference(legs, center, friction, velocity), abs=1e-11)
    forces = np.array([state.normal for state in simulation.contacts().values()])
    assert np.all(forces >= 0.0) and forces.sum() == pytest.approx(MASS * G, rel=1e-12)
    assert np.any(forces == 0.0) == (name == "a leg is unloaded")


def test_the_order_of_legs_does_not_matter():
    """Neither while it slides, nor where it falls flat on all legs at once."""
    legs, center, friction, velocity = random_table(0, 0.1)
    found = []
    for order in (range(len(legs)), np.random.default_rng(1).permutation(len(legs))):
        text = table(legs, center, friction, velocity, order, ", restitution: 0.3")
        simulation = Simulation.from_text(text.replace("velocity: [", "position: [0, 0, 0.05], velocity: [", 1))
        simulation.run(until=TIME)
        found.append(np.concatenate([plane_state(simulation), [simulation.energies.total]]))
    assert found[1] == pytest.approx(found[0], abs=1e-11)
    assert any(event.change is ContactChange.IMPACT for event in simulation.contact_events)


def test_a_table_at_rest_presses_equally_on_four_legs_whatever_their_order():
    legs, center = np.array([[0.5, 0.3], [-0.5, 0.3], [-0.5, -0.3], [0.5, -0.3]]), (0.0, 0.0, 0.05)
    for order in ((0, 1, 2, 3), (3, 1, 0, 2)):
        simulation = Simulation.from_text(table(legs, center, 0.3, (0.0, 0.0, 0.0), order))
        states = simulation.contacts().values()
        assert [state.normal for state in states] == pytest.approx([MASS * G / 4.0] * 4, rel=1e-12)
        assert "statically indeterminate" in " ".join(simulation.remarks)
