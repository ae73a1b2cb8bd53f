"""Contacts that a step may miss are named with a step that finds them, and others are not."""

import math

import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.simulation.contact.records import ContactChange
from mbd_sim.simulation.run.remarks import jumps

BALLS = """
mechanism: balls
gravity: [0, 0, 0]
parts: {a: {shape: {type: sphere, mass: 1, radius: 5 mm}}, b: {shape: {type: sphere, mass: 1, radius: 5 mm}}}
joints:
  a: {type: free, between: [ground, a], position: [-1.53, 0, 0], velocity: [60, 0, 0]}
  b: {type: free, between: [ground, b]}
contacts: {hit: {between: [a, b], stiffness: 1e8, exponent: 1}}
"""
ROD = """
mechanism: rod
gravity: [0, 0, 0]
parts: {rod: {shape: {type: rod, mass: 1, to: [1, 0, 0]}}}
joints:
  f: {type: JOINT, axis: [0, -1, 0], x_axis: [1, 0, 0], between: [ground, rod.middle], position: [0, 0.6, 0], velocity: [0, -1, SPEED]}
contacts: {floor: {parts: [rod], plane: ground, restitution: 1}}
"""
RING = ROD.replace("type: rod, mass: 1, to: [1, 0, 0]", "type: disc, mass: 1, radius: 0.1, axis: [0, 1, 0]").replace(
    ".middle", ""
)


def test_small_compliant_balls_that_pass_each_other_within_a_step_are_named_and_the_proposed_step_finds_them():
    """They are 2 cm long together and fly 6 cm in a step; of equal masses and without losses the second flies on."""
    coarse = Simulation.from_text(BALLS, step=0.001)
    (remark,) = coarse.remarks
    assert "bodies at 'hit' move by up to 0.06 m in a step of 0.001 s" in remark and "Try step 1e-05" in remark
    coarse.run(until=0.1)
    assert coarse.u[0] == 60.0 and coarse.step_advice == remark
    fine = Simulation.from_text(BALLS, step=1e-5)
    assert fine.remarks == ()
    fine.run(until=0.03)
    assert fine.step_advice is None and fine.u[6] == pytest.approx(60.0, rel=1e-2)


def rod(speed, step):
    text = ROD.replace("JOINT", "planar").replace("SPEED", str(speed)).replace("parts: {rod: {", PARTS, 1)
    return Simulation.from_text(text, step=step)


PARTS = "parts: {rod: {points: {middle: [0.5, 0, 0]}, "


def test_a_rod_that_turns_too_far_in_a_step_is_named_and_the_proposed_step_finds_its_contact():
    """A rod turns by whole turns in a step, so that its ends are always level; h = sin(w t) / 2 decides the contact."""
    speed = 2.0 * math.pi / 0.001
    coarse = rod(speed, 0.001)
    (remark,) = coarse.remarks
    assert "parts at 'floor' turn by 6.28 rad in a step of 0.001 s" in remark and "Try step 5e-05" in remark
    fine = rod(speed, 5e-5)
    assert fine.remarks == () and fine.step_advice is None
    fine.run(until=0.12)
    first = next(event for event in fine.contact_events if event.change is ContactChange.IMPACT)
    height = 0.6 - first.time
    assert height == pytest.approx(0.5 * abs(math.sin(speed * first.time)), abs=1e-9)
    assert first.time == pytest.approx(0.1, abs=2.5e-4)  # the first quarter turn below 0.5 m


def test_a_wheel_and_a_ball_that_spin_are_not_named_as_their_gaps_do_not_change():
    wheel = Simulation.from_text(RING.replace("JOINT", "planar").replace("SPEED", "5000"))
    assert wheel.remarks == () and wheel.step_advice is None


def test_a_cam_along_whose_axis_a_ball_moves_is_named():
    text = """
mechanism: cam
ground: {points: {beside: [0.5, 0, 0]}}
parts: {ball: {shape: {type: sphere, mass: 1, radius: 0.05}}}
joints: {f: {type: FOLLOWER}}
contacts: {rides: {parts: [ball], cam: ground, profile: "0.3 + 0.05*cos(angle)"}}
"""
    along = "prismatic, axis: [0.1, 0, 1], between: [ground.beside, ball]"
    (remark,) = Simulation.from_text(text.replace("FOLLOWER", along)).remarks
    assert remark.startswith("the cam of 'rides' is endless along its axis, along which 'ball' moves")


PUSHED = """
mechanism: pushed
gravity: [0, 0, 0]
parts: {m: {mass: 1}}
joints: {x: {type: prismatic, between: [ground, m], axis: [1, 0, 0]}}
forces: {push: {type: effort, coordinate: x, effort: "EFFORT"}}
"""
BUSHING = """
mechanism: turner
gravity: [0, 0, 0]
parts: {m: {mass: 1, inertia: [0.1, 0.1, 0.1]}}
joints: {x: {type: revolute, between: [ground, m], axis: [0, 0, 1], velocity: SPEED}}
forces: {f: {type: bushing, between: [ground, m], rotational_stiffness: 1}}
"""


@pytest.mark.parametrize(
    "effort", ["where(t > 5.00045, where(t < 5.00055, 9, 0), 0)", "9*exp(-((t - 0.5005)/1e-4)**2)"]
)  # fmt: skip
def test_a_force_shorter_than_a_step_is_remarked(effort):
    (remark,) = Simulation.from_text(PUSHED.replace("EFFORT", effort)).remarks
    assert "forces.push.effort changes within the step" in remark


@pytest.mark.parametrize("effort", ["sin(6*t)", "where(t > 0.01, exp(-t), 0)"])
def test_forces_that_steps_resolve_are_not_remarked(effort):
    assert Simulation.from_text(PUSHED.replace("EFFORT", effort)).remarks == ()


def test_a_bushing_that_turns_past_half_a_turn_is_named_in_the_advice():
    simulation = Simulation.from_text(BUSHING.replace("SPEED", "12"))
    simulation.run(until=3.0)
    assert "'f' reverses where a bushing turns past half a turn" in simulation.step_advice
    simulation = Simulation.from_text(BUSHING.replace("SPEED", "5"))
    simulation.run(until=3.0)
    assert simulation.step_advice is None


def test_a_linearization_says_whether_it_changes_along_the_motion():
    falling = Simulation.from_file("double_rod")
    falling.run(until=0.5)
    assert "A changes along the motion at 0.5 s" in falling.linearize().remark
    assert Simulation.from_text(BUSHING.replace("SPEED", "0")).linearize().remark == ""


def found(text):
    return [(jump.quantity, jump.amount, jump.time) for jump in jumps(TimeExpression(text, {}), 1e-3, 5.0)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("where(t < 0.50007, 0, t - 0.50007)", [("speed", 1.0, 0.50007)]),
        ("where(t < 2, 0, 1e-6)", [("position", 1e-6, 2.0)]),
        ("max(0, 2*t - 6)", [("speed", 2.0, 3.0)]),
        ("mod(3*t, 6) ", [("position", -6.0, 2.0), ("position", -6.0, 4.0)]),
        # It is less than smooth changes within a step: differences from the slopes tell it from these.
        ("sin(40*t) + where(t < 2, 0, 0.01)", [("position", 0.01, 2.0)]),
    ],
)
def test_jumps_are_located(text, expected):
    got = found(text)
    assert [jump[0] for jump in got] == [jump[0] for jump in expected]
    assert [jump[1:] for jump in got] == [pytest.approx(jump[1:], rel=1e-9, abs=1e-11) for jump in expected]


@pytest.mark.parametrize(
    "text",
    [
        "sin(3*t)",
        "where(t < 1, 0, (t - 1)**2)",
        "where(t < 1, 0, where(t < 2, (t - 1)**2*(3 - 2*(t - 1)), 1))",
        "0*abs(t) + tanh(1e4*(t - 1))",
        "clip(0.1*t, -1, 1)",
    ],
)
def test_smooth_motions_have_none(text):
    assert found(text) == []


CART = """
mechanism: cart
parts: {{cart: {{mass: 2}}, bob: {{mass: 1, inertia: [0.1, 0.1, 0.1]}}}}
joints:
  rail: {{type: prismatic, between: [ground, cart], axis: [1, 0, 0], drive: "{drive}"}}
  slide: {{type: prismatic, between: [cart, bob], axis: [0, 0, 1]}}
"""


def test_a_drive_that_jumps_is_a_remark_and_a_smooth_one_is_none():
    """The kinetic energy of cart and bob changes by 1.5 J without work, which was a residual without a word."""
    simulation = Simulation(parse_mechanism(CART.format(drive="where(t < 0.5, 0, t - 0.5)")))
    simulation.run(until=1.0)
    assert simulation.energies.residual == pytest.approx(1.5)
    (said,) = simulation.remarks
    assert said.startswith("the drive of 'rail' jumps in speed by 1 m/s at t = 0.5 s. The impulse")
    before = Simulation(parse_mechanism(CART.format(drive="where(t < 0.5, 0, t - 0.5)")))
    before.run(until=0.25)
    assert before.remarks == ()
    assert Simulation(parse_mechanism(CART.format(drive="0.1*sin(t)"))).remarks == ()


@pytest.mark.parametrize("rope", ["distance, between: [ground, bob]", "cable, through: [ground, bob]"])
def test_a_prescribed_length_that_jumps_is_a_remark(rope):
    """Of every kind of constraint whose expression is one of time."""
    text = f"""
mechanism: rope
parts: {{bob: {{mass: 1, inertia: [1, 1, 1]}}}}
joints: {{free: {{type: free, between: [ground, bob], position: [0, 0, -1]}}}}
constraints: {{rope: {{type: {rope}, length: "where(t < 0.4, 1, 1 - 0.5*(t - 0.4))"}}}}
"""
    (said,) = Simulation(parse_mechanism(text)).remarks
    assert said.startswith("the constraint 'rope' jumps in speed by -0.5 m/s at t = 0.4 s.")
