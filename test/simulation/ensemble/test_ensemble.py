import signal

import numpy as np
import pytest

from mbd_sim import CommandError, DivergedError, Ensemble, InputError, MechanismError, Simulation
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("double_rod", "rk4"),
        ("four_bar", "gauss4"),
        ("four_bar", "rosenbrock_w"),
        ("tumbling", "dop853"),
        ("stick_slip", "rosenbrock"),
    ],
)
def test_members_that_differ_in_their_starts_move_as_single_simulations_bit_for_bit(name, method):
    random = np.random.default_rng(3)
    ensemble = Ensemble.from_file(name, 11, method=method, threads=2)
    q = ensemble.q + 0.05 * random.normal(size=ensemble.q.shape)
    efforts = random.normal(size=ensemble.u.shape)
    ensemble.reset(q=q)
    ensemble.set_efforts(efforts)
    ensemble.step(37)
    ensemble.step(100)
    for member in (0, 7, 10):
        single = Simulation.from_file(name, method=method)
        single.reset(q=q[member])
        single.set_efforts(efforts[member])
        single.step(137)
        assert np.array_equal(ensemble.state[member], single.state)
        assert ensemble.energies.residual[member] == single.energies.residual
        assert ensemble.error_estimates[member] == single.error_estimate


@pytest.mark.parametrize("name", ["spherical_top", "rssr"])
def test_members_start_with_quaternions_of_unit_length_as_single_simulations(name):
    ensemble, single = Ensemble.from_file(name, 2), Simulation.from_file(name)
    assert np.array_equal(ensemble.state[1], single.state)


def test_members_with_values_of_their_own_move_as_mechanisms_built_with_them():
    changes = [{"l": 0.6}, {"l": 1.0, "m": 3.0}, {"joints.elbow.damping": 0.4}, {"joints.elbow.position": "30 deg"}]
    ensemble = Ensemble.from_file("double_rod", changes)
    ensemble.run(1.0)
    for member, change in enumerate(changes):
        single = Simulation(with_values(load_mechanism("double_rod"), change))
        single.run(1.0)
        assert ensemble.q[member] == pytest.approx(single.q, abs=1e-11)
        assert ensemble.u[member] == pytest.approx(single.u, abs=1e-10)
    assert np.abs(ensemble.energies.residual).max() < 1e-11


def test_with_the_same_values_among_its_inputs_a_single_simulation_gets_the_same_bits():
    changes = [{"l": 0.6, "m": 2.0}, {"l": 1.7, "m": 1.0}]
    ensemble = Ensemble.from_file("double_rod", changes)
    ensemble.run(1.0)
    for member, change in enumerate(changes):
        single = Simulation.from_file("double_rod", live=["parameters.l", "parameters.m"])
        single.set_live({f"parameters.{name}": value for name, value in change.items()})
        single.reset()
        single.run(1.0)
        assert np.array_equal(ensemble.state[member], single.state)


def test_loops_of_members_are_closed_with_their_own_lengths():
    ensemble = Ensemble.from_file("four_bar", [{"crank": 0.4}, {"crank": 0.5}])
    ensemble.run(0.5)
    single = Simulation(with_values(load_mechanism("four_bar"), {"crank": 0.4}))
    single.run(0.5)
    assert ensemble.q[0] == pytest.approx(single.q, abs=1e-10)


def test_a_member_that_becomes_infinite_is_lost_alone():
    ensemble = Ensemble.from_file("double_rod", 9)
    start = ensemble.state
    efforts = np.zeros((9, 2))
    efforts[4] = 1e300
    ensemble.set_efforts(efforts)
    ensemble.step(100)
    ensemble.set_efforts(np.zeros(2))
    ensemble.step(100)
    assert ensemble.alive.tolist() == [True] * 4 + [False] + [True] * 4
    assert np.array_equal(ensemble.state[4], start[4])
    assert not np.array_equal(ensemble.state[3], start[3])
    with pytest.raises(DivergedError, match="the first is member 4"):
        ensemble.require_alive()
    ensemble.reset()
    assert ensemble.alive.all()


def test_efforts_are_given_for_all_for_each_or_by_name_and_clamped():
    ensemble = Ensemble.from_file("double_rod", 3)
    ensemble.set_efforts({"elbow": np.array([1.0, 2.0, 3.0])})
    ensemble.step(10)
    single = Simulation.from_file("double_rod")
    single.set_efforts({"elbow": 2.0})
    single.step(10)
    assert np.array_equal(ensemble.state[1], single.state)
    for wrong in ({"elbw": 1.0}, np.zeros((3, 3)), {"elbow": float("nan")}, {"elbow": "much"}):
        with pytest.raises(CommandError):
            ensemble.set_efforts(wrong)


def test_effort_limits_hold_for_each_member():
    text = load_mechanism("double_rod").source.text.replace(
        "    position: 90 deg\n", "    position: 90 deg\n    effort_limit: f\n"
    )
    mechanism = parse_mechanism(text.replace("parameters:\n", "parameters:\n  f: 1 N*m\n"))
    ensemble = Ensemble(mechanism, [{"f": 1.0}, {"f": 2.0}])
    ensemble.set_efforts(np.array([5.0, 0.0]))
    ensemble.step(5)
    for member, limit in enumerate((1.0, 2.0)):
        single = Simulation(mechanism)
        single.reset()
        single._inputs.efforts[0] = limit
        single.step(5)
        assert np.array_equal(ensemble.state[member], single.state)


def test_the_number_of_threads_changes_nothing():
    one = Ensemble.from_file("cart_pendulum_spring", 50, threads=1)
    q = one.q + np.linspace(0.0, 0.5, 50)[:, None]
    one.reset(q=q)
    one.run(0.3)
    other = Ensemble.from_file("cart_pendulum_spring", 50, threads=3)
    other.reset(q=q)
    times_reported = []
    other.run(0.3, times_reported.append)
    assert np.array_equal(one.state, other.state)
    assert times_reported[-1] == pytest.approx(0.3)


def test_large_angles_leave_the_vectors_for_the_library():
    ensemble = Ensemble.from_file("double_rod", 8)
    q = np.tile(ensemble.q[:1], (8, 1))
    q[3, 0] = 1e8
    ensemble.reset(q=q)
    ensemble.step(50)
    single = Simulation.from_file("double_rod")
    for member in (2, 3):
        single.reset(q=q[member])
        single.step(50)
        assert np.array_equal(ensemble.state[member], single.state)


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ([{}, {"joints.elbow.axis[0]": 1.0}], "cannot share"),
        ([{}, {"m": -1.0}], "member 1: .*at least 0"),
        ([{"mass": 1.0}], "is not a key of this file"),
    ],
)
def test_changes_that_do_not_fit_name_the_member(members, words):
    with pytest.raises(MechanismError, match=words):
        Ensemble.from_file("double_rod", members)


def test_an_ensemble_has_members_and_a_step():
    with pytest.raises(ValueError, match="at least one"):
        Ensemble.from_file("double_rod", 0)
    with pytest.raises(ValueError, match="positive"):
        Ensemble.from_file("double_rod", 2, step=-1.0)
    with pytest.raises(ValueError, match="number of steps must lie between"):
        Ensemble.from_file("double_rod", 2).step(-1)
    with pytest.raises(ValueError, match="not finite"):
        Ensemble.from_file("double_rod", 2).reset(q=np.full((2, 2), np.nan))
    with pytest.raises(ValueError, match=r"u has the shape \(3,\)\. Give 2 values .* or \(4, 2\)"):
        Ensemble.from_file("double_rod", 4).reset(u=np.zeros(3))


@pytest.mark.parametrize("members", [2.5, True, "4", {"l": 1.0}, [1.0, 2.0]])
def test_members_are_a_number_or_changes(members):
    with pytest.raises(InputError, match="Give their number, or a list"):
        Ensemble.from_file("double_rod", members)


def test_numbers_of_numpy_count_members():
    assert len(Ensemble.from_file("double_rod", np.int64(3))) == 3


@pytest.mark.parametrize("threads", [0, -1, 1.5])
def test_threads_are_counted(threads):
    with pytest.raises(InputError, match=f"threads must be a whole number of 1 or more, not {threads}"):
        Ensemble.from_file("double_rod", 2, threads=threads)


@pytest.mark.parametrize("method", ["adams11", "gauss4"])
def test_members_pass_flat_positions_each_at_its_own_time(method):
    text = load_mechanism("four_bar").source.text.replace("velocity: 2 rad/s", "velocity: speed")
    text = text.replace("  density: 1  ", "  speed: 8 rad/s\n  density: 1  ").replace(
        "coupler: 1.4 m", "coupler: 1.5 m"
    )
    text = text.replace("rocker: 1.2 m", "rocker: 0.5 m").replace("-60 deg", "-90 deg").replace("100 deg", "90 deg")
    ensemble = Ensemble(parse_mechanism(text), [{"speed": 7.0 + 0.1 * member} for member in (0, 4, 8)], method=method)
    ensemble.run(2.0)
    for index, speed in ((0, 7.0), (2, 7.8)):
        single = Simulation(with_values(parse_mechanism(text), {"speed": speed}), method=method)
        single.run(2.0)
        assert single.q[0] > 2.0 * np.pi, "it has lain flat"
        assert np.array_equal(ensemble.state[index], single.state)


@pytest.mark.parametrize("method", ["adams11", "gauss4"])
def test_members_that_start_again_move_as_at_first(method):
    swing, some = Ensemble.from_file("double_rod", 10, method=method), [1, 9]
    swing.set_efforts({"elbow": np.linspace(0.0, 2.0, 10)})
    swing.step(40)
    first = swing.state
    swing.restart(some)
    assert swing.steps == 40
    assert np.array_equal(np.delete(swing.state, some, axis=0), np.delete(first, some, axis=0))
    swing.step(60)
    alone = Ensemble.from_file("double_rod", 1, method=method)
    alone.step(60)
    assert np.array_equal(swing.state[some], np.repeat(alone.state, 2, axis=0))  # without efforts
    assert np.max(abs(swing.energies.residual[some])) < 1e-6


def test_members_cannot_start_again_where_the_time_matters():
    with pytest.raises(ValueError, match=r"a drive, a force .* depends on the time\. Use reset"):
        Ensemble.from_file("moving_support_pendulum", 2).restart([1])
    arms = Ensemble.from_file("motor_drive", 2)  # its servo samples at every fourth step
    arms.restart([1])
    arms.step(3)
    with pytest.raises(ValueError, match=r"start again at step 3, because servos sample at every multiple of 4 steps"):
        arms.restart([1])
    swing = Ensemble.from_file("double_rod", 2)
    before = swing.state
    with pytest.raises(IndexError):
        swing.restart([2])
    for mask in ([True, False], np.array([0.0, 1.0])):
        with pytest.raises(InputError, match=r"for a mask use np\.flatnonzero"):
            swing.restart(mask)
    swing.restart([])
    assert np.array_equal(swing.state, before)


def test_limits_of_efforts_can_be_replaced():
    swing = Ensemble.from_file("double_rod", 3)
    swing.set_effort_limits(np.array([1.0, 0.5]))
    swing.set_efforts({"elbow": 2.0})
    limited = Ensemble.from_file("double_rod", 3)
    limited.set_efforts({"elbow": 0.5})
    for members in (swing, limited):
        members.step(5)
    assert np.array_equal(swing.state, limited.state)
    assert np.array_equal(swing.effort_limits, np.tile([1.0, 0.5], (3, 1)))
    with pytest.raises(ValueError, match="negative"):
        swing.set_effort_limits(np.array([1.0, -1.0]))


def test_given_speeds_have_to_satisfy_the_constraints_but_for_their_digits():
    """A full vector is refused as speeds by name are; the message says by how much, and names the nearest ones."""
    single, members = Simulation.from_file("four_bar"), Ensemble.from_file("four_bar", 3)
    right = single.u.copy()
    wrong = right + np.array([0.0, 0.5, 0.0])
    before = single.state.copy()
    with pytest.raises(CommandError, match=r"do not allow these speeds.*nearest.*crank_pivot = .*differs by"):
        single.reset(u=wrong)
    assert np.array_equal(single.state, before)
    with pytest.raises(CommandError, match="member 1: the constraints do not allow"):
        members.reset(u=[right, wrong, right])
    with pytest.raises(CommandError, match="member 2: the constraints do not allow"):
        members.restart([2], u=wrong)
    single.reset(u=np.round(right, 4))
    members.reset(u=np.round(right, 4))
    assert single.u == pytest.approx(right, abs=1e-4) and single.violation.velocity < 1e-12
    assert np.array_equal(members.u, [single.u] * 3)
    single.reset(u=wrong, nearest_speeds=True)
    members.restart([2], u=wrong, nearest_speeds=True)
    assert single.violation.velocity < 1e-12 and np.array_equal(members.u[2], single.u)
    single.reset(u=np.zeros(3))
    assert not single.u.any()


def test_resting_speeds_that_contradict_a_drive_are_refused():
    lift = Simulation.from_file("scissor_lift", set={"joints.bearing.drive": "3*t"})
    with pytest.raises(CommandError, match="do not allow these speeds"):
        lift.reset(u=np.zeros(len(lift.u)))


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("double_rod", {"threads": 1}),
        ("double_rod", {"threads": 2}),
        ("double_rod", {"threads": 2, "method": "taylor"}),
        ("bounce", {"threads": 2}),
    ],
)
def test_ctrl_c_leaves_all_members_at_the_time_of_the_ensemble(name, options):
    """They were up to 2000 steps ahead of it, each time, and went on from there at the wrong time; or it was ignored."""

    def interrupt(*_):
        raise KeyboardInterrupt

    members, reached = Ensemble.from_file(name, 40, **options), set()
    handler = signal.signal(signal.SIGALRM, interrupt)
    try:
        for delay in np.random.default_rng(1).uniform(0.001, 0.1, 4):
            members.reset()
            signal.setitimer(signal.ITIMER_REAL, delay)
            with pytest.raises(KeyboardInterrupt):
                members.step(10**9)
            alone = Ensemble.from_file(name, 1, **options)
            alone.step(members.steps)
            assert np.array_equal(members.state, np.repeat(alone.state, 40, axis=0))
            reached.add(members.steps)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
    assert 0 < max(reached) < 10**7
