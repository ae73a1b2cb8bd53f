"""Gymnasium environments: its own checker, determinism, spaces, errors, pictures and vectors of them."""

import importlib
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from mbd_sim import CommandError, Simulation
from mbd_sim.many.gym import MechanismEnv
from mbd_sim.many.gym.environment import upright

IDS = ["mbd_sim/CartPendulumBalance-v0", "mbd_sim/FourBarSpeed-v0"]


@pytest.mark.filterwarnings("ignore:.*(symmetric and normalized|probably too|different mode).*:UserWarning")
@pytest.mark.parametrize("name", IDS[:1])
def test_gymnasiums_own_checker_is_content(name):
    env = gymnasium.make(name, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("name", IDS)
def test_the_same_seed_gives_the_same_bits(name):
    def episode():
        env = gymnasium.make(name)
        env.action_space.seed(4)
        seen = [env.reset(seed=5)[0]]
        for _ in range(50):
            observation, reward, *_ = env.step(env.action_space.sample())
            seen.append(np.append(observation, reward))
        return np.concatenate(seen)

    first = episode()
    assert np.all(np.isfinite(first))
    assert np.array_equal(first, episode())


def test_another_seed_starts_elsewhere_and_loops_stay_closed():
    env = gymnasium.make("mbd_sim/FourBarSpeed-v0")
    starts = [env.reset(seed=seed)[0] for seed in range(5)]
    assert len({start.tobytes() for start in starts}) == 5
    assert env.unwrapped.simulation.violation.position < 1e-12


def test_it_is_the_simulation():
    env = MechanismEnv("cart_pendulum", ["rail"], reward=upright, trigonometric=False, frame_skip=5)
    sim = Simulation.from_file("cart_pendulum")
    env.reset()
    for force in (3.0, -20.0, 90.0):
        observation, reward, terminated, truncated, info = env.step(np.array([force], dtype=np.float32))
        sim.set_efforts({"rail": np.clip(force, -20.0, 20.0)})
        sim.step(5)
        assert observation.tolist() == [*sim.q, *sim.u]
        assert reward == upright(sim, np.array([force], dtype=np.float32))
        assert (terminated, truncated, info) == (False, False, {})


def test_angles_are_seen_as_cosine_and_sine():
    env = MechanismEnv("cart_pendulum", ["rail"], reward=upright)
    observation, _ = env.reset(options={"q": [0.3, 2.0], "u": [0.1, -0.2]})
    assert observation.tolist() == pytest.approx([0.3, np.cos(2.0), np.sin(2.0), 0.1, -0.2])
    assert env.observation_space.high.tolist() == [np.inf, 1.0, 1.0, np.inf, np.inf]
    assert env.action_space.high == np.float32(20.0)
    assert env.metadata["render_fps"] == 50


def test_an_episode_ends_by_its_horizon_and_where_it_is_said_to():
    env = MechanismEnv(
        "double_pendulum", reward=lambda sim, action: 0.0, horizon=3, terminated=lambda sim: sim.time > 0.05
    )
    env.reset()
    ends = [env.step(np.zeros(2))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (True, True)]


def test_a_motion_that_becomes_infinite_ends_the_episode():
    env = MechanismEnv("double_pendulum", reward=lambda sim, action: 0.0)
    env.reset(options={"u": [1e200, 0.0]})
    observation, _, terminated, _, info = env.step(np.zeros(2))
    assert terminated and "infinite" in info["diverged"]
    assert np.all(np.isfinite(observation))


def test_mistakes_are_refused():
    with pytest.raises(ValueError, match=r"no coordinate 'rial'\. Did you mean 'rail'"):
        MechanismEnv("cart_pendulum", ["rial"], reward=upright)
    with pytest.raises(ValueError, match="'effort_limits'"):
        MechanismEnv("four_bar", reward=upright)
    with pytest.raises(ValueError, match="rgb_array"):
        MechanismEnv("cart_pendulum", ["rail"], reward=upright, render_mode="human")
    env = MechanismEnv("cart_pendulum", ["rail"], reward=upright)
    with pytest.raises(CommandError, match=r"shape \(2,\).* for each of: rail"):
        env.step(np.zeros(2))
    with pytest.raises(CommandError, match="not finite"):
        env.step(np.array([np.nan]))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"actuated": "rail"}, r"text 'rail'.*\['rail'\]"),
        ({"actuated": ["rail", "rail"]}, "'rail' is named twice"),
        ({"effort_limits": {"rail": -1.0}}, "limit of rail is -1.*N or N·m"),
        ({"effort_limits": {"rail": float("nan")}}, "limit of rail is nan"),
        ({"effort_limits": {"rail": "20 N"}}, "limit of rail is '20 N'"),
        ({"start": {"p": [0.0, 0.0]}}, "'p'.*q, u"),
        ({"start_noise": -0.1}, "start_noise is -0.1"),
        ({"start_noise": float("nan")}, "start_noise is nan"),
        ({"frame_skip": 1.5}, "frame_skip must be a whole number of 1 or more, not 1.5"),
        ({"frame_skip": 0}, "frame_skip must be .* not 0"),
        ({"horizon": 0}, "actions of an episode must be .* not 0"),
        ({"render_size": (0, 100)}, "pixels must be .* not 0"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_with_their_value(given, message):
    with pytest.raises(ValueError, match=message):
        MechanismEnv("cart_pendulum", **{"actuated": ["rail"], "reward": upright} | given)


def test_options_of_a_reset_besides_the_start_are_refused():
    env = MechanismEnv("cart_pendulum", ["rail"], reward=upright)
    with pytest.raises(ValueError, match=r"'qq'.*q, u"):
        env.reset(options={"qq": [0.0, 1.0]})


def test_frames_keep_their_size_and_show_the_motion():
    env = MechanismEnv("cart_pendulum", ["rail"], reward=upright, render_mode="rgb_array", render_size=(300, 200))
    env.reset()
    first = env.render()
    env.reset(options={"q": [1.0, 3.0]})
    second = env.render()
    assert first.shape == second.shape == (200, 300, 3) and first.dtype == np.uint8
    assert np.count_nonzero(first[0] != 255) == np.count_nonzero(second[:, -1] != 255) == 0  # all is within
    assert np.mean(np.any(first != second, axis=2)) > 0.01


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasiums_vectors_run_several(mode):
    envs = gymnasium.make_vec("mbd_sim/CartPendulumSwingUp-v0", num_envs=3, vectorization_mode=mode)
    try:
        first, _ = envs.reset(seed=7)
        for _ in range(5):
            observations, rewards, *_ = envs.step(np.full((3, 1), 2.0, dtype=np.float32))
    finally:
        envs.close()
    alone = gymnasium.make("mbd_sim/CartPendulumSwingUp-v0")
    assert first[1].tolist() == alone.reset(seed=8)[0].tolist()
    for _ in range(5):
        observation, reward, *_ = alone.step(np.array([2.0], dtype=np.float32))
    assert observations[1].tolist() == observation.tolist() and rewards[1] == reward


def test_without_gymnasium_the_error_names_the_remedy(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("mbd_sim.many.gym")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(ImportError, match="pip install gymnasium"):
        importlib.import_module("mbd_sim.many.gym")


@pytest.mark.parametrize("name", ["elbow_stop", "spinning_ball"])
def test_contacts_in_an_environment_are_those_of_the_simulation(name):
    sim = Simulation.from_file(name)
    limits = dict.fromkeys(sim.coordinate_names, 2.0)
    env = MechanismEnv(name, reward=lambda sim, action: 0.0, effort_limits=limits, trigonometric=False)
    for seed in (1, 2):
        env.action_space.seed(seed)
        observation, _ = env.reset(seed=seed)
        sim.reset()
        for _ in range(60):
            action = env.action_space.sample()
            observation, _, ended, _, info = env.step(action)
            sim.set_efforts(action.astype(float))
            sim.step(20)
            assert not ended
            assert info == {}
        assert np.array_equal(observation, np.concatenate([sim.q, sim.u]))
        assert len(sim.contact_events) > 0
        assert abs(sim.energies.residual) < 1e-10
