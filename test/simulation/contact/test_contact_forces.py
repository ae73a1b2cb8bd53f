"""The points and forces of contacts: they balance weight and acceleration, and lie where the parts touch."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.files.checks.override import with_values

G = np.array([0.0, 0.0, -9.81])

PARTICLE = """
mechanism: rest
parts: {ball: {shape: {type: sphere, mass: 2, radius: 0.01}}}
ground: {points: {hook: [0.1, 0.2, 1.0], base: [0.1, 0.2, 0]}}
joints: {ball: {type: free, between: [ground, ball], position: [0.1, 0.2, 0]}}
constraints:
  contact: {%s}
"""


def test_the_force_on_a_sliding_ball_is_its_rate_of_momentum():
    sim = Simulation(with_values(load_mechanism("spinning_ball"), {"eN": 0}), method="tsitouras8")
    sim.run(0.5)
    contact, before, start = sim.contacts()["floor"], sim.u.copy(), sim.time
    assert contact.state == "slides"
    sim.run(0.52)
    floor = sim.contacts()["floor"]
    assert floor.state == "slides"
    rate = (sim.u - before) / (sim.time - start)  # constant while it slides; u is along x, -z, and about y
    acceleration = np.array([rate[0], 0.0, -rate[1]])
    for state in (contact, floor):
        np.testing.assert_allclose(state.force + 1.0 * G, 1.0 * acceleration, rtol=0, atol=1e-12)
        np.testing.assert_allclose(abs(state.force[0]), 0.2 * 9.81, rtol=0, atol=1e-12)
    moment = np.cross(floor.point - sim.poses()["ball"].position, floor.force)
    np.testing.assert_allclose(moment, [0.0, 0.4 * 0.1**2 * rate[2], 0.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "constraint",
    [
        "type: on_plane, point: ball, bound: at_least, plane: ground.base, normal: [0.3, -0.2, 1], friction: 0.9",
        "type: on_surface, point: ball, bound: at_least, equation: 3*z, friction: 0.5",
        "type: distance, between: [ball, ground.hook], length: 1, bound: at_most",
        "type: cable, through: [ground, ground.hook, ball], length: 1 + sqrt(1.05), bound: at_most",
    ],
)
def test_the_force_on_a_body_at_rest_carries_its_weight_at_the_contact(constraint):
    sim = Simulation.from_text(PARTICLE % constraint, method="tsitouras8")
    for _ in range(2):
        (contact,) = sim.contacts().values()
        assert contact.state in ("closed", "sticks")
        np.testing.assert_allclose(contact.force, -2.0 * G, rtol=0, atol=1e-12)
        np.testing.assert_allclose(contact.point, [0.1, 0.2, 0.0], rtol=0, atol=1e-12)
        sim.run(0.1)


def test_the_force_of_a_strut_pushes():
    text = PARTICLE.replace("hook: [0.1, 0.2, 1.0]", "hook: [0.1, 0.2, -1.0]")
    strut = "type: distance, between: [ground.hook, ball], length: 1, bound: at_least"
    (contact,) = Simulation.from_text(text % strut, method="tsitouras8").contacts().values()
    np.testing.assert_allclose(contact.force, -2.0 * G, rtol=0, atol=1e-12)


def test_friction_in_two_directions_opposes_the_slip():
    sim = Simulation.from_text(
        """
mechanism: puck
parts: {ball: {shape: {type: sphere, mass: 2, radius: 0.1}}}
joints: {ball: {type: free, between: [ground, ball], position: [0, 0, 0.1], velocity: [3, -4, 0]}}
constraints: {floor: {type: rolling, wheel: ball, radius: 0.1, friction: 0.1}}
""",
        method="tsitouras8",
    )
    (contact,) = sim.contacts().values()
    assert contact.state == "slides"
    np.testing.assert_allclose(contact.force, 2 * 9.81 * np.array([-0.06, 0.08, 1.0]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(contact.point, np.zeros(3), rtol=0, atol=1e-15)


def test_without_contact_there_is_a_point_and_no_force_and_stops_have_neither():
    flying = Simulation.from_file("spinning_ball", method="tsitouras8").contacts()["floor"]
    np.testing.assert_allclose(flying.point, [-0.5, 0.0, 0.9], rtol=0, atol=1e-15)
    assert flying.force.tolist() == [0.0, 0.0, 0.0]
    stop = Simulation.from_file("stops", method="tsitouras8").contacts()
    assert [(state.point, state.force) for state in stop.values()] == [(None, None)] * 2


def test_the_forces_between_shapes_act_on_the_first_part():
    sim = Simulation.from_text(
        """
mechanism: column
parts: {low: {shape: {type: sphere, mass: 3, radius: 0.1}}, high: {shape: {type: sphere, mass: 2, radius: 0.1}}}
joints:
  low: {type: prismatic, between: [ground, low], axis: [0, 0, 1], position: 0.1}
  high: {type: prismatic, between: [ground, high], axis: [0, 0, 1], position: 0.3}
contacts:
  floor: {parts: [low], plane: ground, friction: 0.5}
  pair: {between: [high, low]}
""",
        method="tsitouras8",
    )
    floor, pair = sim.contacts().values()
    np.testing.assert_allclose([floor.force, pair.force], [-5.0 * G, -2.0 * G], rtol=0, atol=1e-12)
    np.testing.assert_allclose([floor.point, pair.point], [[0, 0, 0], [0, 0, 0.2]], rtol=0, atol=1e-15)


SOFT_BALL = """
mechanism: soft_ball
parts: {ball: {shape: {type: sphere, mass: 2, radius: 0.1}}}
joints:
  ball: {type: planar, between: [ground, ball], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [0, 0.12, 0], velocity: [1, 0, 0]}
contacts: {floor: {parts: [ball], plane: ground, friction: 0.3, stiffness: 1e5, damping: 0.5}}
"""


def test_the_force_of_a_compliant_contact_is_the_rate_of_momentum_at_the_place_where_it_touches():
    sim = Simulation.from_text(SOFT_BALL, method="tsitouras8")
    model, touched = sim.model, 0
    assert model.contact_readings.placed == ((("contacts", "floor"), None),)
    for _ in range(40):
        sim.step(5)
        ((point, force, _),) = model.contact_readings.places(sim.time, sim.y, sim.inputs)
        x, z, _ = sim.u_rates
        assert force == pytest.approx([2.0 * x, 0.0, 2.0 * (z + 9.81)], abs=1e-11)
        assert point == pytest.approx([sim.q[0], 0.0, sim.q[1] - 0.1], abs=1e-15)
        touched += force[2] > 0.0
    assert 3 < touched < 40


def test_the_state_of_a_compliant_contact_follows_its_law():
    sim, seen = Simulation.from_text(SOFT_BALL, method="tsitouras8"), set()
    for _ in range(60):
        sim.step(5)
        (contact,) = sim.contacts().values()
        z, (vx, vz, spin) = sim.q[1], sim.u
        depth, slip = max(0.1 - z, 0.0), vx + 0.1 * spin
        normal = 1e5 * depth**1.5 * max(1.0 - 0.5 * vz, 0.0)
        friction = -0.3 * normal * slip / math.hypot(slip, 0.01)
        assert (contact.gap, contact.rate) == (pytest.approx(z - 0.1, abs=1e-15), pytest.approx(vz, abs=1e-15))
        assert contact.normal == pytest.approx(normal, rel=1e-12)
        assert contact.slip == pytest.approx([slip], abs=1e-14)
        assert contact.friction == pytest.approx([friction], abs=1e-12)
        assert contact.state == ("slides" if depth else "open")
        assert contact.force == pytest.approx([friction, 0.0, normal], abs=1e-12)
        seen.add(contact.state)
    assert seen == {"open", "slides"}
    assert sim.contact_events == ()  # it has no impacts and so no impulses


def test_compliant_contacts_come_after_rigid_ones_with_a_name_for_each_place():
    sim = Simulation.from_text(
        """
mechanism: compliant
parts:
  box: {shape: {type: block, mass: 3, size: [0.2, 0.2, 0.2]}}
  ball: {shape: {type: sphere, mass: 2, radius: 0.1}}
joints:
  box: {type: free, between: [ground, box], position: [0, 0, 0.099], velocity: [0.3, 0.4, 0]}
  ball: {type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: 0.1}
contacts:
  compliance: {parts: [box], plane: ground, friction: 0.5, stiffness: 1e4, exponent: 1}
  floor: {parts: [ball], plane: ground, restitution: 0.5}
""",
        method="tsitouras8",
    )
    contacts = sim.contacts()
    floor, *corners = contacts
    assert floor == "floor" and contacts["floor"].state == "closed"
    assert len(corners) == 8 and all(name.startswith("compliance.") for name in corners)
    pressed = [contacts[name] for name in corners if contacts[name].state == "slides"]
    assert [state.gap for state in pressed] == pytest.approx([-0.001] * 4, abs=1e-15)
    assert [state.normal for state in pressed] == pytest.approx([10.0] * 4, abs=1e-11)
    for state in pressed:  # along two directions
        assert math.hypot(*state.slip) == pytest.approx(0.5, abs=1e-14)
        assert state.force[2] == pytest.approx(10.0, abs=1e-11)
        assert state.force[:2] == pytest.approx([-3.0, -4.0], rel=1e-3)
    assert [contacts[name].gap for name in corners if contacts[name].state == "open"] == pytest.approx([0.199] * 4)


def test_without_friction_a_compliant_contact_is_closed_where_it_presses():
    sim = Simulation.from_text(SOFT_BALL.replace("friction: 0.3, ", ""), method="tsitouras8")
    sim.step(80)
    (contact,) = sim.contacts().values()
    assert (contact.state, len(contact.friction), len(contact.slip)) == ("closed", 0, 0)
    assert contact.normal > 50.0
