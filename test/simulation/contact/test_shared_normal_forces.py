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


def random_table(seed, spread):
    """Four to six legs on an ellipse, and a center of mass within `spread`."""
    chance = np.random.default_rng(seed)
    angles = np.sort(chance.uniform(0.0, 2.0 * np.pi, chance.integers(4, 7)))
    legs = np.round(np.column_stack([0.5 * np.cos(angles), 0.4 * np.sin(angles)]), 3)
    center = np.round([*chance.uniform(-spread, spread, 2), chance.uniform(0.02, 0.2)], 3)
    friction = float(np.round(chance.uniform(0.1, 0.4), 2))
    velocity = np.round([*chance.uniform(-2.0, 2.0, 2), chance.uniform(-3.0, 3.0)], 2)
    return legs, center, friction, velocity


def test_a_table_slides_on_its_legs_as_on_equal_elastic_ones_whatever_their_order():
    """Forces of some three of the legs would turn it otherwise: by 9 % after 0.2 s. One leg is unloaded."""
    legs, center, friction, velocity = random_table(32, 0.22)
    order = np.random.default_rng(1).permutation(len(legs))
    simulation = Simulation.from_text(table(legs, center, friction, velocity, order), method="tsitouras8")
    simulation.run(until=TIME)
    assert plane_state(simulation) == pytest.approx(reference(legs, center, friction, velocity), abs=1e-11)
    forces = np.array([state.normal for state in simulation.contacts().values()])
    assert np.all(forces >= 0.0) and forces.sum() == pytest.approx(MASS * G, rel=1e-12)
    assert np.any(forces == 0.0)


def test_a_table_presses_equally_on_four_legs_and_rebounds_from_all_at_once_whatever_their_order():
    legs, center = np.array([[0.5, 0.3], [-0.5, 0.3], [-0.5, -0.3], [0.5, -0.3]]), (0.0, 0.0, 0.05)
    text = table(legs, center, 0.3, (0.0, 0.0, 0.0), (3, 1, 0, 2), ", restitution: 0.3")
    simulation = Simulation.from_text(text, method="tsitouras8")
    states = simulation.contacts().values()
    assert [state.normal for state in states] == pytest.approx([MASS * G / 4.0] * 4, rel=1e-12)
    assert "statically indeterminate" in " ".join(simulation.remarks)
    simulation.reset(q=[0, 0, 0.05, 1, 0, 0, 0])
    simulation.run(until=TIME)
    fall = np.sqrt(2.0 * 0.05 / G)
    rebound = 0.3 * G * fall - G * (simulation.time - fall)
    assert simulation.u == pytest.approx([0, 0, rebound, 0, 0, 0], abs=1e-11)
