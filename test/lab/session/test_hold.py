"""Dragging a paused mechanism: loops stay closed, and stops are not passed."""

import numpy as np
import pytest

from mbd_sim import load_mechanism, parse_mechanism
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.lab.session.positions import PositionBench

LINKAGE = """
mechanism: linkage
parameters: {{base: 1.5 m, crank: {crank} cm, coupler: 1.4 m, rocker: 1.2 m}}
ground:
  points: {{pivot: [base, 0, 0]}}
parts:
  crank: {{mass: 0, points: {{tip: [crank, 0, 0]}}}}
  coupler: {{mass: 0, points: {{tip: [coupler, 0, 0]}}}}
  rocker: {{mass: 0, points: {{tip: [rocker, 0, 0]}}}}
joints:
  crank: {{type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 90 deg}}
  pin: {{type: revolute, between: [crank.tip, coupler], axis: [0, -1, 0], position: -60 deg, guess: true}}
  rocker: {{type: revolute, between: [ground.pivot, rocker], axis: [0, -1, 0], position: 100 deg, guess: true}}
  end: {{type: revolute, between: [coupler.tip, rocker.tip], axis: [0, -1, 0]}}
"""


@pytest.mark.parametrize("name", ["four_bar", "six_axis_arm", "slider_crank", "tumbling"])
def test_the_grabbed_point_comes_closer_with_loops_closed(name):
    bench = Bench.of(load_mechanism(name))
    simulation = bench.simulation
    part, point = list(simulation.wrench_map.slices)[-1], np.array([0.05, 0.02, 0.03])
    pose = simulation.poses()[part]
    start = pose.position + pose.rotation @ point
    target = start + np.array([0.04, 0.01, -0.03])
    bench.drag(part, point, target)
    moved = simulation.poses()[part]
    gap = np.linalg.norm(target - moved.position - moved.rotation @ point)
    assert gap < 0.99 * np.linalg.norm(target - start)
    assert simulation.violation.position < 1e-9
    assert abs(simulation.energies.residual) < 1e-9
    assert simulation.time == 0.0


def test_live_values_survive_what_a_hand_and_the_time_line_do():
    """A drag restores a state alone, winding back a whole point of the run."""
    session = OwnSession(Bench.of(load_mechanism("four_bar")), running=False)
    session.step(10)
    wound, simulation = simulation_values(session), session.bench.simulation
    session.change("parameters.coupler", 1.3)
    changed = simulation_values(session)
    assert changed != wound
    session.place("rocker", np.array([1.0, 0.0, 0.0]), np.array([1.2, 0.0, 1.2]))
    assert simulation_values(session) == changed
    simulation.set_state({simulation.coordinate_names[0]: 1.0})
    assert simulation_values(session) == changed
    session.wind_to(simulation.time)
    assert simulation_values(session) == wound
    assert simulation.violation.position < 1e-9


def simulation_values(session):
    """The live values by their keys, in the inputs of the equations, and in the mechanism."""
    simulation = session.bench.simulation
    places = simulation.inputs[simulation.model.input_layout.values].tolist()
    return simulation.live, places, simulation.mechanism.parameters


def test_a_free_body_is_dragged_onto_the_pointer():
    bench = Bench.of(load_mechanism("tumbling"))
    part = next(iter(bench.simulation.wrench_map.slices))
    target = np.array([0.2, -0.1, 0.3])
    for _ in range(4):
        bench.drag(part, np.array([0.01, 0.0, 0.0]), target)
    pose = bench.simulation.poses()[part]
    assert pose.position + pose.rotation @ [0.01, 0.0, 0.0] == pytest.approx(target, abs=1e-4)


def test_stops_are_not_passed():
    bench = Bench.of(load_mechanism("bounce"))
    part = next(iter(bench.simulation.wrench_map.slices))
    for _ in range(5):
        bench.drag(part, np.zeros(3), np.array([0.0, 0.0, -2.0]))
    gaps = [one.gap for one in bench.simulation.contacts().values()]
    assert min(gaps) > -1e-8


def test_a_linkage_without_masses_turns_and_stays_assembled():
    bench = PositionBench.driven(parse_mechanism(LINKAGE.format(crank=50)), "crank")
    start = bench.position
    rocker = bench.simulation.coordinate_names.index("rocker")
    side = []
    while bench.position < start + 2 * np.pi:
        bench.advance(3 * bench.period)
        assert bench.message == ""
        side.append(np.sin(bench.simulation.model.coordinates(bench.simulation.y)[rocker]))
    assert bench.simulation.violation.position < 1e-9
    assert min(side) > 0.0  # the branch of the start: the rocker swings above its pivot


def test_at_a_dead_point_the_drive_turns_back():
    """With a crank of 1.2 m it cannot pass where coupler and rocker are in line: cos of its angle by the triangle."""
    bench = PositionBench.driven(parse_mechanism(LINKAGE.format(crank=120)), "crank")
    dead = np.arccos((1.2**2 + 1.5**2 - (1.4 + 1.2) ** 2) / (2 * 1.2 * 1.5))
    positions = []
    for _ in range(400):
        bench.advance(3 * bench.period)
        positions.append(bench.position)
        if bench.message:
            break
    assert "turns back" in bench.message
    assert dead - np.radians(3.0) < max(positions) < dead + 1e-9
    bench.advance(3 * bench.period)
    assert bench.message == "" and bench.position < positions[-1]


PRESCRIBED = """
mechanism: table
parameters: {a: 20 mm, r: 10 cm}
parts:
  table: {mass: 0, points: {pin: [r, 0, 0]}}
  plate: {mass: 0, points: {rim: [1, 0, 0]}}
joints:
  shake: {type: prismatic, between: [ground, table], axis: [1, 0, 0], drive: a*cos(3*t)}
  turn: {type: revolute, between: [table.pin, plate], axis: [0, 0, 1], drive: "{command: position, bandwidth: 8, position: 30 deg}"}
""".replace('"', "")


@pytest.mark.parametrize(("drive", "start", "end"), [("shake", 0.02, 0.07), ("turn", np.pi / 6.0, 1.0)])
def test_a_joint_whose_motion_the_file_prescribes_is_moved_by_hand(drive, start, end):
    """Also after a length has changed, with which the mechanism is built again."""
    bench = PositionBench.driven(parse_mechanism(PRESCRIBED), drive)
    assert bench.position == pytest.approx(start, abs=1e-15)
    bench.simulation.set_live({"parameters.r": 0.2}, reassemble=True)
    bench.drive_to(end)
    assert bench.position == pytest.approx(end, abs=1e-12)
    rim = bench.simulation.point("plate.rim").position
    shift, angle = (end, np.pi / 6.0) if drive == "shake" else (0.02, end)
    assert rim == pytest.approx([shift + 0.2 + np.cos(angle), np.sin(angle), 0.0], abs=1e-9)


def test_the_force_of_a_hand_is_bounded_by_the_weight_of_the_mechanism():
    """However far the pointer is, and however fast the part moves; near it, the spring and the damper act alone."""
    bench = Bench.of(load_mechanism("rod_pendulum"))
    simulation = bench.simulation
    (part,) = simulation.wrench_map.slices
    most = 10.0 * 9.80665 * simulation.mechanism.mass
    point, far = np.array([0.0, 0.0, -0.3]), np.array([3e4, 0.0, 4e4])
    bench.take_hold(part, point, far)
    place, force = bench.hold.acting(simulation)
    assert np.linalg.norm(force) == pytest.approx(most, rel=1e-12)
    assert np.cross(force, far - place) == pytest.approx(np.zeros(3), abs=1e-6 * most)
    bench.advance(10 * bench.period)
    near = simulation.poses()[part].position + simulation.poses()[part].rotation @ point + [1e-4, 0.0, 0.0]
    simulation.set_state({}, dict.fromkeys(simulation.coordinate_names, 0.0))
    bench.pull_to(near)
    assert bench.hold.acting(simulation)[1] == pytest.approx([1e-4 * bench.hold.stiffness, 0.0, 0.0], rel=1e-6)
