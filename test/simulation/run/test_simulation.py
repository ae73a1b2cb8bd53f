"""`Simulation`: steps, resets, commands and readings; an error leaves everything unchanged."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mbd_sim
from mbd_sim import CommandError, DivergedError, Simulation
from test.generators.mechanisms import FLOATING, PROJECTILE, audited

LIMITED = """
mechanism: limited
parameters: {l: 1}
parts:
  upper: {mass: 1, shape: {type: rod, to: [0, 0, -l]}, points: {tip: [0, 0, -l]}}
  lower: {mass: 1, shape: {type: rod, to: [0, 0, -l]}}
joints:
  shoulder: {type: revolute, between: [ground, upper], axis: [0, -1, 0], position: 1.2, effort_limit: 5}
  elbow: {type: revolute, between: [upper.tip, lower], axis: [0, -1, 0]}
"""


@pytest.fixture
def sim():
    return Simulation.from_text(LIMITED)


def snapshot(sim):
    """Everything that a failed call must leave unchanged."""
    return sim.state.tolist(), sim.efforts.tolist(), sim.steps, sim.time, sim.start_energy


def test_start(sim):
    assert sim.q.tolist() == [1.2, 0.0] and sim.u.tolist() == [0.0, 0.0]
    assert (sim.steps, sim.time, sim.step_size) == (0, 0.0, 1e-3)
    assert sim.coordinate_names == ("shoulder", "elbow")
    assert sim.energies.residual == 0.0 and sim.energies.kinetic == 0.0
    assert sim.efforts.tolist() == [0.0, 0.0]


def test_step_and_run_take_the_same_steps(sim):
    other = Simulation.from_text(LIMITED)
    sim.run(until=0.5)
    other.step(100)
    for _ in range(400):
        other.step()
    assert sim.steps == other.steps == 500
    assert sim.state.tobytes() == other.state.tobytes()


def test_run_goes_to_the_nearest_step(sim):
    sim.run(until=0.0104)
    assert sim.steps == 10
    sim.run(until=0.0106)
    assert sim.steps == 11


def test_run_reports_its_progress(sim):
    times = []
    sim.run(until=50.0, progress=times.append)
    assert times[-1] == sim.time == 50.0
    assert times == sorted(times) and len(times) >= 2


def test_no_steps_change_nothing(sim):
    sim.step(5)
    before = snapshot(sim)
    sim.step(0)
    assert snapshot(sim) == before


def test_negative_steps_are_refused(sim):
    before = snapshot(sim)
    with pytest.raises(ValueError, match="not -3"):
        sim.step(-3)
    assert snapshot(sim) == before


def test_time_does_not_drift():
    sim = Simulation.from_file("rod_pendulum", step=0.1)
    for _ in range(1000):
        sim.step()
    assert sim.time == 1000 * 0.1 == 100.0
    assert np.cumsum(np.full(1000, 0.1))[-1] != 100.0  # what adding up would give


@pytest.mark.parametrize("step", [0.0, -1e-3, math.nan, math.inf])
def test_steps_that_are_no_positive_time_are_refused(step):
    with pytest.raises(ValueError, match="positive number of seconds"):
        Simulation.from_file("rod_pendulum", step=step)


def test_step_and_method_can_be_replaced():
    sim = Simulation.from_file("rod_pendulum", method="rk4", step=5e-3)
    assert (sim.model.method.name, sim.step_size) == ("rk4", 5e-3)


def test_views_are_read_only_and_live(sim):
    q, u, efforts = sim.q, sim.u, sim.efforts
    for view in (q, u, efforts):
        with pytest.raises(ValueError, match="read-only"):
            view[0] = 1.0
    sim.set_efforts([1.0, 2.0])
    sim.step()
    assert q is sim.q and u[1] == sim.u[1] != 0.0 and efforts.tolist() == [1.0, 2.0]


def test_the_state_is_a_copy(sim):
    state = sim.state
    state[:] = 7.0
    assert sim.q[0] == 1.2


class TestReset:
    def test_back_to_the_start(self, sim):
        start = sim.state.tobytes()
        sim.set_efforts([3.0, 1.0])
        sim.step(100)
        sim.reset()
        assert sim.state.tobytes() == start
        assert (sim.steps, sim.time) == (0, 0.0)
        assert sim.efforts.tolist() == [0.0, 0.0]
        assert sim.energies.residual == sim.energies.work_applied == 0.0

    def test_to_a_given_state(self, sim):
        sim.step(10)
        sim.reset(q=[0.1, 0.2], u=np.array([1, -1]))
        assert sim.q.tolist() == [0.1, 0.2] and sim.u.tolist() == [1.0, -1.0]
        assert sim.energies.residual == 0.0 and sim.energies.kinetic > 0.0
        sim.reset(u=[0.5, 0.0])
        assert sim.q.tolist() == [1.2, 0.0] and sim.u.tolist() == [0.5, 0.0]

    def test_a_run_can_be_repeated_bit_for_bit(self, sim):
        def motion():
            sim.reset(q=[0.4, -0.3])
            sim.set_efforts({"elbow": 0.5})
            sim.step(200)
            return sim.state.tobytes()

        assert motion() == motion()

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"q": [1.0]}, "q must be a list of 2 values, not an array of shape \\(1,\\)"),
            ({"u": [1.0, 2.0, 3.0]}, "u must be a list of 2 values, not an array of shape \\(3,\\)"),
            ({"q": [[1.0, 2.0]]}, "q must be a list of 2 values"),
            ({"q": [1.0, math.nan]}, "q contains a value that is not finite."),
            ({"q": [0.5, 0.5], "u": [math.inf, 0.0]}, "u contains a value that is not finite."),
        ],
    )
    def test_errors_change_nothing(self, sim, change, message):
        sim.set_efforts([1.0, 0.5])
        sim.step(7)
        before = snapshot(sim)
        with pytest.raises(ValueError, match=message):
            sim.reset(**change)
        assert snapshot(sim) == before

    def test_quaternions_are_made_unit(self):
        sim = Simulation.from_file("tumbling")
        sim.reset(q=[1, 2, 3, 2.0, 0.0, 0.0, 2.0])
        assert sim.q.tolist() == [1, 2, 3, *[pytest.approx(value) for value in (0.5**0.5, 0, 0, 0.5**0.5)]]

    def test_a_zero_quaternion_is_refused(self):
        sim = Simulation.from_file("tumbling")
        sim.step()
        before = snapshot(sim)
        with pytest.raises(ValueError, match="quaternion of joint 'flight' is zero"):
            sim.reset(q=[0.0] * 7)
        assert snapshot(sim) == before


class TestEfforts:
    def test_all_in_order(self, sim):
        sim.set_efforts([1.0, -2.0])
        assert sim.efforts.tolist() == [1.0, -2.0]
        sim.set_efforts(np.array([0, 3]))
        assert sim.efforts.tolist() == [0.0, 3.0]

    def test_some_by_name(self, sim):
        sim.set_efforts([1.0, -2.0])
        sim.set_efforts({"elbow": 4.0})
        assert sim.efforts.tolist() == [1.0, 4.0]
        sim.set_efforts({})
        assert sim.efforts.tolist() == [1.0, 4.0]

    def test_they_act_from_the_next_step_on(self, sim):
        sim.reset(q=[0.0, 0.0])
        sim.set_efforts({"shoulder": 1.0})
        assert sim.u.tolist() == [0.0, 0.0]
        sim.step()
        # a rod of 4/3 kg m² about the shoulder with another at its tip: 12/7 rad/s² for 1 N m
        assert sim.u[0] == pytest.approx(12.0 / 7.0 * 1e-3, rel=1e-3)

    def test_they_are_clamped_to_the_limits(self, sim):
        sim.set_efforts([9.0, 9.0])
        assert sim.efforts.tolist() == [5.0, 9.0]
        sim.set_efforts({"shoulder": -1e300})
        assert sim.efforts.tolist() == [-5.0, 9.0]

    def test_free_joints_have_six_names(self):
        sim = Simulation.from_text(PROJECTILE)
        assert sim.coordinate_names == tuple(f"flight.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))
        sim.set_efforts({"flight.rz": 2.0})
        assert sim.efforts.tolist() == [0, 0, 0, 0, 0, 2.0]

    @pytest.mark.parametrize(
        ("efforts", "message"),
        [
            ([1.0], "2 efforts expected, but 1 given.*shoulder, elbow"),
            ([1.0, 2.0, 3.0], "2 efforts expected, but 3 given"),
            ([1.0, math.nan], "elbow.*not .*finite"),
            ({"shoulder": math.inf}, "shoulder.*not .*finite"),
            ({"elbow": 1.0, "elbw": 2.0}, "no joint 'elbw'. Did you mean 'elbow'?"),
            ({"elbow": "fast"}, "not a number"),
            (["a", "b"], "not a number"),
            (["1", "2"], "'1' is a text"),
            ([[1.0, 2.0], [3.0, 4.0]], "not a number"),
        ],
    )
    def test_errors_change_nothing(self, sim, efforts, message):
        sim.set_efforts([0.5, 0.25])
        before = snapshot(sim)
        with pytest.raises(CommandError, match=message):
            sim.set_efforts(efforts)
        assert snapshot(sim) == before


def test_divergence_keeps_the_last_state(sim):
    sim.step(50)
    sim.set_efforts({"elbow": 1e300})
    before = snapshot(sim)
    with pytest.raises(DivergedError, match=r"limited: the state .* between t = 0\.05 s and 0\.06 s"):
        sim.step(10)
    assert snapshot(sim) == before
    sim.set_efforts([0.0, 0.0])
    sim.step(10)
    assert sim.steps == 60 and np.all(np.isfinite(sim.state))


def test_a_stiff_spring_with_a_large_step_diverges_by_name():
    text = LIMITED.replace("position: 1.2,", "position: 1.2, stiffness: 1e9,")
    sim = Simulation.from_text(text, step=0.1, method="tsitouras8")
    with pytest.raises(DivergedError, match=r"A step of 0\.1 s is too large .* method rosenbrock"):
        sim.run(until=100.0)
    assert np.all(np.isfinite(sim.state))


def test_quaternions_stay_unit():
    sim = Simulation.from_text(FLOATING)
    for _ in range(200):
        sim.step(10)
        assert np.linalg.norm(sim.q[3:7]) == pytest.approx(1.0, abs=3e-16)


def test_two_simulations_do_not_share_a_state():
    first, second = Simulation.from_text(LIMITED), Simulation.from_text(LIMITED)
    first.set_efforts([1.0, 1.0])
    first.step(10)
    assert second.steps == 0 and second.q.tolist() == [1.2, 0.0] and second.efforts.tolist() == [0.0, 0.0]


def test_coordinates_of_a_free_joint_are_a_position_and_a_rotation_vector():
    sim = Simulation.from_file("tumbling")
    half = 0.5 * 2.5
    sim.reset(q=[1, 2, 3, -math.cos(half), 0.0, 0.0, -math.sin(half)])
    assert sim.model.coordinates(sim.state) == pytest.approx([1, 2, 3, 0, 0, 2.5], rel=1e-14)
    sim.reset(q=[0, 0, 0, 1, 1e-12, 0, 0])
    assert sim.model.coordinates(sim.state)[3:] == pytest.approx([2e-12, 0, 0], rel=1e-12)
    sim = Simulation.from_text(audited(stops=True))
    assert sim.model.coordinates(sim.state).tolist() == sim.q.tolist()


def test_a_given_start_is_where_the_energy_audit_starts(sim):
    sim.reset(q=[0.3, 0.1], u=[1.0, 2.0])
    sim.set_efforts([2.0, -1.0])
    sim.run(until=1.0)
    assert abs(sim.energies.residual) < 1e-11
    assert abs(sim.energies.work_applied) > 0.1


def test_all_public_names_exist():
    for name in mbd_sim.__all__:
        assert getattr(mbd_sim, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Simulaton'"):
        _ = mbd_sim.Simulaton


class TestWholeSteps:
    @pytest.fixture
    def sim(self):
        return Simulation.from_file("rod_pendulum", method="rk4")

    @pytest.mark.parametrize("count", [-1, 10**20, 2**53 + 1])
    def test_a_count_out_of_range_is_refused(self, sim, count):
        with pytest.raises(ValueError, match=f"the number of steps must lie between 0 and .*, not {count}."):
            sim.step(count)
        assert sim.steps == 0

    @pytest.mark.parametrize("count", [2.5, "3", None])
    def test_what_is_not_a_whole_number_is_refused(self, sim, count):
        with pytest.raises(TypeError):
            sim.step(count)

    def test_a_numpy_integer_counts_as_a_plain_one(self, sim):
        sim.step(np.int64(3))
        assert type(sim.steps) is int
        assert sim.steps == 3

    @pytest.mark.parametrize("until", [math.nan, math.inf, 1e300])  # the last would take for ever
    def test_running_until_no_finite_time_is_refused(self, sim, until):
        with pytest.raises(ValueError, match="cannot run until"):
            sim.run(until=until)


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_reset_takes_a_quaternion_of_any_length(scale):
    sim = Simulation.from_file("tumbling")
    sim.reset(q=[0.0, 0.0, 0.0, 3.0 * scale, 0.0, -4.0 * scale, 0.0])
    assert sim.q[3:] == pytest.approx([0.6, 0.0, -0.8, 0.0], rel=1e-15)


BLOCKED = """
mechanism: blocked
ground: {points: {far: [1.5, 0, 0]}}
parts:
  crank: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  rod: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
joints:
  motor: {type: revolute, between: [ground, crank], axis: [0, -1, 0], drive: t}
  pin: {type: revolute, between: [crank.tip, rod], axis: [0, -1, 0], position: 90 deg, guess: true}
  slide: {type: prismatic, between: [ground, block], axis: [0, 0, 1]}
  end: {type: revolute, between: [rod.tip, block], axis: [0, -1, 0]}
"""


def test_a_drive_that_its_loop_cannot_follow_stops_where_it_happens():
    """A rod of 1 m reaches from the crank's tip at (cos t, sin t) to a guide at x = 1.5 until cos t = 1/2."""
    text = BLOCKED.replace("[ground, block]", "[ground.far, block]").replace("parts:\n", "parts:\n  block: {mass: 1}\n")
    sim = Simulation.from_text(text)
    with pytest.raises(DivergedError, match="that the loops can follow"):
        sim.run(until=5.0)
    assert sim.time == pytest.approx(np.pi / 3, abs=0.02)
    assert np.all(np.isfinite(sim.state))


def test_running_until_an_earlier_time_is_refused_with_a_remedy():
    sim = Simulation.from_file("rod_pendulum")
    sim.run(until=0.5)
    sim.run(until=0.5)  # nothing to do
    before = sim.state
    with pytest.raises(
        ValueError, match=r"cannot run until t = 0.2 s: the time is already 0.5 s\. .* or call reset\(\) first"
    ):
        sim.run(until=0.2)
    assert sim.time == 0.5 and sim.state.tobytes() == before.tobytes()
