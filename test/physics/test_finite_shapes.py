"""Contacts of blocks, rods and spheres with each other, beside closed forms and motions that are integrated here."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from mbd_sim import Simulation
from mbd_sim.files.load import parse_mechanism

G = 9.81


def simulation(text, **options):
    return Simulation(parse_mechanism(text), method="tsitouras8", **options)


SLIDING = """
mechanism: sliding_block
parts:
  table: {shape: {type: block, size: [1, 1, 0.2], mass: 1, at: [0, 0, -0.1]}}
  block: {shape: {type: block, size: [0.2, 0.3, 0.1], mass: 2, at: [0, 0, 0.05]}}
joints:
  table: {type: fixed, between: [ground, table]}
  block: {type: planar, between: [ground, block], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [0.3, 0, 0], velocity: [1, 0, 0]}
contacts: {c: {between: [block, table], friction: 0.1}}
"""


CART = """
mechanism: cart
parts:
  cart: {shape: {type: block, mass: 2 kg, size: [2, 1, 0.1]}}
  box: {shape: {type: block, mass: 1 kg, size: [0.2, 0.2, 0.2]}}
joints:
  cart: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], drive: "0.5*t"}
  box: {type: planar, between: [ground, box], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [0, 0.15, 0]}
contacts: {pair: {between: [cart, box], friction: 0.2}}
"""


def test_a_drive_works_against_a_contact_and_its_joint_bears_what_is_across():
    """The part moves steadily along one axis: neither a coordinate nor a changing velocity shows the contact's forces."""
    sim = simulation(CART)
    sim.step(20)
    assert sim.reactions()["cart"].force == pytest.approx([0.2 * G, 0.0, 3.0 * G], rel=1e-12, abs=1e-12)
    assert abs(sim.energies.residual) < 1e-15


def tipped(time, mu=0.1, mass=2.0, size=(0.2, 0.1)):
    """The center (x, z), the angle about y, and their rates, of a block that slides over the edge (0.5, 0) and tips.

    The center of pressure is ahead of the block's center by μ times half its height; as it reaches the edge, the rear
    opens. Then the edge slides along the lower side. All sums about the center, in x and z.
    """
    inertia, half = mass * (size[0] ** 2 + size[1] ** 2) / 12.0, 0.5 * size[1]
    way = 0.2 - mu * half
    start = (1.0 - math.sqrt(1.0 - 2.0 * mu * G * way)) / (mu * G)

    def rates(_, y):
        x, z, angle, vx, vz, turn = y
        along, across = (np.array([math.cos(angle), -math.sin(angle)]), np.array([math.sin(angle), math.cos(angle)]))
        arm, speed = np.array([0.5 - x, -z]), np.array([vx, vz])
        at_edge = speed + turn * np.array([arm[1], -arm[0]])
        direction = across - mu * math.copysign(1.0, at_edge @ along) * along
        moment = arm[1] * direction[0] - arm[0] * direction[1]
        free = turn**2 * (across @ arm) + 2.0 * turn * (along @ speed) - G * across[1]
        normal = -free / (across @ direction / mass - (along @ arm) * moment / inertia)
        assert normal > 0.0
        return [vx, vz, turn, *(normal * direction / mass - [0.0, G]), normal * moment / inertia]

    state = [0.5 - mu * half, half, 0.0, 1.0 - mu * G * start, 0.0, 0.0]
    found = solve_ivp(rates, (start, time), state, method="DOP853", rtol=1e-13, atol=1e-14)
    return start, found.y[:, -1]


def test_a_block_slides_over_the_edge_of_a_table_and_tips():
    """Vertices leave the face, edges that cross take over, the rear opens, and the edge slides along the lower side.

    Beside an integration written here.
    """
    sim = simulation(SLIDING, step=1e-3)
    start, expected = tipped(0.34)
    sim.step(340)
    pose, motion = sim.poses()["block"], sim.motion("block")
    center = pose.position + pose.rotation @ np.array([0, 0, 0.05])
    angle = math.atan2(-pose.rotation[2, 0], pose.rotation[0, 0])
    assert [center[0], center[2], angle] == pytest.approx(expected[:3], abs=1e-10)
    speed = motion.velocity + np.cross(motion.angular_velocity, center - pose.position)
    assert [speed[0], speed[2], motion.angular_velocity[1]] == pytest.approx(expected[3:], abs=1e-8)
    opened = [event.time for event in sim.contact_events if event.change == "opened"]
    assert opened[-1] == pytest.approx(start, abs=1e-10)
    assert abs(sim.energies.residual) < 1e-11


BALL = """
mechanism: ball_and_block
parts:
  table: {shape: {type: block, size: [1, 0.8, 0.2], mass: 1, at: [0, 0, -0.1]}}
  ball: {shape: {type: sphere, radius: 0.05, mass: 0.3}}
joints:
  table: {type: fixed, between: [ground, table]}
  ball: {type: free, between: [ground, ball], STATE}
contacts: {c: {between: [ball, table], LAW}}
"""


def test_a_ball_rolls_over_an_edge_and_turns_about_it():
    """The face hands the ball over to the edge without an impact; there its angle has θ'' = g sin θ / 1.4 r."""
    start = "position: [0.4, 0.1, 0.05], velocity: [0.2, 0, 0], angular_velocity: [0, 4, 0]"
    sim = simulation(BALL.replace("STATE", start).replace("LAW", "friction: 1"), step=1e-3)
    edge, r = 0.5, 0.05
    rates = solve_ivp(
        lambda _, y: [y[1], G * math.sin(y[0]) / (1.4 * r)],
        (0.5, 0.6),
        [0.0, 4.0],
        method="DOP853",
        rtol=1e-13,
        atol=1e-14,
    )
    angle, turn = rates.y[:, -1]
    assert 0.3 < angle < 0.7
    sim.step(600)
    ball = sim.motion("ball")
    assert ball.pose.position == pytest.approx([edge + r * math.sin(angle), 0.1, r * math.cos(angle)], abs=1e-10)
    assert ball.angular_velocity == pytest.approx([0, turn, 0], abs=1e-8)
    assert sim.contacts()["c"].state == "sticks"
    assert abs(sim.energies.residual) < 1e-12


@pytest.fixture(scope="module")
def dropped():
    return simulation(BALL.replace("STATE", "position: [0, 0, 0.3]").replace("LAW", "restitution: 0.7"), step=1e-3)


@pytest.mark.parametrize(("x", "y"), [(0.1, 0.2), (0.51, 0.2), (0.505, 0.465)], ids=["face", "edge", "corner"])
def test_a_ball_falls_on_a_face_an_edge_and_a_corner(dropped, x, y):
    """The time follows from the nearest point of the block, and the rebound from the line through it."""
    sim = dropped
    sim.reset(q=[x, y, 0.3, 1, 0, 0, 0], u=[0.1, -0.2, 0, 0, 0, 0])

    def center(t):
        return np.array([x + 0.1 * t, y - 0.2 * t, 0.3 - 0.5 * G * t * t])

    def apart(t):
        return center(t) - np.clip(center(t), [-0.5, -0.4, -0.2], [0.5, 0.4, 0.0])

    low, high = 0.0, 0.26
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if np.linalg.norm(apart(middle)) < 0.05 else (middle, high)
    sim.step(300)
    (event,) = sim.contact_events
    assert event.time == pytest.approx(low, abs=1e-12)
    normal, before = apart(low) / np.linalg.norm(apart(low)), np.array([0.1, -0.2, -G * low])
    after = before - 1.7 * (before @ normal) * normal
    rest = 0.3 - low
    expected = center(low) + after * rest - [0, 0, 0.5 * G * rest**2]
    assert sim.poses()["ball"].position == pytest.approx(expected, abs=1e-10)
    assert event.loss == pytest.approx(0.5 * 0.3 * (1 - 0.49) * (before @ normal) ** 2, abs=1e-12)


RODS = """
mechanism: crossing_rods
gravity: [0, 0, 0]
parts:
  one: {shape: {type: rod, from: [-0.3, 0, 0], to: [0.3, 0, 0], radius: 0.02, mass: 0}, mass: 1, inertia: [0.001, 0.03, 0.03]}
  two: {shape: {type: rod, from: [0, -0.2, 0], to: [0, 0.4, 0], radius: 0.03, mass: 0}, mass: 2, inertia: [0.05, 0.001, 0.05]}
joints:
  one: {type: free, between: [ground, one], position: [0.1, -0.1, 0.25], velocity: [0, 0, -2]}
  two: {type: free, between: [ground, two]}
contacts: {c: {between: [two, one], restitution: 0.6}}
"""


def test_crossing_rods_meet_between_their_ends():
    """The impulse at the crossing of both axes."""
    sim = simulation(RODS, step=1e-3)
    sim.step(150)
    mobility = 1 / 1.0 + 1 / 2.0 + 0.1**2 / 0.03 + 0.1**2 / 0.05
    impulse = 1.6 * 2.0 / mobility
    (event,) = sim.contact_events
    assert event.time == pytest.approx(0.1, abs=1e-13)
    assert event.impulse == pytest.approx(impulse, abs=1e-12)
    one, two = sim.motion("one"), sim.motion("two")
    assert one.velocity == pytest.approx([0, 0, -2 + impulse], abs=1e-12)
    assert two.velocity == pytest.approx([0, 0, -impulse / 2], abs=1e-12)
    assert one.angular_velocity == pytest.approx([0, 0.1 * impulse / 0.03, 0], abs=1e-12)
    assert two.angular_velocity == pytest.approx([0.1 * impulse / 0.05, 0, 0], abs=1e-12)


WEDGE = """
mechanism: wedge
parts:
  wedge: {shape: {type: block, size: [2, 1, 0.5], mass: 3, rotate: {axis: [0, 1, 0], angle: 30 deg}}}
  block: {shape: {type: block, size: [0.2, 0.2, 0.1], mass: 2}}
joints:
  rail: {type: prismatic, between: [ground, wedge], axis: [1, 0, 0]}
  block: {type: planar, between: [ground, block], axis: [0, -1, 0], x_axis: [1, 0, 0], position: [-0.3505, 0.5626, -30 deg]}
contacts: {c: {between: [block, wedge]}}
"""


def test_a_block_slides_down_a_wedge_that_slides_away():
    """Without friction the wedge is pushed back by m g sin α cos α / (M + m sin² α)."""
    alpha, m, wedge = math.radians(30.0), 2.0, 3.0
    across = np.array([math.sin(alpha), math.cos(alpha)])
    place = -0.2 * np.array([math.cos(alpha), -math.sin(alpha)]) + 0.3 * across
    start = {"joints.block.position": [place[0], place[1], -alpha]}
    sim = simulation(WEDGE, step=1e-3, set=start)
    sim.step(300)
    back = -m * G * math.sin(alpha) * math.cos(alpha) / (wedge + m * math.sin(alpha) ** 2)
    assert sim.motion("wedge").velocity[0] == pytest.approx(0.3 * back, abs=1e-10)
    along = G * math.sin(alpha) - back * math.cos(alpha)
    block = sim.motion("block").velocity
    assert block[0] == pytest.approx(0.3 * (back + along * math.cos(alpha)), abs=1e-10)
    assert block[2] == pytest.approx(-0.3 * along * math.sin(alpha), abs=1e-10)
    normal = sum(state.normal for state in sim.contacts().values())
    assert normal == pytest.approx(m * (G * math.cos(alpha) + back * math.sin(alpha)), abs=1e-9)


DOMINOES = """
mechanism: dominoes
parts:
  a: {shape: {type: block, size: [0.02, 0.3, 0.2], mass: 1, at: [-0.01, 0, 0.1]}}
  b: {shape: {type: block, size: [0.02, 0.3, 0.2], mass: 1, at: [-0.01, 0, 0.1]}}
joints:
  a: {type: revolute, between: [ground, a], axis: [0, 1, 0], velocity: 2}
  b: {type: revolute, between: [ground.b, b], axis: [0, 1, 0], limits: {lower: 0, upper: 90 deg, restitution: 0}}
ground: {points: {b: [0.1, 0, 0]}}
contacts: {row: {between: [a, b], restitution: 0.3}}
"""


def test_a_domino_strikes_the_next_one():
    """A corner meets the side of the next one: the time from the energy, the speeds from both angular momenta."""
    sim = simulation(DOMINOES, step=1e-3)
    inertia, gap, height = (0.02**2 + 0.2**2) / 12 + 0.01**2 + 0.1**2, 0.08, 0.2
    struck = math.asin(gap / height)

    def speed(angle):
        height_of_center = 0.1 * math.cos(angle) + 0.01 * math.sin(angle)
        return math.sqrt(4.0 + 2.0 * G * (0.1 - height_of_center) / inertia)

    time = quad(lambda angle: 1.0 / speed(angle), 0.0, struck, epsabs=1e-14)[0]
    first = sim.contact_event_count
    sim.step(math.ceil(time * 1000))
    event = list(sim.contact_events)[first]
    assert event.time == pytest.approx(time, abs=1e-12)
    arms = np.array([height * math.cos(struck), height * math.cos(struck)])  # of the impulse along x about both hinges
    before = speed(struck)
    impulse = 1.3 * arms[0] * before / (arms @ arms / inertia)
    assert event.impulse == pytest.approx(impulse, abs=1e-11)


SLOPE = """
mechanism: slope
ground: {points: {slope: {at: [0.3, -0.2, 0.1], rotate: {rpy: [0.3, 0.2, 0.7]}}}}
parts:
  table: {shape: {type: block, size: [4, 1, 0.2], mass: 1, at: [0, 0, -0.1]}}
  block: {shape: {type: block, size: [0.2, 0.3, 0.1], mass: 2, at: [0, 0, 0.05]}}
joints:
  table: {type: fixed, between: [ground.slope, table]}
  block: {type: free, between: [ground.slope, block], position: [0.3, 0.1, 0], orientation: {rpy: [0, 0, 0.5]}}
contacts: {c: {between: [block, table], friction: 0.2}}
"""


def test_a_block_slides_down_a_block_that_is_tilted_in_space():
    """Faces that are along no axis, four corners that share the load, friction straight down the slope."""
    sim = simulation(SLOPE, step=1e-3)
    start, normal = sim.poses()["block"].position.copy(), sim.poses()["table"].rotation[:, 2]
    down = np.array([0.0, 0.0, -G]) + G * normal[2] * normal
    steep = np.linalg.norm(down)
    sim.step(500)
    way = 0.5 * (steep - 0.2 * G * normal[2]) * 0.25 * down / steep
    assert sim.poses()["block"].position - start == pytest.approx(way, abs=1e-13)
    loads = [state.normal for state in sim.contacts().values() if state.state == "slides"]
    assert len(loads) == 4
    assert sum(loads) == pytest.approx(2.0 * G * normal[2], abs=1e-12)
    assert abs(sim.energies.residual) < 1e-12
