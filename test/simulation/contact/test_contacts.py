"""One-sided elements: twelve systems against values that were computed apart from this project, and what must hold."""

from __future__ import annotations

import math
import signal

import numpy as np
import pytest

from mbd_sim import DivergedError, MechanismError, Simulation
from mbd_sim.compiler.ir.python_kinds import Array
from mbd_sim.simulation.contact import stepper
from mbd_sim.simulation.contact.compiled import library, search
from mbd_sim.simulation.contact.compiled.instant import forces
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts
from mbd_sim.simulation.contact.compiled.instant.forces import ForceProblem
from mbd_sim.simulation.contact.compiled.trial import TrialPart
from mbd_sim.simulation.contact.problem import NoSolutionError

# End time, q, u and event times, from hand-written equations and closed forms at 1e-13.
REFERENCE = {
    "bounce": (
        3.0,
        [0.0687074609658],
        [-0.0153541333847],
        [0.45152364099, 1.1739614666, 1.751911727, 2.2142719354, 2.5841601021],
    ),
    "bowling": (3.0, [14.1053485614, 88.5148054218], [4.28571428571, 38.961038961], [1.4562399884]),
    "incline": (1.2, [-0.0411146045265], [-1.67142596018], [0.41175477457]),
    "belt": (
        3.0,
        [0.0345013768253],
        [-0.2273770284],
        [0.1962, 0.69765481942, 0.84480481942, 1.3462596388, 1.4934096388],
    ),
    "rope": (
        3.0,
        [0.414672476083, -0.909970734463],
        [-0.652985696416, -0.297564729639],
        [0.48133347573, 1.2563488379],
    ),
    "rocking": (
        2.5,
        [0.0619467530613],
        [-0.149108798522],
        [0.56367575705, 1.2534759101, 1.7991658333, 2.2565538606],
    ),
    "stops": (
        1.5,
        [0.166097603894],
        [-1.28426888664],
        [0.076482606821, 0.28690571311, 0.56791542138, 0.92749412845, 1.3646354134],
    ),
    "backlash": (
        1.2,
        [0.309939099737, 0.266286725836],
        [0.0395380696082, 0.438583182159],
        [0.14252391234, 0.26500201353, 0.43255684992, 0.65451919345, 0.77820069594],
    ),
    "freewheel": (
        4.0,
        [7.65121073333],
        [1.27253702201],
        [0.036444824312, 0.84205882112, 1.0836423755, 1.8892563723, 2.1308399267],
    ),
    "elbow_stop": (
        2.0,
        [-0.382500376008, -0.240324373298],
        [-1.32521181594, -3.44797011378],
        [0.19370543119, 0.45429357328, 1.7180099021],
    ),
    "slider_crank_friction": (0.5, [14.3241442932], [26.5600132399], []),
    "spinning_ball": (
        1.1,
        [-0.357075644989, 0.111135922361, -31.0731088753],
        [-0.714285714286, 0.239623565783, -7.14285714286],
        [0.42835293688, 0.85670587376, 1.0708823422],
    ),
}
# The index of each reference coordinate in q, and the sign of the file's coordinate.
COORDINATES = {
    "bowling": ([0, 2], [1.0, 1.0]),
    "rocking": ([2], [1.0]),
    "spinning_ball": ([0, 1, 2], [1.0, -1.0, 1.0]),
    "slider_crank_friction": ([0], [1.0]),
}


def reference_coordinates(name, values):
    if name == "elbow_stop":
        return np.cumsum(values)  # absolute angles
    index, sign = COORDINATES.get(name, (list(range(len(values))), [1.0] * len(values)))
    return values[index] * sign


@pytest.mark.parametrize("name", REFERENCE)
def test_a_reference_system(name):
    end, q, u, times = REFERENCE[name]
    sim = Simulation.from_file(name)
    sim.run(until=end)
    assert reference_coordinates(name, sim.q) == pytest.approx(q, abs=1e-10)
    assert reference_coordinates(name, sim.u) == pytest.approx(u, abs=3e-10)
    found = np.array([event.time for event in sim.contact_events])
    for time in times:
        assert np.min(np.abs(found - time)) < 1e-10
    assert abs(sim.energies.residual) < 1e-11


@pytest.mark.parametrize(
    ("name", "method", "tolerance"), [("belt", "rk4", 1e-9), ("elbow_stop", "gauss4", 1e-9), ("rope", "dop853", 1e-10)]
)
def test_other_methods_keep_their_accuracy_through_events(name, method, tolerance):
    end, q, u, _ = REFERENCE[name]
    sim = Simulation.from_file(name, method=method)
    sim.run(until=end)
    assert reference_coordinates(name, sim.q) == pytest.approx(q, abs=tolerance)
    assert reference_coordinates(name, sim.u) == pytest.approx(u, abs=tolerance)


def test_rk4_keeps_its_order_through_events():
    def error(step):
        sim = Simulation.from_file("elbow_stop", method="rk4", step=step)
        sim.run(until=2.0)
        return np.max(np.abs(np.cumsum(sim.q) - REFERENCE["elbow_stop"][1]))

    assert error(8e-3) / error(2e-3) > 0.5 * 4.0**4


def test_what_sticks_does_not_move_at_all():
    sim = Simulation.from_file("incline", set={"v0": 0.0, "alpha": 0.29})
    assert sim.contacts()["along.friction"].state == "sticks"
    sim.step(100_000)
    assert sim.q.tolist() == [0.0]
    assert sim.u.tolist() == [0.0]
    friction = sim.contacts()["along.friction"].friction
    assert friction == pytest.approx([9.81 * math.sin(0.29)], abs=1e-14)


def test_infinitely_many_rebounds_end():
    sim = Simulation.from_file("bounce")
    sim.run(until=10.0)
    floor = sim.contacts()["floor"]
    assert (floor.state, sim.u.tolist()) == ("closed", [0.0])
    assert abs(sim.q[0]) < 1e-15
    assert floor.normal == pytest.approx(9.81, abs=1e-13)
    rests = math.sqrt(2.0 / 9.81) * (1.0 + 0.8) / (1.0 - 0.8)  # the sum of all flights
    assert sim.contact_events[-1].time == pytest.approx(rests, abs=1e-5)
    assert sim.losses.impact == pytest.approx(9.81, abs=1e-12)
    assert sim.energies.residual == pytest.approx(0.0, abs=1e-12)


def test_the_closed_form_of_housners_rocking_block():
    """Each impact multiplies the rotation by 1 - 3/2 sin² α; all three follow one another without other losses."""
    sim = Simulation.from_file("rocking", set={"th0": 0.1})
    sim.run(until=2.0)
    kept = (1.0 - 1.5 * math.sin(math.atan(0.1 / 0.4)) ** 2) ** 2  # of the energy of rotation
    losses = [event.loss for event in sim.contact_events if event.change == "impact"]
    fall = 9.81 * (0.1 * math.sin(0.1) + 0.4 * math.cos(0.1) - 0.4)  # from the tilt th0 to upright
    assert losses[:3] == pytest.approx([fall * (1.0 - kept) * kept**count for count in range(3)], rel=1e-11)


def test_losses_tell_impacts_and_friction_apart():
    sim = Simulation.from_file("spinning_ball")
    sim.run(until=3.0)
    assert sim.losses.impact + sim.losses.friction == pytest.approx(sim.energies.dissipated, abs=1e-12)
    assert sim.losses.impact > 1.0
    belt = Simulation.from_file("belt")
    belt.run(until=3.0)
    assert belt.losses.impact == 0.0
    assert belt.losses.friction == pytest.approx(belt.energies.dissipated, abs=1e-14)
    smooth = Simulation.from_file("double_rod")
    assert (smooth.losses, smooth.contacts(), smooth.contact_events) == ((0.0, 0.0), {}, ())


FOUR_BAR_WITH_STOP = """
mechanism: stopped_four_bar
parts:
  crank: {shape: {type: rod, mass: 1, to: [0.2, 0, 0]}, points: {tip: [0.2, 0, 0]}}
  coupler: {shape: {type: rod, mass: 1, to: [0.5, 0, 0]}, points: {tip: [0.5, 0, 0]}}
  rocker: {shape: {type: rod, mass: 1, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
ground: {points: {far: [0.55, 0, 0]}}
joints:
  crank: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 60 deg}
  pin: {type: revolute, between: [crank.tip, coupler], axis: [0, -1, 0], guess: true, position: -40 deg}
  rocker:
    type: revolute
    between: [ground.far, rocker]
    axis: [0, -1, 0]
    guess: true
    position: 100 deg
    limits: {lower: 60 deg, upper: 120 deg, restitution: 0.6}
  joint: {type: revolute, between: [coupler.tip, rocker.tip], axis: [0, -1, 0]}
"""


def test_an_impact_in_a_loop_goes_through_all_of_it():
    sim = Simulation.from_text(FOUR_BAR_WITH_STOP)
    rocker = sim.coordinate_names.index("rocker")
    while not sim.contact_events:
        before = sim.u.copy()
        sim.step(1)
        assert sim.time < 5.0
    first = sim.contact_events[0]
    assert (first.change, first.name) == ("impact", "rocker.upper_limit")
    assert sim.u[rocker] == pytest.approx(-0.6 * before[rocker], rel=0.05)  # the step goes on before and after
    assert np.sign(sim.u[0]) == -np.sign(before[0])
    sim.run(until=5.0)
    assert sim.violation.position < 1e-13
    assert len(sim.contact_events) > 3
    assert abs(sim.energies.residual) < 1e-12


@pytest.mark.parametrize("name", ["stops", "newtons_cradle"])
def test_an_interrupt_leaves_state_and_time_together(name):
    """Wherever it arrives in a call: then the call has not begun."""

    def interrupt(*_):
        raise KeyboardInterrupt

    sim, other = Simulation.from_file(name), Simulation.from_file(name)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for delay in (0.003, 0.01, 0.03):
            with pytest.raises(KeyboardInterrupt):
                signal.setitimer(signal.ITIMER_REAL, delay)
                while True:
                    sim.step(700)
    finally:
        signal.signal(signal.SIGALRM, before)
    other.step(sim.steps)
    assert sim.state.tobytes() == other.state.tobytes() and sim.inputs.tobytes() == other.inputs.tobytes()


def test_a_state_alone_finds_its_contacts_again():
    sim, other = (Simulation.from_file("belt") for _ in range(2))
    sim.run(until=0.75)
    other.restore(sim.state, steps=sim.steps, start_energy=sim.start_energy)
    sim.run(until=2.0)
    other.run(until=2.0)
    assert other.q == pytest.approx(sim.q, abs=1e-14)


def test_an_effort_opens_and_closes_a_contact():
    sim = Simulation.from_file("bounce", set={"h": 0.0})
    assert sim.contacts()["floor"].state == "closed"
    sim.set_efforts([9.0])
    sim.step(10)
    assert sim.contacts()["floor"].normal == pytest.approx(0.81, abs=1e-13)
    sim.set_efforts([10.0])
    sim.step(100)
    assert sim.contacts()["floor"].state == "open"
    assert sim.q[0] == pytest.approx(0.5 * 0.19 * 0.1**2, abs=1e-12)
    assert [(event.change, event.time) for event in sim.contact_events] == [("opened", pytest.approx(0.01))]


TURNING = """
mechanism: turning
gravity: [0, 0, 9.81]
integrator: {{step: 10 ms}}
parts:
  ball: {{shape: {{type: particle, mass: 1}}}}
joints:
  slide: {{type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: {height}, velocity: {speed}}}
constraints:
  floor: {{type: on_plane, point: ball, bound: at_least, restitution: 1}}
"""


def test_a_gap_that_would_be_negative_only_within_a_step_closes():
    """Gravity that acts upwards turns a ball in the middle of a step, this much below the floor or above it."""
    speed = 0.055 * 9.81
    simulation = Simulation.from_text(TURNING.format(height=1.0, speed=-speed))
    for depth in (1e-9, 1e-6, 1e-4, -1e-9):
        simulation.reset(q=[speed**2 / (2 * 9.81) - depth], u=[-speed])
        simulation.run(until=0.1)
        times = [event.time for event in simulation.contact_events]
        expected = [(speed - math.sqrt(2 * 9.81 * depth)) / 9.81] if depth > 0.0 else []
        assert times == pytest.approx(expected, abs=1e-11)


@pytest.mark.usefixtures("compiled_anew")
def test_gaps_far_from_zero_are_not_searched_and_impacts_without_a_solution_name_their_contacts(monkeypatch):
    def no_impulses(*_):
        raise NoSolutionError("none")

    text = TURNING.format(height=1.0, speed=-0.055 * 9.81)
    simulation = Simulation.from_text(text)
    monkeypatch.setattr(search, "grazing", fails_when_grazing)
    monkeypatch.setattr(stepper, "impact", no_impulses)
    monkeypatch.setattr(forces, "newton", no_solution)  # leaves the impact to the other one
    library.library.cache_clear()
    simulation.run(until=0.1)
    assert simulation.u[0] > 0.0
    simulation.reset(q=[(0.055 * 9.81) ** 2 / (2 * 9.81) - 1e-6])
    with pytest.raises(DivergedError):  # so that this test can fail
        simulation.run(until=0.1)
    expected = r"at 0\.45\d+ s no impulses satisfy the laws of impact and friction \(floor\)\. Reduce the friction"
    with pytest.raises(stepper.EventError, match=expected):
        Simulation.from_file("bounce").run(until=1.0)


def fails_when_grazing(c: Contacts, m: TrialPart, gap: int, first: float) -> float:
    """In place of the search within a step; compiled."""
    m.failed[0] = 1
    m.y[0] = math.inf  # for shorter parts as well
    return first


def test_reactions_include_contact_forces():
    sim = Simulation.from_file("stops", set={"v0": 0.0, "lim": 0.1})
    sim.set_efforts([50.0])
    sim.run(until=3.0)
    assert sim.contacts()["slide.upper_limit"].state == "closed"
    assert sim.contacts()["slide.upper_limit"].normal == pytest.approx(50.0 - 20.0 * 0.1, abs=1e-10)
    rope = Simulation.from_file("rope", set={"v0": 0.0})
    rope.step(1)
    assert rope.contacts()["rope"].normal == pytest.approx(9.81, abs=1e-12)
    assert np.linalg.norm(rope.reactions()["x"].force) < 1e-12  # the rope carries the ball, not its guide


def test_restitution_can_be_live():
    sim = Simulation.from_file("bounce", live=["parameters.e"])
    sim.set_live({"parameters.e": 0.5})
    sim.run(until=0.5)
    after = math.sqrt(2.0 * 9.81) * 0.5 - 9.81 * (0.5 - math.sqrt(2.0 / 9.81))
    assert sim.u[0] == pytest.approx(after, abs=1e-12)


def test_friction_that_depends_on_the_load_holds_up_to_its_static_size():
    text = """
mechanism: loaded
parts:
  block: {shape: {type: block, mass: 2, size: [0.1, 0.1, 0.1]}}
joints:
  slide: {type: prismatic, between: [ground, block], axis: [1, 0, 0], friction: {coefficient: 0.3, static_coefficient: 0.4}}
"""
    sim = Simulation.from_text(text)
    sim.set_efforts([0.39 * 2 * 9.81])
    sim.step(50)
    assert (sim.contacts()["slide.friction"].state, sim.u.tolist()) == ("sticks", [0.0])
    sim.set_efforts([0.41 * 2 * 9.81])
    sim.step(100)
    assert sim.contacts()["slide.friction"].state == "slides"
    assert sim.u[0] == pytest.approx(0.11 * 9.81 * 0.1, rel=1e-12)


def test_a_bearing_with_load_dependent_friction_brakes_a_rotor():
    """A balanced rotor on a horizontal axis: the moment μ r m g is constant."""
    text = """
mechanism: rotor
parts:
  rotor: {mass: 3, center: [0, 0, 0], inertia: [0.02, 0.02, 0.02]}
joints:
  bearing:
    type: revolute
    between: [ground, rotor]
    axis: [0, 1, 0]
    velocity: 10
    friction: {coefficient: 0.1, radius: 20 mm}
"""
    sim = Simulation.from_text(text)
    moment = 0.1 * 0.02 * 3 * 9.81
    sim.run(until=1.0)
    assert sim.u[0] == pytest.approx(10.0 - moment / 0.02, rel=1e-12)
    sim.run(until=10.0 * 0.02 / moment + 0.5)
    assert sim.u.tolist() == [0.0]
    assert sim.losses.friction == pytest.approx(1.0, rel=1e-12)


def no_solution(p: ForceProblem, forces: Array, is_regular: bool) -> float:
    """In place of Newton's method; compiled."""
    return 1.0


def test_methods_for_stiff_mechanisms_refuse_contacts():
    with pytest.raises(MechanismError, match=r"rosenbrock cannot treat one-sided elements \(constraints\.floor\)"):
        Simulation.from_file("bounce", method="rosenbrock")


def test_what_is_open_is_linearized_as_if_it_were_not_there():
    sim = Simulation.from_file("bounce")
    assert np.array_equal(sim.linearize().a, [[0.0, 1.0], [0.0, 0.0]])
    assert sim.inverse_dynamics([0.0]) == pytest.approx([9.81], abs=1e-14)


class Seen:
    def __init__(self):
        self.impacts, self.events = [], []

    def impact(self, time, before, after):
        self.impacts.append((time, before, after))

    def event(self, event):
        self.events.append(event)


def test_an_observer_sees_events_and_the_energies_of_impacts_and_changes_nothing():
    plain, observed, seen = Simulation.from_file("bounce"), Simulation.from_file("bounce"), Seen()
    observed.observe_contacts(seen)
    for sim in (plain, observed):
        sim.run(until=2.0)
    assert observed.state.tobytes() == plain.state.tobytes()
    assert tuple(seen.events) == observed.contact_events == plain.contact_events
    losses = [before - after for _, before, after in seen.impacts]
    assert [time for time, _, _ in seen.impacts] == [event.time for event in seen.events]
    assert losses == pytest.approx([event.loss for event in seen.events], abs=1e-13)
    assert losses[0] == pytest.approx((1.0 - 0.8**2) * 9.81, abs=1e-12)  # of m g h
    count = len(seen.events)
    observed.observe_contacts(None)
    observed.run(until=3.0)
    assert observed.contact_event_count > len(seen.events) == count


class Failing(Seen):
    """Fails at its third event."""

    def event(self, event):
        super().event(event)
        if len(self.events) == 3:
            raise KeyError(event.name)


@pytest.mark.parametrize("steps", [100, 6000])
def test_an_observer_that_fails_ends_the_steps_and_nothing_has_changed(steps):
    """Also where there are more events than the memory of one call holds, which are passed on in between."""
    sim, seen = Simulation.from_file("bounce", set={"parameters.e": 1, "parameters.h": "0.1 mm"}), Failing()
    before = sim.state.tobytes()
    sim.observe_contacts(seen)
    with pytest.raises(KeyError, match="floor"):
        sim.step(steps)
    assert (sim.state.tobytes(), sim.time, len(seen.events)) == (before, 0.0, 3)


def test_without_one_sided_elements_there_is_nothing_to_observe():
    with pytest.raises(ValueError, match="mechanism 'double_rod' has no one-sided elements to observe"):
        Simulation.from_file("double_rod").observe_contacts(Seen())
