"""Ready-made learning tasks, registered with Gymnasium as `mbd_sim/NAME-v0`."""

from __future__ import annotations

import math
from typing import Any

import gymnasium

from mbd_sim.gym.environment import Action
from mbd_sim.simulation.simulation import Simulation

EPISODE = 500  # actions: 10 s
RAIL = 1.8  # m, half the length of the rail
LEAN = 0.3  # rad from upright, beyond which the pendulum has fallen
SPEED = 6.0  # rad/s, the desired speed of the four-bar's crank


def upright(sim: Simulation, action: Action) -> float:
    """1 if the pendulum stands upright at rest in the middle of the rail, 0 if it hangs."""
    up = 0.5 * (1.0 - math.cos(sim.q[1]))
    return float(up - 0.1 * sim.q[0] ** 2 - 0.001 * sim.u[1] ** 2 - 0.0005 * action[0] ** 2)


def off_the_rail(sim: Simulation) -> bool:
    """Whether the cart has left the rail."""
    return bool(abs(sim.q[0]) > RAIL)


def alive(sim: Simulation, action: Action) -> float:
    """1 for each action."""
    return 1.0


def fallen(sim: Simulation) -> bool:
    """Whether the pendulum has fallen or the cart has left the rail."""
    return off_the_rail(sim) or abs(math.remainder(sim.q[1] - math.pi, 2.0 * math.pi)) > LEAN


def height(sim: Simulation, action: Action) -> float:
    """The height of the tip, from -1 to 1, minus a cost of fast motion."""
    lower = sim.q[0] + sim.q[1]
    return float(-0.5 * (math.cos(sim.q[0]) + math.cos(lower)) - 0.0005 * (sim.u[0] ** 2 + sim.u[1] ** 2))


def speed_error(sim: Simulation, action: Action) -> float:
    """Minus the squared relative error of the crank's speed, minus a cost of the effort."""
    return float(-((sim.u[0] / SPEED - 1.0) ** 2) - 1e-5 * action[0] ** 2)


TASKS: dict[str, dict[str, Any]] = {
    # Swing the pendulum up by pushing the cart, and balance it.
    "CartPendulumSwingUp": {
        "mechanism": "cart_pendulum", "actuated": ["rail"], "start_noise": 0.05,
        "reward": upright, "terminated": off_the_rail,
    },
    # Balance the upright pendulum.
    "CartPendulumBalance": {
        "mechanism": "cart_pendulum", "actuated": ["rail"], "start_noise": 0.05,
        "start": {"q": [0.0, math.pi]}, "reward": alive, "terminated": fallen,
    },
    # The acrobot (Spong 1995): swing the tip up with a motor at the elbow only.
    "DoublePendulumSwingUp": {
        "mechanism": "double_pendulum", "actuated": ["elbow"], "start_noise": 0.05, "reward": height,
    },
    # Keep the speed of a four-bar's crank constant against the weight of the bars.
    "FourBarSpeed": {
        "mechanism": "four_bar", "actuated": ["crank_pivot"], "start_noise": 0.02,
        "effort_limits": {"crank_pivot": 25.0}, "reward": speed_error,
    },
}  # fmt: skip


def register_tasks() -> None:
    """Register the tasks for `gymnasium.make` and `make_vec`; repeated calls have no effect."""
    for name, task in TASKS.items():
        if (known := f"mbd_sim/{name}-v0") not in gymnasium.registry:
            entry = "mbd_sim.gym.environment:MechanismEnv"
            gymnasium.register(known, entry, max_episode_steps=EPISODE, kwargs=task)
