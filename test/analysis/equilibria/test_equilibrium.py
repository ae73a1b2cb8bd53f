"""Equilibria: the start if it is one, else the nearest along a path, wherever and in whatever units it is."""

import math
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import assume, given, reject, settings

from mbd_sim import InputError, MechanismError, Simulation, parse_mechanism
from mbd_sim.analysis.equilibria import equilibrium
from mbd_sim.analysis.equilibria.equilibrium import equilibria, is_autonomous, nearest_equilibrium
from mbd_sim.analysis.equilibria.rest_balance import displacement_between
from mbd_sim.dynamics.constraints.assembly import close_loops
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.math.rank import null_space
from mbd_sim.files.load import load_mechanism
from mbd_sim.studies.linear_analysis import set_to_equilibrium, to_equilibrium
from test.generators.loops import random_mechanisms
from test.oracles import kane

CART = """
mechanism: cart
parameters: {{l: 0.5}}
parts:
  cart: {{mass: {mass}}}
  rod: {{mass: 0.2, center: [0, 0, l], inertia: [1e-3, 1e-3, 0], points: {{}}}}
joints:
  rail: {{type: prismatic, between: [ground, cart], axis: {rail}, position: {x}}}
  pin: {{type: revolute, between: [cart, rod], axis: {pin}, position: {angle}}}
"""


def cart(x=0.3, angle="180 deg", mass=0.7, rail="[1, 0, 0]", pin="[0, 1, 0]"):
    return parse_mechanism(CART.format(x=x, angle=angle, mass=mass, rail=rail, pin=pin))


@pytest.mark.parametrize(("angle", "stable"), [("0", False), ("180 deg", True), ("-180 deg", True), ("540 deg", True)])
def test_a_start_that_is_an_equilibrium_is_the_equilibrium(angle, stable):
    """The pendulum stands upright at 0; a search that prefers stable equilibria would leave it."""
    equations = derive(cart(angle=angle))
    found = nearest_equilibrium(equations)
    assert found.q == pytest.approx(equations.start.q, abs=1e-15) and found.stable is stable
    assert found.distance < 1e-15


@pytest.mark.parametrize(
    ("degrees", "azimuth"),
    [(1e-6, 0.9), (5.0, 2.2), (89.0, 0.0), (91.0, 0.9), (120.0, 2.2), (179.9, 0.0), (-30.0, 0.9), (-150.0, 2.2)],
)
def test_the_nearest_is_found_and_what_nothing_restores_stays(degrees, azimuth):
    """A cart on a level rail in any direction keeps its place, to the last digits."""
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    mechanism = cart(0.31, f"{degrees} deg", rail=f"[{cos}, {sin}, 0]", pin=f"[{-sin}, {cos}, 0]")
    found = nearest_equilibrium(derive(mechanism))
    turn = round(degrees / 180.0) * math.pi
    assert found.q == pytest.approx([0.31, turn], abs=1e-12)
    assert found.stable is (round(degrees / 180.0) % 2 == 1)
    assert found.displacement == pytest.approx([0.0, turn - math.radians(degrees)], abs=1e-12)


def test_of_two_at_the_same_distance_the_stable_one_is_taken():
    found = nearest_equilibrium(derive(load_mechanism("rod_pendulum")))
    assert found.q == pytest.approx([0.0], abs=1e-12) and found.stable


UPRIGHT = ((math.pi + 0.15, 0.1), (math.pi - 0.1, math.pi + 0.2))


@pytest.mark.parametrize(("unit", "starts"), [(1e-6, ((0.2, 0.1), (0.1, math.pi - 0.2))), (1e6, UPRIGHT)])
def test_nothing_depends_on_the_unit_of_length(unit, starts):
    """A double pendulum near each of its four equilibria, in other units; gravity is scaled as well."""
    for first, second in starts:
        texts = (
            f"""
mechanism: double
gravity: [0, 0, {-9.81 * size}]
parts:
  upper: {{mass: 1, center: [0, 0, {-0.3 * size}], inertia: [0, {0.1 * size**2}, {0.1 * size**2}], points: {{end: [0, 0, {-0.7 * size}]}}}}
  lower: {{mass: 2, center: [0, 0, {-0.4 * size}], inertia: [0, {0.2 * size**2}, {0.2 * size**2}]}}
joints:
  shoulder: {{type: revolute, between: [ground, upper], axis: [0, 1, 0], position: {first}}}
  elbow: {{type: revolute, between: [upper.end, lower], axis: [0, 1, 0], position: {second}}}
"""
            for size in (1.0, unit)
        )
        one, other = (nearest_equilibrium(derive(parse_mechanism(text))) for text in texts)
        right = [round(angle / math.pi) * math.pi for angle in (first, second)]
        assert one.q == pytest.approx(right, abs=1e-12) and other.q == pytest.approx(one.q, abs=1e-12)
        assert other.distance == pytest.approx(one.distance * unit, rel=1e-9)


def test_several_are_found_in_the_order_of_their_distance():
    found = equilibria(derive(load_mechanism("double_rod")))
    places = {tuple(np.round(np.remainder(one.q, 2.0 * math.pi) / math.pi).astype(int) % 2) for one in found}
    assert places == {(0, 0), (1, 0), (0, 1), (1, 1)} and len(found) == 4
    assert [one.distance for one in found] == sorted(one.distance for one in found)
    assert [one.stable for one in found] == [True, False, False, False]


def test_a_loop_near_its_upper_dead_center_stays_there():
    """The four-bar begins 10° from where it stands; it hangs on the other side, 165° away."""
    equations = derive(load_mechanism("four_bar"))
    with patch.object(equilibrium, "ATTEMPTS", 2):
        upper, lower = equilibria(equations)
    assert not upper.stable and lower.stable
    assert nearest_equilibrium(equations, q=upper.q).q == pytest.approx(upper.q, abs=1e-12)
    assert np.max(np.abs(equations.constraints.position(0.0, upper.q))) < 1e-12


@pytest.mark.parametrize(("angle", "stable"), [("0", False), ("rest", True)])
def test_a_driven_mechanism_rests_relative_to_its_drive(angle, stable):
    """The bottom of a spun tube is an equilibrium, though not a stable one; so is cos θ = g / r Ω²."""
    angle = 0.0 if angle == "0" else math.acos(9.81 / (0.5 * 6.0**2))
    sim = Simulation.from_file("spun_tube_particle", set={"joints.slide.position": angle})
    found = set_to_equilibrium(sim)
    assert found.distance < 1e-15 and found.stable is stable


def test_a_weight_that_falls_for_long_before_something_holds_it_is_followed():
    """The load is the same along a hundred times the size of the mechanism: the path must not be left too early."""
    text = """
mechanism: late
parts: {a: {mass: 1}}
joints: {z: {type: prismatic, between: [ground, a], axis: [0, 0, 1]}}
forces: {net: {type: force, at: a, vector: [0, 0, "where(z < -100, -0.0981*(z + 100), 0)"]}}
"""
    assert nearest_equilibrium(derive(parse_mechanism(text))).q == pytest.approx([-200.0])


def test_without_forces_every_start_is_an_equilibrium():
    """A wheel balanced by two masses: only round-off remains of its weight, and of the change of its moment."""
    sim = Simulation.from_text(
        """
mechanism: balanced
parts: {wheel: {mass: 1, shapes: [{type: particle, at: [0.1, 0, 0], mass: 0.3}, {type: particle, at: [-0.3, 0, 0], mass: 0.1}]}}
joints: {axle: {type: revolute, between: [ground, wheel], axis: [0, 1, 0], position: 1.1}}
""".replace("mass: 1, ", "")
    )
    assert to_equilibrium(sim) == pytest.approx([1.1], abs=0.0)
    free = Simulation.from_file("tumbling")
    assert to_equilibrium(free) == pytest.approx(free.model.start[free.model.q_range], abs=0.0)


SLOPE = """
mechanism: slope
parameters: {F: 12 N}
parts: {block: {mass: 2, shape: {type: block, size: [0.1, 0.1, 0.1]}}}
joints:
  along: {type: prismatic, between: [ground, block], axis: [0.8, 0, -0.6], position: 0.2, friction: {coulomb: F, sticking: true}}
"""


def test_friction_holds_a_start_that_would_slide_without_it():
    sim = Simulation.from_text(SLOPE, live=["F"])  # the slope pulls with 11.77 N
    found = set_to_equilibrium(sim)
    assert found.q == [0.2] and found.distance == 0.0 and found.stable
    sim.set_live({"F": 11.0})
    with (
        patch.object(equilibrium, "ATTEMPTS", 1),
        pytest.raises(InputError, match="no equilibrium of 'slope' was found"),
    ):
        set_to_equilibrium(sim)


def test_a_body_that_stands_on_the_floor_is_at_rest_there():
    text = """
mechanism: standing
parts: {ball: {mass: 1, shape: {type: sphere, radius: 0.1}}}
joints: {up: {type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: 0.2}}
constraints: {floor: {type: coupling, terms: {up: 1}, value: 0, bound: at_least}}
"""
    sim = Simulation.from_text(text)
    above = set_to_equilibrium(sim)
    assert above.q == pytest.approx([0.0], abs=1e-12) and above.distance == pytest.approx(0.2)
    sim.reset(q=[0.0])
    assert set_to_equilibrium(sim).distance == 0.0


def test_an_open_stop_does_not_keep_a_pendulum_from_its_equilibrium():
    text = """
mechanism: stopped
parts: {rod: {mass: 1, center: [0, 0, -0.5], inertia: [0, 0.1, 0.1]}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: 0.7, limits: {lower: LOWER, upper: 2, restitution: 0.5}}}
"""
    sim = Simulation.from_text(text.replace("LOWER", "-1"))
    assert to_equilibrium(sim) == pytest.approx([0.0], abs=1e-12)
    assert to_equilibrium(Simulation.from_text(text.replace("LOWER", "0.5"))) == pytest.approx([0.5], abs=1e-12)


MOTOR = """
mechanism: motor
parts: {rod: {mass: 1, center: [0, 0, -0.5], inertia: [0, 0.1, 0.1]}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: 0.4}}
actuators:
  drive: {type: dc_motor, joint: pin, torque_constant: 0.5, resistance: 2, inductance: 1e-3, SERVO}
"""


def test_the_current_of_a_motor_belongs_to_the_equilibrium():
    """Without a voltage there is no current, and the rod hangs; a voltage holds it where m g l sin q = k U / R."""
    sim = Simulation.from_text(MOTOR.replace(", SERVO", ""))
    found = set_to_equilibrium(sim)
    assert found.q == pytest.approx([0.0], abs=1e-12) and found.states == pytest.approx([0.0], abs=1e-9)
    sim.set_commands({"drive": 4.0})
    found = set_to_equilibrium(sim)
    assert abs(math.sin(found.q[0])) == pytest.approx(0.5 * 4.0 / 2.0 / (9.81 * 0.5), rel=1e-9)
    assert found.states == pytest.approx([2.0], rel=1e-9)
    before = sim.q.copy()
    sim.run(until=0.5)
    assert sim.q == pytest.approx(before, abs=1e-9)


def test_the_integral_of_a_servo_carries_the_weight():
    """The servo holds the angle that is commanded, 0.4 rad, and its integral the voltage for this."""
    servo = "servo: {controls: position, kp: 30, ki: 20, kd: 2}"
    sim = Simulation.from_text(MOTOR.replace("SERVO", servo))
    found = set_to_equilibrium(sim)
    assert found.q == pytest.approx([0.4], abs=1e-9) and found.stable
    current = 9.81 * 0.5 * math.sin(0.4) / 0.5
    assert sim.actuators()["drive"].current == pytest.approx(current, rel=1e-9)
    sim.run(until=0.3)
    assert sim.q == pytest.approx([0.4], abs=1e-9)


def test_the_search_begins_at_the_present_coordinates_and_changes_nothing_if_it_fails(monkeypatch):
    sim = Simulation(cart(angle="180 deg"))
    sim.reset(q=[0.0, 0.1])
    assert to_equilibrium(sim) == pytest.approx([0.0, 0.0], abs=1e-12)
    monkeypatch.setattr(equilibrium, "ATTEMPTS", 1)
    falling = Simulation.from_file("projectile")
    falling.run(until=0.1)
    before = falling.state.copy()
    with pytest.raises(InputError, match="no equilibrium"):
        to_equilibrium(falling)
    assert np.array_equal(falling.state, before) and falling.time == 0.1
    with pytest.raises(InputError, match="equilibria of 'cart' were found"):
        to_equilibrium(sim, number=9)


@settings(max_examples=2)
@given(random_mechanisms())
def test_random_mechanisms_come_back_to_an_equilibrium_that_was_left_a_little(drawn):
    """Forces vanish there by Kane's equations; the mechanism returns to it, stable or not, from near by."""
    text, rng = drawn
    mechanism = parse_mechanism(text.replace("*t)", "*0)"))  # drives stand still
    assume(0 < len(mechanism.coordinate_names) <= 4)  # a search among more speeds takes seconds
    try:
        equations = derive(mechanism)
    except MechanismError:  # nothing can move
        reject()
    assume(is_autonomous(equations))
    with patch.object(equilibrium, "ATTEMPTS", 2):  # those from which no path leads to one would take seconds
        found = nearest_equilibrium(equations)
    assume(found is not None)
    zeros = np.zeros(equations.layout.nv)
    oracle = kane.equations(mechanism, found.q, zeros, zeros)
    assume(oracle.constraint_condition < 1e6 and oracle.condition < 1e6)
    start = kane.equations(mechanism, equations.start.q, zeros, zeros)
    size = np.linalg.norm(start.scale * start.accelerations) + 9.81 * math.sqrt(mechanism.mass)
    assert np.linalg.norm(oracle.scale * oracle.accelerations) <= 1e-8 * size
    again = nearest_equilibrium(equations, q=found.q)
    assert again.distance <= 1e-7 * equations.constraints.size
    free = null_space(equations.constraints.gradient(0.0, found.q))
    q = equations.constraints.displaced(found.q, 1e-4 * free @ rng.normal(size=free.shape[1]))
    closing = close_loops(equations.constraints, 0.0, q, np.ones(len(zeros), dtype=bool))
    back = nearest_equilibrium(equations, q=closing.q)
    weights = np.sqrt(np.diag(equations.constraints.mass_matrix(0.0, found.q)) / mechanism.mass)
    moved = np.linalg.norm(weights * displacement_between(equations, found.q, closing.q))
    assert back.distance <= 1.1 * moved


FREE = """
mechanism: free
gravity: [0, 0, {gravity}]
parts: {{a: {{mass: 1, inertia: [1, 1, 1]}}, b: {{shape: {{type: sphere, radius: 0.1, at: [0, 1, 0], mass: 2}}}}}}
joints:
  base: {{type: free, between: [ground, a], orientation: {{axis: [1, 2, 3], angle: 50 deg}}}}
  pin: {{type: revolute, between: [a, b], axis: [1, 0, 0], position: 0.4, stiffness: 3}}
{more}
"""


@pytest.mark.parametrize(
    ("gravity", "more", "followed"),
    [
        (-9.81, "contacts: {floor: {parts: [b], plane: ground}}", False),
        (0, "", True),  # the spring turns the parts, and comes to rest
        (-9.81, "forces: {spring: {type: spring, between: [ground, a], stiffness: 50}}", True),
        (-9.81, "contacts: {floor: {parts: [b], plane: ground, stiffness: 1e4}}", True),
    ],
)
def test_no_path_is_followed_where_a_free_body_falls(gravity, more, followed):
    """There is no equilibrium without contacts then, and following the fall of a heap of thirty balls took minutes."""
    equations = derive(parse_mechanism(FREE.format(gravity=gravity, more=more)))
    with patch.object(equilibrium, "equilibria_along", side_effect=equilibrium.equilibria_along) as paths:
        found = nearest_equilibrium(equations)
        assert (paths.call_count > 0) == followed
    assert (found is not None) == followed
    if not followed:
        assert equilibria(equations) == []
