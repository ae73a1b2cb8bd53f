"""Many environments at once: the same bits as Gymnasium's vectors of single ones, and ends of episodes by each mode."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from mbd_sim import CommandError, Ensemble
from mbd_sim.files.load import parse_mechanism
from mbd_sim.many.gym import TASKS, MechanismEnv, MechanismVectorEnv
from mbd_sim.many.gym.environment import upright

ENVS = 9  # one more than a vector


def still(members, actions):
    return np.zeros(len(actions))


def single(task, horizon):
    return lambda: MechanismEnv(**TASKS[task], horizon=horizon)


@pytest.mark.parametrize(
    ("task", "mode", "horizon"),  # of the second one, some fall before
    [("FourBarSpeed", AutoresetMode.NEXT_STEP, 10), ("CartPendulumBalance", AutoresetMode.SAME_STEP, 60)],
)
def test_each_environment_is_the_single_one_bit_for_bit_over_several_episodes(task, mode, horizon):
    alone = SyncVectorEnv([single(task, horizon)] * ENVS, autoreset_mode=mode)
    together = MechanismVectorEnv(num_envs=ENVS, **TASKS[task], max_episode_steps=horizon, autoreset_mode=mode)
    assert together.single_action_space == alone.single_action_space
    assert together.observation_space == alone.observation_space
    assert together.metadata["autoreset_mode"] == mode
    assert np.array_equal(alone.reset(seed=3)[0], together.reset(seed=3)[0])
    random = np.random.default_rng(1)
    for _ in range(2 * horizon + 5):
        actions = random.uniform(-20.0, 20.0, (ENVS, 1)).astype(np.float32)
        *expected, infos = alone.step(actions)
        *found, own = together.step(actions)
        for one, other in zip(expected, found, strict=True):
            assert np.array_equal(one, other)
        if "final_obs" in infos:
            assert np.array_equal(own["_final_obs"], infos["_final_obs"])
            ends = np.flatnonzero(own["_final_obs"])
            assert all(np.array_equal(own["final_obs"][end], infos["final_obs"][end]) for end in ends)
    alone.close()


@pytest.mark.parametrize("actuated", [["elbow", "shoulder"], ["shoulder", "elbow"]])
def test_actions_follow_the_order_of_the_names(actuated):
    alone = MechanismEnv("double_pendulum", actuated, reward=lambda sim, action: 0.0)
    together = MechanismVectorEnv("double_pendulum", 2, actuated, reward=still)
    together.reset()
    kept = [alone.reset()[0]]
    for action in ([1e3, -0.25], [0.5, 2.0]):
        kept.append(alone.step(np.array(action))[0])
        sent = dict(zip(actuated, np.clip(action, alone.action_space.low, alone.action_space.high), strict=True))
        assert alone.simulation.efforts.tolist() == [sent[name] for name in alone.simulation.coordinate_names]
        assert np.array_equal(together.step(np.array([action] * 2))[0], [kept[-1]] * 2)
    assert all(type(observation) is np.ndarray for observation in kept)
    assert len({observation.tobytes() for observation in kept}) == 3  # a later step changes no earlier observation


def test_gymnasium_makes_it_by_name():
    envs = gymnasium.make_vec("mbd_sim/CartPendulumSwingUp-v0", num_envs=3, vectorization_mode="vector_entry_point")
    assert isinstance(envs.unwrapped, MechanismVectorEnv) and envs.unwrapped.max_episode_steps == 500
    observations, _ = envs.reset(seed=7)
    assert observations in envs.observation_space
    envs.close()


def test_environments_have_values_of_their_own():
    lengths = [{"parts.pendulum.mass": mass} for mass in (0.1, 0.3)]
    envs = MechanismVectorEnv("cart_pendulum", lengths, ["rail"], reward=upright, trigonometric=False)
    envs.reset()
    seen = envs.step(np.full((2, 1), 5.0, dtype=np.float32))[0]
    members = Ensemble.from_file("cart_pendulum", lengths)
    members.set_efforts({"rail": 5.0})
    members.step(20)
    assert np.array_equal(seen, np.hstack([members.q, members.u]))
    assert not np.array_equal(seen[0], seen[1])


def test_without_autoreset_the_named_ones_begin_again():
    envs = MechanismVectorEnv(
        "double_pendulum",
        4,
        reward=still,
        max_episode_steps=2,
        autoreset_mode=AutoresetMode.DISABLED,
        start={"q": [0.5, 0.0]},
    )
    first, _ = envs.reset()
    moves = np.zeros((4, 2), dtype=np.float32)
    envs.step(moves)
    *_, truncated, _ = envs.step(moves)
    assert truncated.all()
    before = envs.step(moves)[0]
    after, _ = envs.reset(options={"reset_mask": np.array([False, True, False, False])})
    assert np.array_equal(after[1], first[1]) and np.array_equal(after[[0, 2, 3]], before[[0, 2, 3]])
    assert envs.episode_times.tolist() == pytest.approx([0.06, 0.0, 0.06, 0.06])


def test_one_that_becomes_infinite_ends_alone_and_begins_again():
    envs = MechanismVectorEnv("double_pendulum", 3, reward=still)
    envs.reset(options={"u": [[0.0, 0.0], [1e200, 0.0], [0.0, 0.0]]})
    moves = np.zeros((3, 2), dtype=np.float32)
    observations, _, terminated, _, infos = envs.step(moves)
    assert terminated.tolist() == infos["diverged"].tolist() == [False, True, False]
    assert np.all(np.isfinite(observations))
    *_, terminated, _, infos = envs.step(moves)
    assert not terminated.any() and infos == {}
    assert envs.ensemble.alive.all()


def test_starts_without_a_seed_differ():
    envs = MechanismVectorEnv("double_pendulum", 2, reward=still, start_noise=0.1)
    first, _ = envs.reset()
    second, _ = envs.reset()
    assert len({row.tobytes() for row in (*first, *second)}) == 4


def test_mistakes_are_refused():
    with pytest.raises(ValueError, match=r"depends on the time.*'sync'"):
        MechanismVectorEnv("moving_support_pendulum", 2, reward=still)
    envs = MechanismVectorEnv("cart_pendulum", 2, ["rail"], reward=lambda members, actions: 0.0)
    envs.reset()
    with pytest.raises(CommandError, match=r"shape \(1,\).* for each of: rail, in 2 rows"):
        envs.step(np.zeros(1))
    with pytest.raises(ValueError, match=r"reward returned the shape \(\) for 2 environments"):
        envs.step(np.zeros((2, 1)))
    with pytest.raises(ValueError, match=r"'qq'.*q, u, reset_mask"):
        envs.reset(options={"qq": [0.0, 0.0]})
    with pytest.raises(ValueError, match=r"q has the shape \(3,\)"):
        envs.reset(options={"q": [0.0, 0.0, 0.0]})
    for given, message in (
        ({"autoreset_mode": "never"}, "'never' is not a valid AutoresetMode"),
        ({"max_episode_steps": 0}, "actions of an episode must be .* not 0"),
        ({"frame_skip": 2.5}, "frame_skip must be .* not 2.5"),
        ({"start": {"p": [0.0]}}, "'p'.*q, u"),
    ):
        with pytest.raises(ValueError, match=message):
            MechanismVectorEnv("cart_pendulum", 2, ["rail"], reward=still, **given)
    with pytest.raises(ValueError, match="3 seeds for 2"):
        envs.reset(seed=[1, 2, 3])
    with pytest.raises(ValueError, match="reset_mask is int64"):
        envs.reset(options={"reset_mask": np.array([0, 1])})
    with pytest.raises(CommandError, match="not finite"):
        envs.step(np.full((2, 1), np.nan))


MOTOR = """
mechanism: pole
integrator: {step: 1 ms}
parts: {arm: {mass: 1, inertia: [0.1, 0.1, 0.1], points: {tip: [0.2, 0, 0]}}, rod: {mass: 0.2, center: [0, 0, 0.3], inertia: [0.01, 0.01, 0]}}
joints:
  base: {type: revolute, between: [ground, arm], axis: [0, 0, 1], limits: {lower: -2, upper: 1, stiffness: 10}}
  hinge: {type: revolute, between: [arm.tip, rod], axis: [1, 0, 0], position: 0.1, effort_limit: 0.5}
actuators:
  drive: {type: dc_motor, joint: base, torque_constant: 0.2, resistance: 1, voltage_limit: 12 V, inductance: 1e-3, SERVO}
sensors: {angle: {type: encoder, joint: hinge, counts: 512, rate: 100 Hz}}
"""


@pytest.mark.parametrize(
    ("servo", "actuated", "low", "high"),
    [
        ("servo: {controls: position, kp: 20, kd: 1}", None, [-2.0], [1.0]),
        ("servo: {controls: position, kp: 20, ki: 3, kd: 1, sample_rate: 200 Hz}", ["drive", "hinge"], [-2.0, -0.5], [1.0, 0.5]),
        ("delay: 2 ms", ["drive.voltage"], [-12.0], [12.0]),
    ],
)  # fmt: skip
def test_commands_of_motors_are_actions_and_each_episode_is_that_of_one_environment(servo, actuated, low, high):
    mechanism = parse_mechanism(MOTOR.replace(", SERVO", f", {servo}" if servo else ""))
    options = {"actuated": actuated, "start_noise": 0.05}
    many = MechanismVectorEnv(
        mechanism, 3, reward=lambda members, actions: members.q[:, 0], max_episode_steps=4, **options
    )
    alone = [MechanismEnv(mechanism, reward=lambda sim, action: sim.q[0], **options) for _ in range(3)]
    assert many.single_action_space.low.tolist() == low and many.single_action_space.high.tolist() == high
    assert alone[0].action_space == many.single_action_space
    seen, _ = many.reset(seed=5)
    single = [env.reset(seed=5 + index)[0] for index, env in enumerate(alone)]
    assert np.array_equal(seen, single)
    rng, age = np.random.default_rng(1), 0
    for _ in range(12):
        actions = rng.uniform(-20.0, 20.0, (3, len(low))).astype(np.float32)
        seen, _, _, ended, _ = many.step(actions)
        age += 1
        if age > 4:  # the step after an episode begins the next one
            single, age = [env.reset()[0] for env in alone], 0
        else:
            single = [env.step(action)[0] for env, action in zip(alone, actions, strict=True)]
        assert np.array_equal(seen, single) and ended.all() == (age == 4)


def test_commands_without_a_range_and_wrong_names_are_refused():
    servo = parse_mechanism(MOTOR.replace("SERVO", "servo: {controls: velocity, kp: 2}"))

    def build(actuated=None, limits=None, mechanism=servo, **options):
        return MechanismVectorEnv(
            mechanism, 2, actuated, reward=lambda *_: np.zeros(2), command_limits=limits, **options
        )

    with pytest.raises(ValueError, match=r"command of drive has no limit.*'command_limits'"):
        build()
    assert build(["drive.velocity"], {"drive": (-3.0, 4.0)}).single_action_space.low == [-3.0]
    with pytest.raises(ValueError, match=r"there is no command 'driv'\. Did you mean 'drive'"):
        build(limits={"driv": 1.0})
    with pytest.raises(ValueError, match="limit of the command drive is"):
        build(limits={"drive": (2.0, 1.0)})
    with pytest.raises(ValueError, match=r"'drive\.velocity' is named twice"):
        build(["drive", "drive.velocity"], {"drive": 1.0})
    same = parse_mechanism(MOTOR.replace(", SERVO", "").replace("  drive:", "  base:"))
    with pytest.raises(ValueError, match=r"a coordinate and an actuator. Write 'base\.voltage' .* or 'efforts\.base'"):
        build(["base"], mechanism=same)
    assert build(["base.voltage"], mechanism=same).single_action_space.high == [12.0]
    sampled = parse_mechanism(MOTOR.replace("SERVO", "servo: {controls: velocity, kp: 2, sample_rate: 250 Hz}"))
    with pytest.raises(ValueError, match="sample at every multiple of 4 steps, and frame_skip is 6"):
        build(limits={"drive": 1.0}, mechanism=sampled, frame_skip=6)
