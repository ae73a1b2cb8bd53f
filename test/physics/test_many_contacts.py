"""Many contacts at once: an arch, a grasped block, a heap. They rest without creep, and move as they must."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from mbd_sim import Simulation

G = 9.81


def arch_can_stand(n, thickness, friction):
    """Whether forces at the ends of all joints can balance the weights of n voussoirs of unit mean radius (Heyman).

    Unknown are the pressure and the friction at the inner and the outer end of each joint.
    """
    radii, step = (1.0 - thickness / 2.0, 1.0 + thickness / 2.0), math.pi / n
    weight = 0.5 * (radii[1] ** 2 - radii[0] ** 2) * math.sin(step)  # of the difference of two triangles
    center = (radii[1] ** 3 - radii[0] ** 3) * math.sin(step) * math.cos(step / 2.0) / 3.0 / weight
    balances, loads, limits = [], [], []
    for k in range(n):
        rows = np.zeros((3, 4 * (n + 1)))
        for joint, sign in ((k, 1.0), (k + 1, -1.0)):
            out = np.array([math.cos(joint * step), math.sin(joint * step)])
            for end, radius in enumerate(radii):
                for column, force in enumerate((sign * np.array([-out[1], out[0]]), sign * out)):
                    moment = radius * (out[0] * force[1] - out[1] * force[0])
                    rows[:, 4 * joint + 2 * end + column] = [*force, moment]
        balances.append(rows)
        loads += [0.0, weight, weight * center * math.cos((k + 0.5) * step)]
    for pressure in range(0, 4 * (n + 1), 2):
        for sign in (1.0, -1.0):
            row = np.zeros(4 * (n + 1))
            row[pressure], row[pressure + 1] = -friction, sign
            limits.append(row)
    bounds = [(0.0, None), (None, None)] * (2 * (n + 1))
    found = linprog(np.zeros(4 * (n + 1)), np.array(limits), np.zeros(len(limits)), np.vstack(balances), loads, bounds)
    return bool(found.status == 0)


def least_thickness(n):
    low, high = 0.02, 0.2
    for _ in range(16):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if arch_can_stand(n, middle, 1.0) else (middle, high)
    return high


def test_the_least_thickness_of_an_arch_of_many_voussoirs_is_that_of_milankovitch():
    assert least_thickness(60) == pytest.approx(0.1075, abs=1e-4)


def test_an_arch_stands_above_its_least_thickness_and_falls_below_it():
    least = least_thickness(4)
    standing = Simulation.from_file("arch", method="tsitouras8", parameters={"n": 4, "t": 1.01 * least})
    start, states = standing.q.copy(), standing.contacts()
    assert min(state.normal for state in states.values()) > -1e-9
    area = 4 * math.sin(math.pi / 4) / 2 * ((1.0 + 0.505 * least) ** 2 - (1.0 - 0.505 * least) ** 2)
    carried = sum(state.force[2] for name, state in states.items() if "ground" in name)
    assert carried == pytest.approx(2000 * 0.2 * area * G, rel=1e-9)
    standing.run(until=0.5)
    assert np.max(np.abs(standing.q - start)) < 1e-14
    assert abs(standing.energies.residual) < 1e-12
    falling = Simulation.from_file("arch", method="tsitouras8", parameters={"n": 4, "t": 0.99 * least})
    falling.run(until=0.5)
    crown = 3 * 1 + 1  # the height of the second voussoir, of which the axis points downward
    assert falling.q[crown] > 1e-3
    assert abs(falling.energies.residual) < 1e-10


@pytest.fixture(scope="module")
def grasp():
    return Simulation.from_file("grasp", live=["F"], step=0.7e-3)


@pytest.mark.parametrize("force", [9.811, 9.8])
def test_a_grasped_block_is_held_or_slips_as_coulomb_says(grasp, force):
    simulation = grasp
    simulation.reset()
    simulation.set_live({"F": force})
    simulation.run(until=0.2)
    slip = max(0.0, G - 2.0 * 0.5 * force) * simulation.time**2 / 2.0
    assert simulation.q[3] == pytest.approx(slip, abs=1e-15, rel=1e-10)
    assert sum(state.normal for state in simulation.contacts().values()) == pytest.approx(2.0 * force, rel=1e-10)
    if not slip:
        assert any("statically indeterminate" in remark for remark in simulation.remarks)


def test_a_block_that_slips_out_between_two_fingers_leaves_them_without_a_turn(grasp):
    """The area in which they touch shrinks to a line: rows of points that coincide gave 7e4 J at that instant."""
    simulation = grasp
    for force in (1.0, 3.0, 5.0, 8.0, 9.0, 9.5):
        simulation.reset()
        simulation.set_live({"F": force})
        slip = G - 2.0 * 0.5 * force  # m/s²
        apart = math.sqrt(2.0 * 0.09 / slip)  # s, after half the heights of the finger and of the block
        simulation.run(until=apart + 0.2)
        time = simulation.time - apart
        block, finger = 0.09 + slip * apart * time + 0.5 * G * time**2, -0.04 + 0.5 * force / 0.2 * time**2
        assert simulation.q == pytest.approx([finger, finger, 0.0, block, 0.0], abs=1e-7)
        assert abs(simulation.energies.residual) < 1e-11


GRIP = """
mechanism: grip
parameters: {F: 8 N}
parts:
  left: {shape: {type: block, mass: 0.2, size: [0.02, 0.05, 0.06]}}
  right: {shape: {type: block, mass: 0.2, size: [0.02, 0.05, 0.06]}}
  block: {shape: {type: block, mass: 1, size: [0.08, 0.07, 0.12]}}
joints:
  left: {type: prismatic, between: [ground, left], axis: [1, 0, 0], position: -0.05}
  right: {type: prismatic, between: [ground, right], axis: [-1, 0, 0], position: -0.05}
  block: {type: free, between: [ground, block]}
forces:
  press_left: {type: force, at: left, vector: [F, 0, 0]}
  press_right: {type: force, at: right, vector: [-F, 0, 0]}
contacts:
  left: {between: [left, block], friction: 0.4}
  right: {between: [right, block], friction: 0.4}
"""


def test_random_blocks_that_slip_and_turn_out_of_a_grip_gain_nothing():
    """Areas with three to eight corners shrink to a line or a point: two of the corners meet, or all of them do."""
    simulation = Simulation.from_text(GRIP, live=["F"], method="tsitouras8")
    for seed in range(5):
        rng = np.random.default_rng(seed)
        simulation.reset()
        simulation.set_live({"F": rng.uniform(1.0, 11.5)})
        places = {"block.rx": rng.uniform(-3.0, 3.0), "block.z": -0.07, "block.y": rng.uniform(-0.04, 0.04)}
        speeds = {"block.rx": rng.uniform(-4.0, 4.0), "block.z": -0.8, "block.y": rng.uniform(-0.3, 0.3)}
        simulation.set_state(places, speeds)
        simulation.run(until=0.15)
        assert not any(contact.normal for contact in simulation.contacts().values())
        assert abs(simulation.energies.residual) < 1e-9
        assert simulation.u[-2:] == pytest.approx([0.0, 0.0], abs=1e-3)  # no turn about the other axes


def test_a_heap_comes_to_rest_without_penetration():
    heap = Simulation.from_file("heap", parameters={"n": 4}, step=2e-3)
    heap.run(until=0.8)
    assert heap.model.method_name == "moreau"
    places = heap.q.reshape(-1, 3)[:, :2]
    apart = [math.dist(a, b) for i, a in enumerate(places) for b in places[:i]]
    assert min(apart) > 0.1 - 1e-5
    assert abs(heap.energies.residual) < 0.05 * heap.energies.dissipated
    floor = sum(abs(s.normal) for name, s in heap.contacts().items() if name.startswith("floor"))
    assert floor <= 4 * 0.5 * G * 1.01
    assert np.max(np.abs(heap.u)) < 0.1


def test_normal_forces_that_equilibrium_leaves_open_are_remarked_on():
    table = """
mechanism: table
parts:
  table:
    shape: {type: block, mass: 1, size: [0.4, 0.1, 0.1]}
    points: {a: [-0.2, 0, -0.05], b: [0.1, 0, -0.05], c: [0.2, 0, -0.05]}
joints:
  table: {type: planar, between: [ground, table], axis: [0, 1, 0], x_axis: [1, 0, 0], position: [0, -0.05, 0]}
constraints:
  a: {type: on_plane, point: table.a, bound: at_least}
  b: {type: on_plane, point: table.b, bound: at_least}
  c: {type: on_plane, point: table.c, bound: at_least}
"""
    (remark,) = [text for text in Simulation.from_text(table).remarks if "indeterminate" in text]
    assert remark.startswith("the normal forces of 'a', 'b', 'c' are statically indeterminate")
