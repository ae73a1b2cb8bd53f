"""Contacts that hold a body together at the start, of which some suffice, until drives without jerk part them."""

import pytest

from mbd_sim import Simulation

G = 9.81
TABLE = """
mechanism: table
parts: {t: {mass: 1}, b: {mass: 2}}
joints:
  t: {type: prismatic, between: [ground, t], axis: [0, 0, 1], drive: "t**3"}
  b: {type: prismatic, between: [ground, b], axis: [0, 0, 1]}
constraints:
  FIRST: {type: coupling, terms: {b: 1}, bound: at_least}
  SECOND: {type: coupling, terms: {b: 1, t: -1}, bound: at_least}
"""
CLUTCHES = """
mechanism: belt
gravity: [0, 0, 0]
parts: {t: {mass: 1}, m: {mass: 2}}
joints:
  t: {type: prismatic, between: [ground, t], axis: [1, 0, 0], drive: "t**3"}
  m: {type: prismatic, between: [ground, m], axis: [1, 0, 0]}
constraints:
  FIRST: {type: clutch, terms: {m: 1}, capacity: 0.2*9.81}
  SECOND: {type: clutch, terms: {m: 1, t: -1}, capacity: 0.3*9.81}
"""
GUIDE = """
mechanism: belt
parts: {t: {mass: 1}, m: {mass: 2}}
joints:
  t: {type: prismatic, between: [ground, t], axis: [1, 0, 0], drive: "t**3"}
  m: {type: prismatic, between: [ground, m], axis: [1, 0, 0], friction: {coefficient: 0.2}}
constraints: {belt: {type: clutch, terms: {m: 1, t: -1}, capacity: 0.6*9.81}}
forces: {push: {type: effort, coordinate: m, effort: -1}}
"""
PADS = """
mechanism: belt
parts: {t: {mass: 1}, m: {mass: 2, inertia: [1, 1, 1], points: {l: [-0.2, 0, 0], r: [0.2, 0, 0]}}}
joints:
  t: {type: prismatic, between: [ground, t], axis: [1, 0, 0], drive: "t**3"}
  m: {type: free, between: [ground, m]}
constraints:
  FIRST: {type: on_plane, point: m.l, bound: at_least, friction: 0.2}
  SECOND: {type: on_plane, point: m.r, plane: t, bound: at_least, friction: 0.3}
"""


def ordered(text, reverse):
    """The mechanism with its two contacts in one of their orders."""
    *head, first, second = text.rstrip("\n").split("\n")
    lines = [second, first] if reverse else [first, second]
    return "\n".join([*head, *lines]).replace("FIRST", "a").replace("SECOND", "b")


@pytest.mark.parametrize("reverse", [False, True])
def test_a_body_on_the_floor_and_on_a_table_is_lifted_with_the_table(reverse):
    sim = Simulation.from_text(ordered(TABLE, reverse), method="tsitouras8")
    sim.run(until=0.6)
    contacts = sim.contacts()
    assert sim.q[0] == pytest.approx(0.6**3, abs=1e-14) and sim.u[0] == pytest.approx(3 * 0.6**2, abs=1e-14)
    assert [contacts[name].state for name in "ab"] == ["open", "closed"]
    assert contacts["b"].normal == pytest.approx(2.0 * (G + 6.0 * 0.6), rel=1e-13)


@pytest.mark.parametrize(("text", "reverse"), [(CLUTCHES, False), (CLUTCHES, True), (PADS, True)])
def test_a_body_on_the_floor_and_on_a_belt_moves_with_the_belt_until_it_slips(text, reverse):
    """The belt drags with up to 0.3 g, the floor brakes with 0.2 g, each with half of the weight of 2 kg."""
    sim = Simulation.from_text(ordered(text, reverse), method="tsitouras8")
    sim.run(until=0.3)
    acceleration = 0.1 * G / 2.0
    slips = acceleration / 6.0
    later = 0.3 - slips
    x, v = slips**3 + 3.0 * slips**2 * later + 0.5 * acceleration * later**2, 3.0 * slips**2 + acceleration * later
    assert (sim.q[0], sim.u[0]) == (pytest.approx(x, abs=1e-11), pytest.approx(v, abs=1e-11))
    event = sim.contact_events[-1]
    assert (event.name, event.change, event.time) == ("b", "slides", pytest.approx(slips, abs=1e-12))


def test_friction_by_the_load_of_a_joint_that_other_friction_replaces_acts_when_they_part():
    """A belt drags with up to 0.3 g; the guide brakes with 0.2 g, and an effort of 1 N pushes back."""
    sim = Simulation.from_text(GUIDE, method="tsitouras8")
    sim.run(until=0.1)
    acceleration = 0.1 * G - 0.5
    slips = acceleration / 6.0
    later = 0.1 - slips
    x, v = slips**3 + 3.0 * slips**2 * later + 0.5 * acceleration * later**2, 3.0 * slips**2 + acceleration * later
    assert (sim.q[0], sim.u[0]) == (pytest.approx(x, abs=1e-14), pytest.approx(v, abs=1e-14))
    assert [event.name for event in sim.contact_events] == ["m.friction", "belt"]
