"""Motions with changing features: the same bits in every way of stepping, fast and driven bodies, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import DivergedError, Ensemble, MechanismError, Simulation
from mbd_sim.cli.main import main
from mbd_sim.compiler.steps.adams_history import COUNT
from mbd_sim.files.load import parse_mechanism

FALLING = """
mechanism: falling_capsule
parts:
  table: {shape: {type: block, size: [0.4, 0.4, 0.2], mass: 1, at: [0, 0, -0.1]}}
  bar: {shape: {type: capsule, radius: 0.03, length: 0.3, axis: [1, 0, 0], mass: 1}}
joints:
  table: {type: fixed, between: [ground, table]}
  bar: {type: free, between: [ground, bar], position: [0.1, 0.02, 0.1], orientation: {rpy: [0.1, 0.2, 0.3]}, velocity: [0.5, 0.2, 0]}
contacts: {c: {between: [bar, table], friction: 0.2, restitution: 0.4}}
"""


@pytest.fixture(scope="module")
def mechanism():
    return parse_mechanism(FALLING)


def test_steps_one_by_one_snapshots_and_copies_give_the_same_bits(mechanism):
    """Features are found again from the state, or are among the inputs: nothing else is kept."""
    sim = Simulation(mechanism, step=2e-3)
    sim.step(250)
    one = Simulation(mechanism, step=2e-3)
    for index in range(250):
        if index == 137:
            kept = one.snapshot()
        one.step()
    assert np.array_equal(one.y, sim.y)
    later = Simulation(mechanism, step=2e-3)
    later.step(3)
    later.restore(kept)
    copied = later.copy()
    for each in (later, copied):
        each.step(250 - 137)
        assert np.array_equal(each.y, sim.y)
    assert sim.contact_event_count > 5
    assert np.any(kept.inputs[sim.model.input_layout.one_sided])


ROLLING = """
mechanism: rolling_cylinder
gravity: [1, 0, -9.81]
parts:
  table: {shape: {type: block, size: [4, 1, 0.2], at: [0, 0, -0.1], mass: 1}}
  roller: {shape: {type: cylinder, radius: 0.1, length: 0.4, mass: 2, axis: [0, 1, 0]}}
joints:
  table: {type: fixed, between: [ground, table]}
  roller: {type: free, between: [ground, roller], position: [0, 0, 0.1]}
contacts: {c: {between: [roller, table], friction: 0.5}}
"""


def test_the_slopes_of_earlier_steps_count_although_rows_iterate_from_other_numbers_in_each_step():
    sim = Simulation.from_text(ROLLING)
    sim.step(50)
    kept = sim.snapshot()
    assert sim.history[COUNT] == 50
    sim.step(50)
    again = sim.copy()
    again.restore(kept)
    for _ in range(50):
        again.step()
    assert np.array_equal(again.y, sim.y)
    assert sim.q[0] == pytest.approx(0.1**2 / 3.0, rel=1e-14)


def test_members_of_an_ensemble_move_as_simulations_do(mechanism):
    ensemble = Ensemble(mechanism, 3, step=2e-3)
    sim = Simulation(mechanism, step=2e-3)
    starts = np.tile(sim.q, (3, 1))
    starts[1, 2], starts[2, 0] = 0.3, 0.16
    ensemble.reset(q=starts)
    ensemble.step(200)
    for q, found in zip(starts, ensemble.q, strict=True):
        sim.reset(q=q)
        sim.step(200)
        assert np.array_equal(sim.q, found)
        assert sim.contact_event_count > 0


def test_a_recording_verifies(tmp_path, capsys, mechanism):
    sim = Simulation(mechanism, step=2e-3)
    sim.run(until=0.2)
    with sim.recording(tmp_path / "run.mcap"):
        sim.run(until=0.5)
    assert main(["verify", str(tmp_path / "run.mcap")]) == 0
    assert "verified, bit for bit" in capsys.readouterr().out


BULLET = """
mechanism: bullet
gravity: [0, 0, 0]
parts:
  wall: {shape: {type: block, size: [5 mm, 1, 1], mass: 1}}
  ball: {shape: {type: sphere, radius: 5 mm, mass: 0.1, at: [0, 0.1, 0.1]}}
joints:
  wall: {type: fixed, between: [ground, wall]}
  ball: {type: prismatic, between: [ground, ball], axis: [1, 0, 0], position: POSITION, velocity: 60}
contacts: {c: {between: [ball, wall], restitution: 1}}
"""


def test_a_fast_ball_does_not_fly_through_a_thin_wall():
    """It passes the wall of 5 mm within one step of 1 ms: both ends of the step are free."""
    sim = Simulation(parse_mechanism(BULLET.replace("POSITION", "-0.53")), step=1e-3)
    sim.step(20)
    (event,) = sim.contact_events
    assert event.time == pytest.approx((0.53 - 0.0075) / 60, abs=1e-13)
    assert sim.motion("ball").velocity == pytest.approx([-60, 0, 0], abs=1e-10)


def test_a_start_inside_each_other_is_refused_with_the_depth():
    with pytest.raises(MechanismError, match=r"contacts\.c: at the start 'ball' is 0\.0\d+ m inside 'wall'"):
        Simulation(parse_mechanism(BULLET.replace("POSITION", "0.002")))


def test_prisms_beside_each_other_across_the_plane_of_motion_are_refused():
    text = """
mechanism: beside
parts:
  left: {shape: {type: block, size: [0.2, 1, 2], mass: 1, at: [-0.4, 0.6, 0]}}
  block: {shape: {type: block, size: [0.1, 0.1, 0.2], mass: 1}}
joints:
  left: {type: fixed, between: [ground, left]}
  block: {type: planar, between: [ground, block], axis: [0, 1, 0], x_axis: [1, 0, 0]}
contacts: {walls: {between: [block, left]}}
"""
    with pytest.raises(MechanismError, match=r"contacts\.walls: 'block' and 'left' never touch"):
        Simulation(parse_mechanism(text))


def test_what_only_drives_move_is_refused_as_it_meets_something():
    """No impulse can stop it; it must not pass through without a word either."""
    text = """
mechanism: driven
parts:
  wall: {shape: {type: block, size: [0.1, 1, 1], mass: 1, at: [0.3, 0, 0]}}
  ball: {shape: {type: sphere, radius: 0.05, mass: 1, at: [0, 0.1, 0.2]}}
  other: {shape: {type: sphere, radius: 0.05, mass: 1}}
joints:
  wall: {type: fixed, between: [ground, wall]}
  ball: {type: prismatic, between: [ground, ball], axis: [1, 0, 0], drive: t}
  other: {type: free, between: [ground, other], position: [3, 3, 3]}
contacts: {c: {between: [ball, wall]}}
"""
    sim = Simulation(parse_mechanism(text), step=1e-3)
    sim.step(199)
    with pytest.raises(DivergedError, match=r"at 0\.2 s the gap of c is closed by the drive of ball alone"):
        sim.step(10)


def test_too_many_rows_are_refused_with_their_number():
    names = [f"b{k}" for k in range(11)]
    parts = "\n".join(f"  {name}: {{shape: {{type: block, size: [1, 1, 1], mass: 1}}}}" for name in names)
    points = ", ".join(f"p{k}: [{2 * k}, 0, 0]" for k in range(11))
    joints = "\n".join(
        f"  {name}: {{type: spherical, between: [ground.p{k}, {name}]}}" for k, name in enumerate(names)
    )  # on free joints they would share slots
    head = f"mechanism: heap\nground: {{points: {{{points}}}}}\nparts:\n{parts}\njoints:\n{joints}"
    text = f"{head}\ncontacts: {{heap: {{among: [{', '.join(names)}], friction: 1}}}}"
    with pytest.raises(MechanismError, match=r"have 1320 rows, 1320 of them here; up to 1200 are possible"):
        Simulation(parse_mechanism(text))


SAMPLED = """
mechanism: sampled
parts:
  table: {shape: {type: block, size: [1, 1, 0.2], mass: 1, at: [0, 0, -0.1]}}
  ball: {shape: {type: sphere, radius: 0.05, mass: 1}}
  arm: {shape: {type: rod, to: [0.3, 0, 0], mass: 1}}
joints:
  table: {type: fixed, between: [ground, table]}
  ball: {type: free, between: [ground, ball], position: [0.1, 0, 0.3], velocity: [0.3, 0, 0]}
  arm: {type: revolute, between: [ground, arm], axis: [0, 1, 0], position: 0.5}
actuators:
  drive: {type: effort, joint: arm, servo: {controls: position, kp: 30, ki: 20, kd: 1, sample_rate: 1 kHz}, delay: 4 ms}
contacts: {c: CONTACT}
"""


def test_servos_keep_their_samples_in_steps_that_are_taken_again():
    """A step with an impact is undone after the servo has sampled: beside a plane, whose steps end before that."""
    found = []
    for contact in ("{between: [ball, table], restitution: 0.6}", "{parts: [ball], plane: ground, restitution: 0.6}"):
        sim = Simulation(parse_mechanism(SAMPLED.replace("CONTACT", contact)), step=1e-3)
        sim.step(700)
        assert sim.contact_event_count >= 3
        found.append(sim.y)
    assert found[0] == pytest.approx(found[1], rel=1e-9, abs=1e-10)
