"""Contacts between shapes: their gaps against brute force, their motion against closed forms and conservation laws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError, MechanismError
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.simulation.contact.records import ContactChange

G = 9.81
ANGLES = np.linspace(0.0, 2.0 * np.pi, 200_001)
PAIR = """
mechanism: pair
gravity: [0, 0, 0]
parts:
  a:
    mass: 1
    inertia: [1, 1, 1]
    shapes: [A]
    points: {p: {at: [0.1, 0.2, 0.3], rotate: {axis: [1, 2, 0], angle: 0.7}}}
  b: {mass: 1, inertia: [1, 1, 1], shapes: [B], points: {p: {at: [0.2, 0, 0.1], rotate: {axis: [0, 1, 2], angle: 1.1}}}}
joints:
  a: {type: free, between: [ground, a], position: [0, 0, 40]}
  b: {type: free, between: [ground, b], position: [START]}
contacts:
  k: {CONTACT}
"""
BALL = "{type: sphere, radius: 0.3, at: [0.1, 0.2, 0.3], mass: 0}"
DISC = "{type: disc, radius: 0.3, at: [0.1, 0.2, 0.3], axis: [1, 0, 2], mass: 0}"
CYLINDER = "{type: cylinder, radius: 0.5, length: 1, at: [0.2, 0, 0.1], axis: [1, 2, 3], mass: 0}"
SPHERE = "{type: sphere, radius: 0.5, at: [0.2, 0, 0.1], mass: 0}"
PROFILE = "0.4 + 0.05*cos(angle) + 0.02*sin(2*angle)"


def pair(contact, a=BALL, b=SPHERE, start="0, 0, 0"):
    """Two bodies of which the readings are compared; no step is taken."""
    text = PAIR.replace("[A]", f"[{a}]").replace("[B]", f"[{b}]")
    return Simulation.from_text(text.replace("CONTACT", contact).replace("START", start), method="rk4")


def random_state(simulation, seed):
    """A state with both parts anywhere, and their poses."""
    chance = np.random.default_rng(seed)
    y = simulation.y.copy()
    for joint, offset in (("a", 0.0), ("b", 3.0)):
        first = simulation.model.layout.q[joint].start
        y[first : first + 3] = chance.uniform(-0.3, 0.3, 3) + np.array([0.0, 0.0, offset])
        quaternion = chance.normal(size=4)
        y[first + 3 : first + 7] = quaternion / np.linalg.norm(quaternion)
    return y, simulation.model.poses(0.0, y)


def gaps(simulation, y):
    return simulation.model.one_sided.readings(0.0, y, simulation.inputs.copy()).gaps


def placed(pose, point):
    return pose.position + pose.rotation @ np.asarray(point)


@pytest.mark.parametrize("seed", range(2))
def test_two_balls_are_as_far_apart_as_their_centers_less_the_radii(seed):
    simulation = pair("between: [a, b]")
    y, poses = random_state(simulation, seed)
    line = placed(poses["a"], [0.1, 0.2, 0.3]) - placed(poses["b"], [0.2, 0, 0.1])
    assert gaps(simulation, y) == pytest.approx([np.linalg.norm(line) - 0.8], abs=1e-14)


@pytest.mark.parametrize("seed", range(15))
def test_a_ball_is_as_far_from_a_cylinder_as_from_its_nearest_point(seed):
    """Beside it, beyond an end, and at an edge."""
    simulation = pair("between: [a, b]", b=CYLINDER)
    y, poses = random_state(simulation, seed)
    axis = poses["b"].rotation @ (np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0))
    center = placed(poses["b"], [0.2, 0, 0.1])
    first = simulation.model.layout.q["a"].start
    y[first : first + 3] += (
        center + 1.5 * np.random.default_rng(seed).normal(size=3) - placed(poses["a"], [0.1, 0.2, 0.3])
    )
    line = placed(simulation.model.poses(0.0, y)["a"], [0.1, 0.2, 0.3]) - center
    along, across = axis @ line, line - axis * (axis @ line)
    if abs(along) < 0.5 and np.linalg.norm(across) < 0.5:
        return  # the center is inside
    nearest = axis * np.clip(along, -0.5, 0.5) + across * min(1.0, 0.5 / np.linalg.norm(across))
    distance = simulation.model.one_sided.features.distances(0.0, y, simulation.inputs)[0]
    assert distance == pytest.approx(np.linalg.norm(line - nearest) - 0.3, abs=1e-14)


def cam_curve():
    radius = 0.4 + 0.05 * np.cos(ANGLES) + 0.02 * np.sin(2 * ANGLES)
    return np.column_stack([radius * np.cos(ANGLES), radius * np.sin(ANGLES), np.zeros_like(radius)])


@pytest.mark.parametrize("turn", [4.6])
def test_a_flat_follower_is_as_far_from_a_cam_as_the_support_of_its_profile(turn):
    normal = [float(np.cos(turn)), float(np.sin(turn)), 0.0]
    simulation = pair(
        f"plane: a.p, normal: {normal}, cam: b.p, profile: {PROFILE}", start=f"{80 * normal[0]}, {80 * normal[1]}, 40"
    )
    y = simulation.y.copy()
    parts, poses = simulation.mechanism.parts, simulation.model.poses(0.0, y)
    face, frame = parts["a"].points["p"], parts["b"].points["p"]
    first = simulation.model.layout.q["a"].start
    turned = frame.rotation @ face.rotation.T  # so that the follower is square to the cam
    assert np.linalg.det(turned) == pytest.approx(1.0)
    w = 0.5 * np.sqrt(1.0 + np.trace(turned))
    skew = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
    y[first + 3 : first + 7] = [w, *(skew / (4.0 * w))]
    poses = simulation.model.poses(0.0, y)
    out = frame.rotation @ normal
    base, origin = placed(poses["a"], face.position), placed(poses["b"], frame.position)
    expected = np.min(cam_curve() @ frame.rotation.T @ out) + (origin - base) @ out
    assert gaps(simulation, y) == pytest.approx([expected], abs=1e-8)


PLANE = """
mechanism: on_a_plane
parts:
  body: {shape: SHAPE}
joints:
  body: {type: planar, between: [ground, body], axis: [0, 1, 0], x_axis: [1, 0, 0], position: [0, -1, 0]}
contacts:
  floor: {parts: [body], plane: ground, friction: 0.4}
"""


def test_in_a_plane_mechanism_corners_behind_each_other_are_one():
    block = PLANE.replace("SHAPE", "{type: block, mass: 1, size: [0.2, 0.3, 0.4]}")
    assert len(Simulation.from_text(block, method="rk4").model.one_sided.names) == 4
    wheel = PLANE.replace("SHAPE", "{type: cylinder, mass: 1, radius: 0.2, length: 0.1, axis: [0, 1, 0]}")
    assert len(Simulation.from_text(wheel, method="rk4").model.one_sided.names) == 1


@pytest.mark.parametrize(
    ("shape", "height"),
    [
        ("{type: sphere, mass: 2, radius: 0.3}", 0.3),
        ("{type: rod, mass: 2, from: [0, 0, -0.2], to: [0, 0, 0.2], radius: 0.1}", 0.3),
    ],
)
def test_a_body_falls_on_the_plane_and_rests_there(shape, height):
    simulation = Simulation.from_text(PLANE.replace("SHAPE", shape), method="tsitouras8")
    simulation.run(1.0)
    assert simulation.q == pytest.approx([0.0, -height, 0.0], abs=1e-13)
    assert simulation.model.one_sided.readings(1.0, simulation.y, simulation.inputs.copy()).forces[0] == pytest.approx(
        2 * G
    )
    assert abs(simulation.energies.residual) < 1e-12


OBLIQUE = """
mechanism: oblique
gravity: [0, 0, 0]
parts:
  a: {shape: {type: sphere, mass: 1, radius: 0.1}}
  b: {shape: {type: sphere, mass: 3, radius: 0.2}}
joints:
  a: {type: free, between: [ground, a], position: [-1, 0.1, 0.05], velocity: [2, 0, 0], angular_velocity: [3, 1, -8]}
  b: {type: free, between: [ground, b], velocity: [0, 0.1, 0], angular_velocity: [0, 5, 2]}
contacts:
  k: {between: [a, b], LAW}
"""


def momenta(simulation):
    """The momentum (3,), and the angular momentum (3,) about ground's origin, of two free balls."""
    total, angular = np.zeros(3), np.zeros(3)
    for name, mass, inertia in (("a", 1.0, 0.4 * 0.01), ("b", 3.0, 0.4 * 3.0 * 0.04)):
        q, u = simulation.q[simulation.model.layout.q[name]], simulation.u[simulation.model.layout.u[name]]
        total += mass * u[:3]
        angular += np.cross(q[:3], mass * u[:3]) + inertia * from_quaternion(q[3:]) @ u[3:]
    return total, angular


def test_a_slider_in_a_guide_with_play_stays_between_its_walls():
    simulation = Simulation.from_file("slider_crank_clearance")
    for step in range(5, 1301, 5):
        simulation.step(5)
        read = gaps(simulation, simulation.y)
        assert read.min() > -1e-13, f"at step {step}"
    kinds = {event.name.split(".")[0] for event in simulation._memory.stepper.events}
    assert kinds == {"lower_wall", "upper_wall"}
    assert simulation.energies.dissipated > 0.3
    simulation.run(until=0.5)
    assert abs(simulation.energies.residual) < 1e-11


@pytest.mark.parametrize(
    ("law", "error"),
    [
        ("restitution: 0.7, friction: 0.3", 1e-13),
        ("stiffness: 1e6, damping: 0.5, friction: 0.3", 1e-8),  # of the steps across the ends of the contact
    ],
)
def test_a_collision_keeps_momentum_and_angular_momentum(law, error):
    simulation = Simulation.from_text(OBLIQUE.replace("LAW", law), step=2e-5)
    before, energy = momenta(simulation), simulation.energies.total
    simulation.run(0.6)
    after = momenta(simulation)
    assert np.linalg.norm(simulation.u[:3] - [2, 0, 0]) > 0.5, "the balls have not met"
    assert after[0] == pytest.approx(before[0], abs=1e-12)
    assert after[1] == pytest.approx(before[1], abs=1e-12)
    assert simulation.energies.total < energy - 0.1
    assert abs(simulation.energies.residual) < error


def test_a_smooth_collision_reverses_the_normal_velocity_by_its_restitution():
    simulation = Simulation.from_text(OBLIQUE.replace("LAW", "restitution: 0.7"))
    (event,) = impacts_after(simulation, 0.6)
    t = event.time
    line = np.array([-1 + 2 * t, 0.1 - 0.1 * t, 0.05])
    assert np.linalg.norm(line) == pytest.approx(0.3, abs=1e-12)
    normal, before = line / 0.3, np.array([2.0, -0.1, 0.0])
    impulse = 1.7 * -(before @ normal) / (1.0 + 1.0 / 3.0)
    assert event.impulse == pytest.approx(impulse, rel=1e-12)
    assert simulation.u[:3] == pytest.approx([2, 0, 0] + impulse * normal, abs=1e-12)


def impacts_after(simulation, until):
    simulation.run(until)
    return [event for event in simulation._memory.stepper.events if event.change is ContactChange.IMPACT]


def test_a_ball_that_rolls_in_a_cylinder_swings_like_a_longer_pendulum():
    simulation = Simulation.from_file("ball_in_cylinder")
    simulation.run(3.0)
    length = 0.5 - 0.08
    swing = solve_ivp(
        lambda t, x: [x[1], -5.0 / 7.0 * G / length * np.sin(x[0])],
        (0, 3),
        [np.radians(60), 0.0],
        rtol=1e-12,
        atol=1e-13,
    ).y[:, -1]
    assert simulation.q[:2] == pytest.approx([length * np.sin(swing[0]), length * np.cos(swing[0])], abs=1e-9)
    assert abs(simulation.energies.residual) < 1e-12
    assert abs(simulation.energies.dissipated) < 1e-12


def test_in_newtons_cradle_the_last_ball_leaves_with_the_speed_of_the_first():
    simulation = Simulation.from_file("newtons_cradle")
    events = impacts_after(simulation, 0.5)
    assert [event.name for event in events] == [f"pair_{i}" for i in (1, 2, 3, 4)]
    speed = np.sqrt(2 * (G * 0.3 * (1 - np.cos(np.radians(30)))) / (0.3**2 + 0.4 * 0.02**2))
    assert simulation.model.u_range.stop - simulation.model.u_range.start == 5
    highest = Simulation.from_file("newtons_cradle")
    highest.run(events[-1].time + 0.001)
    assert highest.u[4] == pytest.approx(-speed if highest.u[4] < 0 else speed, rel=1e-3)
    assert np.abs(highest.u[:4]).max() < 2e-3
    assert abs(simulation.energies.residual) < 1e-12


def test_a_follower_lifts_off_where_its_cam_would_have_to_pull():
    w, base, lift, roller, mass, k, preload = 140.0, 0.03, 0.005, 0.01, 0.3, 600.0, 15.0
    simulation = Simulation.from_file("cam_lift_off", live=["w"], method="tsitouras8")
    simulation.run(0.05)
    opened, *_ = [event for event in simulation._memory.stepper.events if event.change is ContactChange.OPENED]

    def height(t):
        return lift * np.sin(w * t) + np.sqrt((base + roller) ** 2 - (lift * np.cos(w * t)) ** 2)

    def push(t, h=1e-4):
        second = (-height(t + 2 * h) + 16 * height(t + h) - 30 * height(t) + 16 * height(t - h) - height(t - 2 * h)) / (
            12 * h * h
        )
        return mass * (second + G) + k * (height(t) - (base + roller - preload / k))

    assert opened.time == pytest.approx(brentq(push, 1e-3, 0.011), abs=1e-7)
    assert abs(simulation.energies.residual) < 1e-11
    simulation.reset()
    simulation.set_live({"w": 100.0})
    simulation.run(0.5)
    assert simulation.q[0] == pytest.approx(
        lift * np.sin(50.0) + np.sqrt((base + roller) ** 2 - (lift * np.cos(50.0)) ** 2), abs=1e-12
    )


def jellett(simulation):
    """-L·r: the angular momentum times the vector from the contact point of the bowl to the mass center."""
    rotation = from_quaternion(simulation.q[3:])
    momentum = rotation @ (np.array([8e-7, 8e-7, 7e-7]) * simulation.u[3:])
    return momentum @ (np.array([0.0, 0.0, 1.5e-2]) - 3e-3 * rotation[:, 2])


def test_the_tippe_top_turns_over_and_spins_on_its_stem():
    simulation = Simulation.from_file("tippe_top")
    start = jellett(simulation)
    simulation.run(1.0)
    assert jellett(simulation) == pytest.approx(start, rel=2e-3)  # exact but for the depth of the contact
    simulation.run(6.0)
    axis = from_quaternion(simulation.q[3:])[:, 2]
    assert axis[2] < -0.99999
    assert simulation.u[5] < -100.0, "about its own axis the spin has not reversed"
    assert simulation.q[2] == pytest.approx(5e-3 + 1.6e-2, abs=2e-5)
    assert abs(simulation.energies.residual) < 1e-9


SOFT = """
mechanism: soft
gravity: [0, 0, 0]
parts:
  ball: {shape: {type: sphere, mass: 2, radius: 0.1}}
joints:
  ball: {type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: 0.1, velocity: -0.5}
contacts:
  floor: {parts: [ball], plane: ground, stiffness: 5e4, exponent: EXPONENT}
"""


# Hooke: π √(m/k). Hertz: T = 2.94328 δ / v with the largest depth δ = (5 m v² / 4 k)^(2/5) (Johnson, sec. 11.4).
DURATION = {1: np.pi * np.sqrt(2 / 5e4), 1.5: 2.94328 * (5 * 2 * 0.25 / (4 * 5e4)) ** 0.4 / 0.5}


@pytest.mark.parametrize(("exponent", "error"), [(1, 1e-7), (1.5, 1e-11)])  # of steps across the ends of the contact
def test_an_elastic_contact_lasts_as_long_as_hooke_and_hertz_say(exponent, error):
    simulation = Simulation.from_text(SOFT.replace("EXPONENT", str(exponent)), step=1e-5)
    simulation.run(0.5 * DURATION[exponent])
    assert simulation.u[0] == pytest.approx(0.0, abs=1e-3)
    simulation.run(DURATION[exponent] - 5e-5)
    assert simulation.q[0] < 0.1
    simulation.run(DURATION[exponent] + 2e-5)
    assert simulation.q[0] > 0.1
    assert simulation.u[0] == pytest.approx(0.5, abs=error)
    assert abs(simulation.energies.residual) < error


SOFT_PAIRS = {
    "ball on cylinder": ("between: [a, b]", BALL, CYLINDER, 0.5),
    "disc on plane": ("parts: [a], plane: b.p, normal: [0, 1, 1]", DISC, SPHERE, 0.1),
    "roller on cam": (f"parts: [a], cam: b.p, profile: {PROFILE}", BALL, SPHERE, 0.5),
    "follower on cam": (f"plane: a.p, normal: [1, 0.3, 0], cam: b.p, profile: {PROFILE}", BALL, SPHERE, 0.2),
}


@pytest.mark.parametrize("name", SOFT_PAIRS)
def test_compliant_contacts_have_the_accelerations_of_their_potential(name):
    contact, a, b, distance = SOFT_PAIRS[name]
    simulation = pair(f"{contact}, stiffness: 1e4, damping: 2, friction: 0.4", a, b)
    chance = np.random.default_rng(3)
    lagrange, deep = lagrange_equations(simulation.mechanism), 0
    for _ in range(6):
        y, _ = random_state(simulation, chance.integers(1000))
        q, u = y[:14], chance.normal(size=12)
        q[7:10] = q[:3] + distance * chance.normal(size=3)
        y[14:26] = u
        deep += simulation.model.energies(0.0, y).potential > 0.0
        rates = np.array(simulation.model.equations.rates(0.0, y, simulation.inputs)).ravel()
        assert rates[14:26] == pytest.approx(lagrange.accelerations(q, u, np.zeros(12)), rel=1e-9, abs=1e-9)
    assert deep >= 2


def test_a_compliant_contact_needs_no_events():
    assert Simulation.from_text(SOFT.replace("EXPONENT", "1")).model.one_sided is None


FLOOR = """
mechanism: floor
parts:
  ball: {shape: {type: sphere, mass: 1, radius: 0.1}}
joints:
  ball: {type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: START}
contacts:
  floor: {parts: [ball], plane: ground, restitution: 0.5}
"""


def test_a_start_inside_an_obstacle_is_refused_with_both_names_and_the_depth():
    with pytest.raises(MechanismError) as caught:
        Simulation.from_text(FLOOR.replace("START", "0.07"))
    assert str(caught.value).startswith("<text>:8: contacts.floor: at the start 'ball' is 0.03 m inside 'ground'.")


def test_of_the_corners_inside_an_obstacle_the_deepest_is_named_once():
    block = FLOOR.replace(
        "sphere, mass: 1, radius: 0.1", "block, mass: 1, size: [2, 1, 1], rotate: {axis: [0, 1, 0], angle: 0.1}"
    )
    with pytest.raises(MechanismError) as caught:
        Simulation.from_text(block.replace("START", "0.5"))
    depth = np.sin(0.1) + 0.5 * np.cos(0.1) - 0.5
    assert [problem.message for problem in caught.value.problems] == [
        f"at the start 'ball' is {depth:.4g} m inside 'ground'"
    ]


@pytest.mark.parametrize("name", ["elbow_stop", "rope", "backlash"])
def test_a_start_beyond_any_other_one_sided_element_is_refused_too(name):
    change = {"elbow_stop": {"th2": 1.5}, "rope": {"joints.z.position": -1.2}}
    words = {"elbow_stop": "0.5 rad beyond its upper limit", "rope": "beyond the bound"}
    change["backlash"], words["backlash"] = {"joints.first.position": 0.2}, "play, upper end is 0.15"
    with pytest.raises(MechanismError, match=words[name]):
        Simulation.from_file(name, set=change[name])


def test_states_inside_an_obstacle_are_refused_and_nothing_changes():
    simulation = Simulation.from_text(FLOOR.replace("START", "0.3"))
    with pytest.raises(ValueError, match=r"'ball' is 0\.05 m inside 'ground'"):
        simulation.reset(q=[0.05])
    with pytest.raises(CommandError, match=r"'ball' is 0\.05 m inside 'ground'"):
        simulation.set_state({"ball": 0.05})
    assert simulation.q == pytest.approx([0.3])
    simulation.set_state({"ball": 0.1})
    assert simulation.q == pytest.approx([0.1])


def test_restitution_and_friction_are_live_values():
    simulation = Simulation.from_text(FLOOR.replace("START", "0.1 + 0.2"), live=["contacts.floor.restitution"])
    simulation.set_live({"contacts.floor.restitution": 1.0})
    simulation.run(5.0)
    assert simulation.energies.dissipated == pytest.approx(0.0, abs=1e-12)
    assert (
        Simulation.from_text(FLOOR.replace("START", "0.3"), set={"contacts.floor.restitution": 0})
        .mechanism.contacts[0]
        .law.restitution
        == 0
    )
