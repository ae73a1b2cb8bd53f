"""Slip whose direction friction turns fast, beside SciPy's integrator of stiff equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mbd_sim import Simulation
from mbd_sim.simulation.contact.compiled import collocation, slip
from mbd_sim.simulation.contact.records import ContactChange

BEGINS, ENDS = 0.05, 0.09  # s
BRIEF = 1e-7  # s, after which the comparison starts
# A point on the floor, with different masses along x and y, is dragged by a force that turns and exceeds friction from
# `BEGINS` on.
DRAGGED = f"""
mechanism: dragged
parameters: {{mu: 0.3, mx: 1, my: 1, growth: 2, turning: 3, damping: 0}}
parts:
  a: {{mass: mx, inertia: [1, 1, 1]}}
  b: {{mass: my, inertia: [1, 1, 1]}}
  c: {{shape: {{type: particle, mass: 2}}}}
joints:
  x: {{type: prismatic, between: [ground, a], axis: [1, 0, 0], damping: damping}}
  y: {{type: prismatic, between: [a, b], axis: [0, 1, 0], damping: damping}}
  z: {{type: prismatic, between: [b, c], axis: [0, 0, 1]}}
constraints: {{floor: {{type: on_plane, point: c, bound: at_least, friction: mu}}}}
forces:
  fx: {{type: effort, coordinate: x, effort: mu*2*9.81*(1 + growth*(t - {BEGINS}))*cos(turning*t)}}
  fy: {{type: effort, coordinate: y, effort: mu*2*9.81*(1 + growth*(t - {BEGINS}))*sin(turning*t)}}
"""


def dragged(mu, mx, my, growth, turning, damping):
    """The place (2,) and the velocity (2,) at the end: from a short while after the beginning, where they are known."""
    masses, friction = np.array([mx + my + 2.0, my + 2.0]), mu * 2.0 * 9.81

    def rates(t, state):
        v = state[2:]
        force = friction * (1.0 + growth * (t - BEGINS)) * np.array([np.cos(turning * t), np.sin(turning * t)])
        return np.concatenate([v, (force - friction * v / np.hypot(*v) - damping * v) / masses])

    along = np.array([np.cos(turning * BEGINS), np.sin(turning * BEGINS)])
    start = [0.0, 0.0, *(0.5 * BRIEF**2 * friction * growth / (along @ (masses * along)) * along)]
    return solve_ivp(rates, (BEGINS + BRIEF, ENDS), start, method="Radau", rtol=1e-11, atol=1e-17).y[:, -1]


@pytest.fixture(scope="module")
def simulation():
    return Simulation.from_text(DRAGGED, step=2e-3, live=["parameters.*"])


@pytest.mark.parametrize("seed", (1, 2))
def test_slip_follows_a_force_that_turns(simulation, seed):
    """It begins, and where it is damped, it stays so slow that friction turns it within a hundredth of a step.

    Friction along the slip at the end of each part of a step has errors of 1e-8.
    """
    rng = np.random.default_rng(seed)
    bounds = {"mu": (0.1, 0.8), "mx": (0.1, 5.0), "my": (0.1, 5.0), "growth": (0.5, 10.0), "turning": (-10.0, 10.0)}
    values = {name: rng.uniform(*each) for name, each in bounds.items()}
    values["damping"] = (seed % 2) * 500.0
    simulation.set_live({f"parameters.{name}": value for name, value in values.items()})
    simulation.reset()
    simulation.run(until=ENDS)
    expected = dragged(**values)
    assert simulation.q[:2] == pytest.approx(expected[:2], abs=1e-9)
    assert simulation.u[:2] == pytest.approx(expected[2:], abs=1e-9)
    assert abs(simulation.energies.residual) < 1e-11


SPEED, STEEP = 1e-3, 2500.0  # m/s of what slides, and 1/s
# What slides is pulled across its slip, by a force that jumps; the ebb of a force takes away what
# pushes the other point from 4 ms on, at first beyond what friction can bear.
JUMPS = f"""
mechanism: jumps
parameters: {{mu: 0.3}}
parts:
  a: {{mass: 0.5, inertia: [1, 1, 1]}}
  b: {{mass: 0.25, inertia: [1, 1, 1]}}
  c: {{shape: {{type: particle, mass: 2}}}}
  d: {{mass: 0.5, inertia: [1, 1, 1]}}
  e: {{mass: 0.25, inertia: [1, 1, 1]}}
  f: {{shape: {{type: particle, mass: 2}}}}
joints:
  ax: {{type: prismatic, between: [ground, a], axis: [1, 0, 0], velocity: {SPEED}}}
  ay: {{type: prismatic, between: [a, b], axis: [0, 1, 0]}}
  az: {{type: prismatic, between: [b, c], axis: [0, 0, 1]}}
  dx: {{type: prismatic, between: [ground, d], axis: [1, 0, 0]}}
  dy: {{type: prismatic, between: [d, e], axis: [0, 1, 0]}}
  dz: {{type: prismatic, between: [e, f], axis: [0, 0, 1]}}
constraints:
  one: {{type: on_plane, point: c, bound: at_least, friction: mu}}
  other: {{type: on_plane, point: f, bound: at_least, friction: mu}}
forces:
  drive: {{type: effort, coordinate: ax, effort: 1.01*mu*2*9.81}}
  jump: {{type: effort, coordinate: ay, effort: "where(t < 0.0035, 0.3, -0.3)"}}
  ebb: {{type: effort, coordinate: dx, effort: "-mu*2*9.81*min(1.05, max(0, {STEEP}*(t - 0.004)))"}}
"""
# Two points on a carriage, which both slide.
TWO = """
mechanism: two
parts:
  a: {mass: 0.5, inertia: [1, 1, 1]}
  b: {mass: 0.25, inertia: [1, 1, 1]}
  c: {shape: {type: particle, mass: 2}}
  d: {mass: 0.25, inertia: [1, 1, 1]}
  e: {shape: {type: particle, mass: 1}}
joints:
  x: {type: prismatic, between: [ground, a], axis: [1, 0, 0], velocity: 2e-3}
  y1: {type: prismatic, between: [a, b], axis: [0, 1, 0], velocity: 1e-3}
  z1: {type: prismatic, between: [b, c], axis: [0, 0, 1]}
  y2: {type: prismatic, between: [a, d], axis: [0, 1, 0], velocity: -2e-3}
  z2: {type: prismatic, between: [d, e], axis: [0, 0, 1]}
constraints:
  one: {type: on_plane, point: c, bound: at_least, friction: 0.3}
  other: {type: on_plane, point: e, bound: at_least, friction: 0.4}
forces:
  fx: {type: effort, coordinate: x, effort: 9 + t}
  f1: {type: effort, coordinate: y1, effort: 3}
  f2: {type: effort, coordinate: y2, effort: -2*cos(t)}
"""


STILL = JUMPS.replace(f"velocity: {SPEED}", "velocity: 0").replace("1.01*mu", "0.9*mu")
DELAYED = f"{STILL}actuators: {{push: {{type: effort, joint: dx, delay: 2 ms}}}}\n"


@pytest.mark.parametrize("text", [JUMPS, STILL, DELAYED], ids=["another slides", "nothing slides", "delayed"])
def test_friction_that_a_jump_of_a_force_overloads_for_a_moment_slips(text):
    """Within less than the first node of the motion of what slides elsewhere; it stops within the same part.

    Where nothing slides, both ends of the step were admissible, and the slip was missed. A delayed command jumps within
    a call of several steps.
    """
    simulation, push = Simulation.from_text(text, step=1e-3), 1.05 * 0.3 * 2.0 * 9.81
    simulation.run(until=2e-3 if text is DELAYED else 4e-3)
    if text is DELAYED:
        simulation.set_commands({"push": push})
    else:
        simulation.set_efforts({"dx": push})
    simulation.run(until=6e-3)
    of_other = [event for event in simulation.contact_events if "other" in event.name]
    assert [event.change for event in of_other] == [ContactChange.SLIDES, ContactChange.STICKS]
    slid, stuck = (event.time for event in of_other)
    assert slid == pytest.approx(4e-3, abs=1e-12)
    assert stuck == pytest.approx(4e-3 + 0.05 * 2.0 / STEEP, abs=1e-10)
    acceleration, end = 0.3 * 2.0 * 9.81 / 2.75, 0.05 * 2.0 / STEEP
    assert simulation.q[3] == pytest.approx(acceleration * (0.025 * end**2 - STEEP * end**3 / 6.0), abs=1e-15)


def test_elements_corrected_one_by_one_and_together_have_the_same_motion(monkeypatch):
    """As many of them are."""

    def end(together):
        monkeypatch.setattr(collocation, "MOST_TOGETHER", together)
        simulation = Simulation.from_text(TWO, step=1e-3)
        simulation.step(1)
        c, (t, y, inputs) = simulation._memory.stepper._contacts._contacts, simulation._memory.now
        y, inputs, found = np.array(y), np.array(inputs), np.zeros(3)
        slip.stage(c, y, inputs, t, 5e-4, np.inf, np.zeros(c.guards, dtype=np.int64), found)
        assert found[0] > 1e-5
        return y, found[0]

    (one, length), (other, same) = end(32), end(1)
    assert length == same
    assert one == pytest.approx(other, abs=1e-11)
    assert not np.array_equal(one, other)


def test_a_motion_takes_few_sweeps(monkeypatch):
    """With slips that are read before a sweep and not after it, directions lag behind the slopes: it takes five."""
    simulation, sweep, changes = Simulation.from_text(TWO, step=1e-3), collocation.sweep, []
    simulation.step(1)
    monkeypatch.setattr(collocation, "sweep", lambda *arguments: changes.append(sweep(*arguments)) or changes[-1])
    c, (t, y, inputs) = simulation._memory.stepper._contacts._contacts, simulation._memory.now
    found = np.zeros(3)
    slip.stage(c, np.array(y), np.array(inputs), t, 1e-3, np.inf, np.zeros(c.guards, dtype=np.int64), found)
    assert found[0] == 1e-3
    assert len(changes) == 4
