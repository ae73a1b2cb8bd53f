"""No number with a dimension is hidden: a mechanism in other units moves with the same digits."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.analysis.equilibria.equilibrium import is_autonomous
from mbd_sim.analysis.linear.linearization import modes
from mbd_sim.base.errors import CommandError, MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from test.generators.scaled_mechanisms import Units, scaled

CONTACTS = [
    "backlash",
    "belt",
    "column_of_beads",
    "elbow_stop",
    "freewheel",
    "rope",
    "spinning_ball",
    "stops",
    "woodpecker",
]
LARGE = Units(length=1024.0**2, mass=1024.0**-2, time=1024.0**2)  # 1.05e6, without round-off
SMALL = Units(length=1024.0**-2, mass=1024.0**2, time=1024.0**-2)
DECIMAL = Units(length=1e-6, mass=1e-9, time=1e-6)  # µm, µg and µs in place of m, kg and s


def motion(mechanism, units):
    """Coordinates and speeds at some steps in the units of the file, the method, and the advice on the step."""
    simulation = Simulation(mechanism)
    lengths = [mechanism.coordinate(name).rotation for name in simulation.coordinate_names]
    factors = np.where(np.array(lengths, dtype=bool), 1.0, units.length)
    rows = []
    for steps in (1, 10, 200):
        simulation.step(steps)
        coordinates = np.array(simulation.model.coordinates(simulation.state))
        rows.append([*(coordinates / factors), *(simulation.u / factors * units.time)])
    return np.array(rows), simulation.model.method_name, simulation.step_advice is None, simulation.remarks != ()


@pytest.mark.parametrize(("name", "units"), [("air_spring", LARGE), ("snap_through", SMALL), ("scissor_lift", LARGE)])
def test_a_shipped_mechanism_moves_alike_in_other_units(name, units):
    """They differed by up to 5e-8, in the method that was chosen, and in the advice on the step."""
    expected, *choices = motion(scaled(name, Units()), Units())
    found, *others = motion(scaled(name, units), units)
    assert others == choices
    assert np.max(np.abs(found - expected), initial=0.0) <= 4e-13 * np.max(np.abs(expected), initial=0.0)


@pytest.mark.parametrize("name", ["motor_drive"])
def test_units_that_are_powers_of_ten_change_no_digit_but_the_last(name):
    expected, *choices = motion(scaled(name, Units()), Units())
    found, *others = motion(scaled(name, DECIMAL), DECIMAL)
    assert others == choices
    assert np.max(np.abs(found - expected)) <= 1e-11 * np.max(np.abs(expected))


def contact_motion(name, units):
    """Coordinates, and the events with their times, in the units of the file."""
    mechanism = scaled(name, units)
    simulation = Simulation(mechanism)
    simulation.step(200)
    rotations = np.array([mechanism.coordinate(name).rotation for name in simulation.coordinate_names])
    coordinates = np.array(simulation.model.coordinates(simulation.state)) / np.where(rotations, 1.0, units.length)
    events = [(event.name, event.change) for event in simulation.contact_events]
    return coordinates, events, np.array([event.time / units.time for event in simulation.contact_events])


@pytest.mark.parametrize("name", CONTACTS[1::4])
def test_contacts_have_the_same_events_in_other_units(name):
    """A belt differed by 5, a backlash and a stop by 0.1: gaps and slips were compared with numbers in m."""
    expected, events, times = contact_motion(name, Units())
    found, others, later = contact_motion(name, (LARGE, SMALL)[CONTACTS.index(name) % 2])
    assert others == events and later == pytest.approx(times, rel=1e-12)
    assert np.max(np.abs(found - expected)) <= 1e-12 * np.max(np.abs(expected))


@pytest.mark.parametrize(("name", "expected"), [("moving_support_pendulum", False), ("double_rod", True)])
def test_whether_a_mechanism_depends_on_time_is_the_same_in_other_units(name, expected):
    """Changes below 1e-9 in m/s² or rad/s² did not count, at times in s."""
    for units in (LARGE, SMALL):
        assert is_autonomous(derive(scaled(name, units))) is expected


OSCILLATOR = """
mechanism: oscillator
parts: {{block: {{mass: 1}}}}
joints: {{rail: {{type: prismatic, between: [ground, block], axis: [1, 0, 0], position: {amplitude}, stiffness: {stiffness}}}}}
"""


@pytest.mark.parametrize("amplitude", [1.0, 1e-9])
def test_a_small_motion_is_as_accurate_as_a_large_one(amplitude):
    """The error was 1.4e-13 of an amplitude of 1 m, and 3.6e-10 of one of 1 µm, as it was compared with 1 m."""
    mechanism = parse_mechanism(OSCILLATOR.format(amplitude=amplitude, stiffness=1e4))
    simulation = Simulation(mechanism, method="adams11")
    simulation.run(until=5.0)
    assert simulation.q[0] / amplitude == pytest.approx(np.cos(500.0), abs=1e-12)


@pytest.mark.parametrize("amplitude", [1.0, 1e-9])
def test_the_advice_on_a_step_does_not_depend_on_the_unit_of_length(amplitude):
    mechanism = parse_mechanism(OSCILLATOR.format(amplitude=amplitude, stiffness=1e5))
    simulation = Simulation(mechanism, method="rk4")
    simulation.run(until=1.0)
    assert "a step of 0.001 s is too large" in simulation.step_advice


FOUR_BAR = """
mechanism: four_bar
parameters: {{l: {k}}}
ground: {{points: {{d: [1.1*{k}, 0, 0]}}}}
parts:
  crank: {{mass: 1, inertia: [{i}, {i}, {i}], points: {{b: [0.3*{k}, 0, 0]}}}}
  coupler: {{mass: 1, inertia: [{i}, {i}, {i}], points: {{c: [l, 0, 0]}}}}
  rocker: {{mass: 1, inertia: [{i}, {i}, {i}], points: {{c: [0.7*{k}, 0, 0]}}}}
  block: {{mass: 1, points: {{p: [{off}, 0, 0]}}}}
joints:
  a: {{type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 1}}
  b: {{type: revolute, between: [crank.b, coupler], axis: [0, -1, 0], position: -0.8, guess: true}}
  d: {{type: revolute, between: [ground.d, rocker], axis: [0, -1, 0], position: 1.5, guess: true}}
  c: {{type: revolute, between: [coupler.c, rocker.c], axis: [0, -1, 0], cut: true}}
  rail: {{type: prismatic, between: [ground, block], axis: [1, 0, 0]}}
  slide: {{type: prismatic, between: [crank, bead], axis: [1, 0, 0], position: 0.1*{k}, stiffness: 1}}
forces:
  s: {{type: spring, between: [ground, block.p], stiffness: 1, length: {k}}}
""".replace("joints:\n", "  bead: {{mass: 1}}\njoints:\n")
SIZES = [1e-9]


def four_bar(size):
    """A four-bar linkage, and a block at the end of a spring of which the ends are 1e-4 of the size apart."""
    return parse_mechanism(FOUR_BAR.format(k=repr(size), i=repr(0.1 * size**2), off=repr(1e-4 * size)))


@pytest.mark.parametrize("size", SIZES)
def test_live_values_that_open_loops_are_refused_at_any_size(size):
    """Gaps below 1 µm were accepted, and with them any length of a linkage that is not larger."""
    simulation = Simulation(four_bar(size), live=["parameters.l"])
    with pytest.raises(CommandError, match="open the loops"):
        simulation.set_live({"l": 1.2 * size})
    simulation.set_live({"l": 1.2 * size}, reassemble=True)
    assert simulation.violation.position < 1e-9 * size


@pytest.mark.parametrize("size", SIZES)
def test_given_positions_and_speeds_that_loops_do_not_allow_are_refused_at_any_size(size):
    simulation = Simulation(four_bar(size))
    with pytest.raises(CommandError, match="cannot be closed"):
        simulation.set_state({"a": 1.0, "b": 0.3, "d": 1.2})
    with pytest.raises(CommandError, match="do not allow these speeds"):
        simulation.set_state(velocities={"a": 1.0, "b": 5.0, "d": 0.1})


@pytest.mark.parametrize("units", [LARGE])
def test_natural_modes_are_the_same_in_other_units(units):
    """Eigenvalues of zero, which round-off splits, were told from others by numbers in 1/s."""
    simulation = Simulation(scaled("spring_chain", units))
    free = parse_mechanism(
        FREE.format(k=repr(units.mass / units.time**2), m=repr(units.mass), step=repr(1e-3 * units.time))
    )
    found = [mode.frequency * units.time for mode in modes(Simulation(free).linearize())]
    assert found == pytest.approx([0.0] * 4 + [np.sqrt(300.0) / (2.0 * np.pi)], rel=1e-9, abs=1e-12)
    assert all(mode.frequency > 0.0 for mode in modes(simulation.linearize()))


FREE = """
mechanism: free
gravity: [0, 0, 0]
parts: {{a: {{mass: {m}}}, b: {{mass: 2*{m}}}, c: {{mass: 4*{m}}}}}
joints:
  a: {{type: prismatic, between: [ground, a], axis: [1, 0, 0]}}
  b: {{type: prismatic, between: [a, b], axis: [1, 0, 0], stiffness: 200*{k}}}
  c: {{type: prismatic, between: [ground, c], axis: [0, 1, 0]}}
integrator: {{step: {step}}}
"""


def test_the_ends_of_a_spring_coincide_by_parts_of_the_size():
    """Ends that were 0.1 pm apart coincided, in a mechanism of 1 nm too."""
    assert not Simulation(four_bar(1e-9)).u.any()
    with pytest.raises(MechanismError, match="the ends coincide at the start"):
        Simulation(parse_mechanism(FOUR_BAR.format(k="1.0", i="0.1", off="1e-13")))
