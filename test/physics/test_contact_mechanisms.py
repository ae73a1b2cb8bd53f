"""The shipped mechanisms with contacts, each against a closed form, a balance that it must satisfy, or conservation."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.analysis.mechanics.kinematics import Kinematics

G = 9.81


def test_a_column_of_equal_beads_moves_as_particles_that_pass_through_each_other():
    """With e = 1 equal masses exchange their speeds, so that only the order of the particles is kept."""
    sim = Simulation.from_file("column_of_beads")
    sim.run(until=3.0)
    heights = []
    for index in range(6):
        height = 0.2 + 1e-3 * index
        fall = math.sqrt(2.0 * height / G)
        since_top = (sim.time + fall) % (2.0 * fall) - fall
        heights.append(height - 0.5 * G * since_top**2)
    beads = sim.q - 0.02 * (2.0 * np.arange(6) + 1.0)
    assert np.max(np.abs(beads - np.sort(heights))) < 1e-12
    assert sim.contact_event_count > 200
    assert sim.losses.impact == pytest.approx(0.0, abs=1e-12)


def test_a_column_of_beads_that_touch_rebounds_as_one_body():
    """Newton's law for simultaneous impacts: no pair approaches, so all leave with e times the speed of the first."""
    sim = Simulation.from_file("column_of_beads", set={"distance": 0.0, "e": 0.8})
    fall = math.sqrt(2.0 * 0.2 / G)
    sim.run(until=0.3)
    expected = 0.8 * G * fall - G * (sim.time - fall)
    assert sim.u == pytest.approx([expected] * 6, abs=1e-12)


def stop_of_the_brake(mass=20.0, inertia=0.05, drum=0.1, radius=0.15, mu=0.4, force=500.0, start=0.3, ramp=0.2):
    """When the load stops, and how far it has come: friction rises linearly during the ramp."""
    moved = mass + inertia / drum**2
    fall, brake = mass * G / moved, 2.0 * mu * force * radius / drum / moved
    end = start + ramp
    speed = fall * end - 0.5 * brake * ramp
    way = 0.5 * fall * end**2 - brake * ramp**2 / 6.0
    return end + speed / (brake - fall), way + 0.5 * speed**2 / (brake - fall)


def test_a_disc_brake_stops_its_load_as_computed_and_holds_it():
    sim = Simulation.from_file("disc_brake", method="dop853", live=["parameters.p"])  # no stages beyond the kinks
    sim.run(until=1.0)
    time, way = stop_of_the_brake()
    (event,) = sim.contact_events
    assert (event.change, event.time) == ("sticks", pytest.approx(time, abs=1e-12))
    assert sim.q[1] - 0.4 == pytest.approx(way, abs=1e-11)
    assert sim.losses.friction == pytest.approx(20.0 * G * way, abs=1e-9)
    held = sim.q.copy()
    sim.run(until=3.0)
    assert np.array_equal(sim.q, held)
    sim.set_live({"parameters.p": 1e5})  # 7.5 N m at rest, where the load needs 19.6 N m
    sim.run(until=3.001)
    assert sim.contacts()["lining"].state == "slides"
    sim.set_efforts({"pad": 100.0})  # 22.5 N m at rest, 18 N m while it slides
    sim.run(until=3.2)
    accelerated = (20.0 * G - 2.0 * 0.4 * 150.0 * 0.15 / 0.1) / 25.0
    before = sim.u[1]
    sim.run(until=3.3)
    assert sim.u[1] - before == pytest.approx(0.1 * accelerated, abs=1e-11)


def test_a_disc_brake_at_rest_holds_up_to_its_static_moment():
    most = 2.0 * 0.5 * 500.0 * 0.15 / (0.1 * G)
    sim = Simulation.from_file("disc_brake", set={"m": most, "start": -1.0}, live=["m"])
    for factor, state in ((1.0 - 1e-6, "sticks"), (1.0 + 1e-6, "slides")):
        sim.reset()
        sim.set_live({"m": factor * most})
        sim.run(until=0.1)
        assert sim.contacts()["lining"].state == state
        assert (abs(sim.u[1]) < 1e-25) == (state == "sticks")


def test_the_capacity_of_a_brake_can_be_a_live_value():
    sim = Simulation.from_text(
        """
mechanism: brake
parameters: {capacity: 3}
parts: {rotor: {mass: 1, center: [0, 0, 0], inertia: [0.5, 0.5, 0.5]}}
joints: {rotor: {type: revolute, between: [ground, rotor], axis: [0, 0, 1], velocity: 10}}
constraints: {brake: {type: clutch, terms: {rotor: 1}, capacity: capacity*(1 + t)}}
""",
        live=["parameters.capacity"],
    )
    sim.run(until=0.5)
    assert sim.u[0] == pytest.approx(10.0 - 6.0 * (0.5 + 0.125), abs=1e-12)
    sim.set_live({"parameters.capacity": 1.0})
    sim.run(until=1.0)
    assert sim.u[0] == pytest.approx(6.25 - 2.0 * (0.5 + 0.375), abs=1e-12)


def test_a_pin_with_play_stays_in_its_hole_and_the_linkage_moves_as_without_play():
    """With a smaller play the motion approaches that of the ideal linkage in proportion to it."""
    errors = []
    for play in (4e-3, 1e-3):
        sim = Simulation.from_file("four_bar_clearance", set={"play": play})
        least = 0.0
        for _ in range(30):
            sim.step(20)
            least = min(least, sim.contacts()["pin"].gap)
        assert least > -1e-14
        assert sim.losses.impact > 0.0
        assert abs(sim.energies.residual) < 1e-9
        errors.append(np.abs(sim.q[0] - crank_of_the_ideal_four_bar(sim.time)))
    assert errors[0] < 4e-2
    assert errors[1] < 0.4 * errors[0]


def crank_of_the_ideal_four_bar(time):
    sim = Simulation.from_file("four_bar", set={"joints.crank_pivot.velocity": 6.0})
    sim.run(until=time)
    return sim.q[0]


def test_a_pin_with_play_that_rebounds_without_friction_loses_no_energy():
    sim = Simulation.from_file("four_bar_clearance", set={"e": 1.0, "mu": 0.0})
    start = sim.energies.total
    sim.run(until=1.0)
    assert sum(event.change == "impact" for event in sim.contact_events) > 50
    assert sim.energies.total == pytest.approx(start, abs=1e-10)


def wheel_of_the_geneva_drive(time):
    """The angle of the wheel without play: it follows the pin for a quarter of the driver's turn."""
    radius, distance = 0.04, 0.04 * math.sqrt(2.0)
    turns, driver = divmod(2.0 * math.pi * time, 2.0 * math.pi)
    beyond = driver - math.pi  # the line of centers
    angle = math.copysign(math.pi / 4.0, beyond)
    if abs(beyond) < math.pi / 4.0:
        angle = math.atan2(radius * math.sin(beyond), distance - radius * math.cos(beyond))
    return -angle - turns * math.pi / 2.0


def test_a_geneva_drive_turns_its_wheel_by_a_quarter_in_each_turn():
    sim = Simulation.from_file("geneva_drive", method="tsitouras8")
    play = 2e-5 / (0.04 * (math.sqrt(2.0) - 1.0))  # of the pin where it is nearest to the wheel's axis
    largest = 0.0
    while sim.time < 1.0 - 1e-9:
        sim.step(10)
        largest = max(largest, abs(sim.q[0] - wheel_of_the_geneva_drive(sim.time)))
    assert 0.5 * play < largest < 1.01 * play
    assert abs(sim.energies.residual) < 1e-9
    assert {event.name for event in sim.contact_events} >= {"leading", "trailing"}


def test_the_locking_disc_of_a_geneva_drive_holds_its_wheel():
    """A moment on the wheel turns it only by the play of its horns."""
    sim = Simulation.from_file("geneva_drive", method="tsitouras8")
    sim.set_efforts({"wheel": 1.0})
    sim.run(until=0.2)
    lever = 0.04 * (math.sqrt(0.5) * 0.7 - math.sqrt(0.5) * math.sqrt(0.7505**2 - 0.7**2)) / 0.7505 * math.sqrt(2.0)
    assert sim.u[0] == pytest.approx(0.0, abs=1e-12)
    assert sim.q[0] - math.pi / 4.0 == pytest.approx(2e-5 / lever, rel=3e-3)
    contacts = [state for name, state in sim.contacts().items() if name.startswith("horn")]
    moment = sum(np.cross(state.point, state.force)[2] for state in contacts)
    assert moment == pytest.approx(-0.99, abs=2e-8)  # the bearing's friction bears the rest, up to its share


def test_a_pawl_holds_its_ratchet_in_a_notch():
    """The tip of the pawl is at the radius of the notches exactly, and statics gives both forces on it."""
    sim = Simulation.from_file("ratchet_and_pawl")
    angles = []
    for pulse in range(2):
        sim.run(until=pulse + 0.95)
        held = sim.q.copy()
        sim.run(until=pulse + 1.0)
        assert np.array_equal(sim.q, held)
        angles.append(held[0])
        assert held[1] == pytest.approx(math.radians(20.0), abs=1e-14)
    steps = np.array(angles) / (2.0 * math.pi / 12.0)
    assert steps == pytest.approx(np.round(steps), abs=1e-12)
    assert steps[0] > 0.0
    assert np.diff(steps) > 0.5
    contacts = sim.contacts().values()
    force = sum(state.force for state in contacts)
    tip, pivot = (
        np.array([0.0, 0.0, 0.05]),
        0.05 * np.array([math.cos(math.radians(20.0)), 0.0, 1.0 + math.sin(math.radians(20.0))]),
    )
    assert np.cross(tip, force)[1] == pytest.approx(0.5, abs=1e-10)  # the load
    assert np.cross(tip - pivot, force)[1] == pytest.approx(0.5 * 0.3, abs=1e-10)  # the spring
    assert all(state.normal > 0.0 for state in contacts)
    assert abs(sim.energies.residual) < 1e-11


JANSEN = dict(zip("abcdefghijklm", (38, 41.5, 39.3, 40.1, 55.8, 39.4, 36.7, 65.7, 49, 50, 61.9, 7.8, 15), strict=True))


def foot_of_jansens_leg(crank):
    """The foot of a left leg in the body's frame in m, by intersections of circles around the joints."""

    def meet(one, radius, other, further):
        """The intersection of two circles that is on the left, as seen from the first center to the second."""
        line = other - one
        along = (radius**2 - further**2 + abs(line) ** 2) / (2.0 * abs(line))
        return one + (along + 1j * math.sqrt(radius**2 - along**2)) * line / abs(line)

    n = JANSEN
    pin, hip = n["m"] * complex(math.cos(crank), math.sin(crank)), complex(-n["a"], -n["l"])
    top, knee = meet(hip, n["b"], pin, n["j"]), meet(pin, n["k"], hip, n["c"])
    out = meet(hip, n["d"], top, n["e"])
    low = meet(knee, n["g"], out, n["f"])
    return meet(knee, n["i"], low, n["h"]) * 1e-2


def jansen_feet(crank):
    """The feet of the legs by side and number, from the axle of the crank."""
    feet = {}
    for n, phase in ((1, 0.0), (2, math.pi)):
        feet[1, n] = foot_of_jansens_leg(crank + phase)
        feet[2, n] = -foot_of_jansens_leg(math.pi - crank - phase).conjugate()
    return feet


def test_the_legs_of_a_jansen_linkage_begin_on_their_branches():
    kinematics = Kinematics(load_mechanism("jansen_walker"))
    for (side, n), foot in jansen_feet(0.5 * math.pi).items():
        point = kinematics.point(f"shank_{side}_{n}.foot")
        assert complex(point[0], point[2]) == pytest.approx(foot, abs=1e-12)


@pytest.fixture(scope="module")
def walker():
    """With two of its four legs, which compiles in a third of the time; it walks for half a turn and then falls."""
    text = load_mechanism("jansen_walker").source.text.replace("n: 1..2", "n: 1..1")
    return Simulation.from_text(text, method="tsitouras8")


def test_a_walking_jansen_linkage(walker):
    standing, stood, sim = dict[str, np.ndarray](), set(), walker
    sim.reset()
    while sim.time < 0.9 - 1e-9:
        sim.step(20)
        body, feet = sim.q[0] + 1j * sim.q[1], jansen_feet(sim.drives()["crank"].position)
        for side in (1, 2):
            placed = body + feet[side, 1] * complex(math.cos(sim.q[2]), math.sin(sim.q[2]))
            point = sim.contacts()[f"foot_{side}_1"].point
            assert complex(point[0], point[2]) == pytest.approx(placed, abs=1e-12)
        for name, state in sim.contacts().items():
            assert state.gap > -1e-14
            if state.state == "sticks" and name in standing:
                assert np.max(np.abs(state.point - standing[name])) < 1e-13
        standing = {name: state.point for name, state in sim.contacts().items() if state.state == "sticks"}
        stood |= standing.keys()
    assert stood == {"foot_1_1", "foot_2_1"}
    assert abs(sim.energies.residual) < 1e-11
    assert sim.losses.impact > 0.5


def test_the_feet_of_a_jansen_linkage_carry_its_rate_of_momentum(walker):
    sim, parts = walker, walker.mechanism.parts
    sim.reset()
    mass = sim.mechanism.mass

    def center():
        poses = sim.poses()
        return (
            sum(part.mass * (poses[name].position + poses[name].rotation @ part.center) for name, part in parts.items())
            / mass
        )

    checked = 0
    for start in (0.3, 0.5, 0.8):
        sim.run(until=start)
        events, places = sim.contact_event_count, [center()]
        for number in range(4):
            sim.step(2)
            places.append(center())
            if number == 1:
                forces = sum(state.force for state in sim.contacts().values())
        if sim.contact_event_count > events:
            continue
        checked += 1
        weights = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / (12.0 * 2e-3**2)
        needed = mass * (sum(w * place for w, place in zip(weights, places, strict=True)) - sim.mechanism.gravity)
        assert forces == pytest.approx(needed, abs=1e-4 * mass * G)
    assert checked >= 2
