"""Contacts that share a load: they slip when it exceeds the sum of what they can hold, and not earlier."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation
from mbd_sim.simulation.contact.records import ContactChange

G, MASS, RATE = 9.81, 2.0, 60.0  # a push of 60 N/s
UNTIL = 0.12  # s; it slips at 0.1 s


def pads(friction, static, count, height):
    """A block on pads in a line, which is pushed at a height above their plane with a force that grows."""
    places = np.linspace(-0.2, 0.2, count)
    points = ", ".join(f"p{number}: [{x}, 0, -0.1]" for number, x in enumerate(places))
    law = f"bound: at_least, friction: {friction}, static_friction: {static}"
    return Simulation.from_text(
        f"""
mechanism: pads
parts: {{block: {{mass: {MASS}, inertia: [0.1, 0.1, 0.1], points: {{{points}, push: [0, 0, {height - 0.1}]}}}}}}
joints: {{f: {{type: planar, axis: [0, 1, 0], x_axis: [1, 0, 0], between: [ground, block], position: [0, -0.1, 0]}}}}
constraints: {{{", ".join(f"c{i}: {{type: on_plane, point: block.p{i}, {law}}}" for i in range(count))}}}
forces: {{push: {{type: force, at: block.push, vector: ["{RATE}*t", 0, 0]}}}}
""",
        method="tsitouras8",
    )


def slipping(friction, static, time):
    """The time at which the blocks begin to slip, and their speed later."""
    start = static * MASS * G / RATE
    return start, (0.5 * RATE * (time**2 - start**2) - friction * MASS * G * (time - start)) / MASS


@pytest.mark.parametrize(
    ("friction", "static", "count", "height"),
    [(0.2, 0.3, 2, 0.1), (0.0, 0.3, 3, 0.15)],
)
def test_pads_in_a_line_slip_at_the_sum_of_their_limits(friction, static, count, height):
    simulation = pads(friction, static, count, height)
    simulation.run(until=UNTIL)
    start, speed = slipping(friction, static, UNTIL)
    slips = [event.time for event in simulation.contact_events if event.change is ContactChange.SLIDES]
    assert slips == pytest.approx([start] * len(slips), abs=1e-10) and len(slips) >= 2
    assert simulation.u[0] == pytest.approx(speed, abs=1e-10)
    assert abs(simulation.energies.residual) < 1e-13


def test_shared_friction_at_rest_stays_within_each_limit():
    simulation = pads(0.2, 0.3, 2, 0.1)
    while simulation.time < 0.095:
        simulation.step(5)
        states = simulation.contacts()
        assert sum(state.friction[0] for state in states.values()) == pytest.approx(-RATE * simulation.time, abs=1e-12)
        assert all(abs(state.friction[0]) <= 0.3 * state.normal * (1.0 + 1e-9) for state in states.values())
        assert abs(simulation.q[0]) < 1e-18


def test_friction_by_a_force_that_redundant_joints_share_is_remarked():
    """A door on two hinges; with one alone its force is determined."""
    text = """
mechanism: door
ground: {points: {top: [0, 0, 2]}}
parts: {door: {mass: 20, center: [0.4, 0, 1], inertia: [2, 2.5, 0.5], points: {top: [0, 0, 2]}}}
joints:
  low: {type: revolute, between: [ground, door], axis: [0, 0, 1], velocity: 1, friction: {coefficient: 0.2, radius: 0.01}}
"""
    hinge = "  high: {type: revolute, between: [ground.top, door.top], axis: [0, 0, 1]}\n"
    (remark,) = Simulation.from_text(text + hinge, method="tsitouras8").remarks
    assert remark.startswith("friction of 'low' depends on forces that redundant joints share")
    determined = Simulation.from_text(text, method="tsitouras8")
    assert determined.remarks == ()
    moment = 0.2 * 0.01 * np.linalg.norm(determined.reactions()["low"].force)
    assert determined.contacts()["low.friction"].friction == pytest.approx([-moment], rel=1e-12)


def least_margin(legs, normals, force, place):
    """The least power of friction less that of the push over all plane motions: negative where a table slips."""

    def margin(angles):
        along, up = angles
        velocity = np.array([np.cos(along), np.sin(along)]) * np.cos(up)
        turning = np.sin(up) / 0.3
        slips = velocity + turning * np.column_stack([-legs[:, 1], legs[:, 0]])
        push = velocity + turning * np.array([-place[1], place[0]])
        return 0.3 * normals @ np.linalg.norm(slips, axis=1) - force @ push

    grid = [(along, up) for along in np.linspace(0.0, 2.0 * np.pi, 13) for up in np.linspace(-1.5, 1.5, 7)]
    tight = {"xatol": 1e-11, "fatol": 1e-15, "maxiter": 2000}
    return minimize(margin, min(grid, key=margin), method="Nelder-Mead", options=tight).fun


def pushed_table(legs, push, place, height, turn, order):
    """A table on point legs, pushed with a force that grows, in axes that are turned by a matrix (3, 3)."""

    def written(vector):
        return [float(value) for value in turn @ np.array(vector)]

    inertia = turn @ np.diag([0.1, 0.12, 0.15]) @ turn.T
    parts = ", ".join(
        f"{'xyz'[i]}{'xyz'[j]}: {inertia[i, j]}" for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    )
    points = ", ".join(f"p{number}: {written([*legs[number], -0.3])}" for number in order)
    law = f"plane: ground, normal: {written([0, 0, 1])}, bound: at_least, friction: 0.2, static_friction: 0.3"
    rows = "\n".join(f"  c{number}: {{type: on_plane, point: top.p{number}, {law}}}" for number in order)
    vector = [f"{value}*t" for value in written([*(RATE * push), 0])]
    return Simulation.from_text(
        f"""
mechanism: table
gravity: {written([0, 0, -G])}
parts: {{top: {{mass: {MASS}, inertia: {{{parts}}}, points: {{{points}, push: {written([*place, height - 0.3])}}}}}}}
joints: {{f: {{type: free, between: [ground, top], position: {written([0, 0, 0.3])}}}}}
constraints:
{rows}
forces: {{push: {{type: force, at: top.push, vector: {vector}}}}}
""",
        method="tsitouras8",
    )


def time_of_slip(simulation):
    """The time at which the legs begin to slip."""
    while not (slips := [event for event in simulation.contact_events if event.change is ContactChange.SLIDES]):
        simulation.step(5)
    return slips[0].time


def test_a_table_pushed_off_its_center_slips_at_its_limit_load_in_any_order_and_axes():
    """The limit load is the least over all motions, as of plastic bodies; friction depended on the order of the legs."""
    seed, count = 7, 3
    chance = np.random.default_rng(seed)
    angles = 2.0 * np.pi * (np.arange(count) + chance.uniform(-0.3, 0.3, count)) / count
    legs = 0.4 * chance.uniform(0.6, 1.0, (count, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
    direction, place, height = chance.uniform(0.0, 6.28), chance.uniform(-0.3, 0.3, 2), chance.uniform(0.05, 0.15)
    push = np.array([np.cos(direction), np.sin(direction)])
    turn = Rotation.random(random_state=seed).as_matrix()
    slip = time_of_slip(pushed_table(legs, push, place, height, turn, chance.permutation(count)))
    normals = least_normals(legs, RATE * slip * push * height)
    for time, sign in ((slip * (1.0 - 1e-5), 1.0), (slip * (1.0 + 1e-5), -1.0)):
        assert sign * least_margin(legs, normals, RATE * time * push, place) > 0.0


def least_normals(legs, moment):
    """The normal forces of least sum of squares under the weight and the moment of a push above the floor."""
    wrenches = np.column_stack([np.ones(len(legs)), legs]).T
    forces = np.linalg.lstsq(wrenches, np.array([MASS * G, *moment]), rcond=None)[0]
    assert forces.min() > 0.0
    return forces
