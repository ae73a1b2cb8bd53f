"""A body in a groove that friction wedges: its normal forces depend on friction at rest, and must not depend on order.

Forces of equal elastic supports are found apart from the engine: each support yields in proportion to its normal force,
and along the groove up to the limit of friction.
"""

import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation

G, MASS = 9.81, 2.0


class Groove:
    """A body on random points of two inclined planes, pushed with a force that grows."""

    def __init__(self, seed):
        chance = np.random.default_rng(seed)
        self.count = int(chance.integers(4, 7))
        side = np.where(np.arange(self.count) % 2, 1, -1)
        along = chance.uniform(-0.3, 0.3, (self.count, 3))[:, 0]
        self.points = np.column_stack([along, side * chance.uniform(0.1, 0.3, self.count), np.full(self.count, -0.1)])
        angles = chance.uniform(0.4, 1.1, 2)[(side + 1) // 2]
        self.normals = np.column_stack([0.1 * chance.normal(size=self.count), -side * np.sin(angles), np.cos(angles)])
        self.normals /= np.linalg.norm(self.normals, axis=1)[:, None]
        self.friction = chance.uniform(0.2, 0.6, self.count)
        self.push, self.place = 12.0 * chance.normal(size=3), chance.uniform(-0.2, 0.2, 3)

    def simulation(self, turn, order, unit):
        """With turned axes (3, 3), in an order of the contacts, with another unit of length."""

        def written(vector, factor=1.0):
            return [float(value) for value in factor * turn @ np.array(vector)]

        inertia = unit**2 * turn @ np.diag([0.1, 0.12, 0.15]) @ turn.T
        products = ", ".join(
            f"{'xyz'[i]}{'xyz'[j]}: {inertia[i, j]}" for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        )
        points = ", ".join(f"p{index}: {written(self.points[index], unit)}" for index in order)
        rows = "\n".join(
            f"  c{index}: {{type: on_plane, point: body.p{index}, plane: ground.p{index}, bound: at_least, "
            f"normal: {written(self.normals[index])}, friction: {self.friction[index]}}}"
            for index in order
        )
        push = [f"{value}*t" for value in written(self.push, unit)]
        return Simulation.from_text(
            f"""
mechanism: groove
gravity: {written([0, 0, -G], unit)}
ground: {{points: {{{points}}}}}
parts: {{body: {{mass: {MASS}, inertia: {{{products}}}, points: {{{points}, push: {written(self.place, unit)}}}}}}}
joints: {{f: {{type: free, between: [ground, body]}}}}
constraints:
{rows}
forces: {{push: {{type: force, at: body.push, vector: {push}}}}}
""",
            method="tsitouras8",
        )

    def elastic_normals(self):
        """The normal forces at the start, by a general solver for the displacement of the body."""

        def forces(move):
            yielding = -(move[:3] + np.cross(move[3:], self.points))
            normal = np.maximum(np.sum(yielding * self.normals, axis=1), 0.0)
            across = yielding - np.sum(yielding * self.normals, axis=1)[:, None] * self.normals
            size = np.maximum(np.linalg.norm(across, axis=1), 1e-300)
            share = np.minimum(1.0, self.friction * normal / size)
            return normal, normal[:, None] * self.normals + share[:, None] * across

        def unbalanced(move):
            given = forces(move)[1]
            return [*(given.sum(axis=0) - [0, 0, MASS * G]), *np.cross(self.points, given).sum(axis=0)]

        found = root(unbalanced, [0, 0, -MASS * G / self.count, 0, 0, 0], method="lm", options={"xtol": 1e-13})
        assert np.max(np.abs(unbalanced(found.x))) < 1e-9
        return forces(found.x)[0]


def forces_at(simulation, times, count):
    """The sizes (times, contacts, 2) of normal forces and of friction."""
    found = []
    for time in times:
        simulation.run(until=time)
        states = [simulation.contacts()[f"c{index}"] for index in range(count)]
        found.append([(state.normal, np.linalg.norm(state.friction)) for state in states])
    return np.array(found)


def test_forces_in_a_groove_are_those_of_elastic_supports_in_any_order_axes_and_units():
    """They differed by up to 6 N of 20 N between two orders of the list."""
    seed = 6
    groove, times = Groove(seed), (0.0, 0.02, 0.06)
    first = groove.simulation(np.eye(3), range(groove.count), 1.0)
    expected = forces_at(first, times, groove.count)
    assert expected[0, :, 0] == pytest.approx(groove.elastic_normals(), abs=1e-6)
    assert abs(first.energies.residual) < 1e-13
    order = np.random.default_rng(seed).permutation(groove.count)
    other = groove.simulation(Rotation.random(random_state=seed).as_matrix(), order, 1e-3)
    assert 1e3 * forces_at(other, times, groove.count) == pytest.approx(expected, abs=1e-6)
