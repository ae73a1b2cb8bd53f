"""Tasks that are ready to learn, registered with Gymnasium as `mbd_sim/NAME-v0`."""

from __future__ import annotations

import math
from typing import Any

import gymnasium

from mbd_sim.gym.environment import Action
from mbd_sim.simulation.simulation import Simulation

EPISODE = 500  # actions: 10 s
RAIL = 1.8  # m to both sides, beyond which the cart has left the rail
LEAN = 0.3  # rad from upright, beyond which a balanced pendulum has fallen
SPEED = 6.0  # rad/s that the four-bar's crank shall keep


def upright(sim: Simulation, action: Action) -> float:
    """1 where the pendulum stands at rest over the middle of the rail, 0 where it hangs."""
    up = 0.5 * (1.0 - math.cos(sim.q[1]))
    return float(up - 0.1 * sim.q[0] ** 2 - 0.001 * sim.u[1] ** 2 - 0.0005 * action[0] ** 2)


def off_the_rail(sim: Simulation) -> bool:
    """Whether the cart is gone."""
    return bool(abs(sim.q[0]) > RAIL)


def alive(sim: Simulation, action: Action) -> float:
    """1 an action."""
    return 1.0


def fallen(sim: Simulation) -> bool:
    """Whether the pendulum no longer stands, or the cart is gone."""
    return off_the_rail(sim) or abs(math.remainder(sim.q[1] - math.pi, 2.0 * math.pi)) > LEAN


def height(sim: Simulation, action: Action) -> float:
    """The height of the tip, from -1 to 1, less what fast motion costs."""
    lower = sim.q[0] + sim.q[1]
    return float(-0.5 * (math.cos(sim.q[0]) + math.cos(lower)) - 0.0005 * (sim.u[0] ** 2 + sim.u[1] ** 2))


def evenly(sim: Simulation, action: Action) -> float:
    """0 where the crank has its speed, and less with the square of what it is off."""
    return float(-((sim.u[0] / SPEED - 1.0) ** 2) - 1e-5 * action[0] ** 2)


TASKS: dict[str, dict[str, Any]] = {
    # Swing up the pendulum by pushing the cart, and keep it there.
    "CartPendulumSwingUp": {
        "mechanism": "cart_pendulum", "actuated": ["rail"], "start_noise": 0.05,
        "reward": upright, "terminated": off_the_rail,
    },
    # Keep it upright.
    "CartPendulumBalance": {
        "mechanism": "cart_pendulum", "actuated": ["rail"], "start_noise": 0.05,
        "start": {"q": [0.0, math.pi]}, "reward": alive, "terminated": fallen,
    },
    # The acrobot (Spong 1995): bring the tip up by the elbow's motor alone.
    "DoublePendulumSwingUp": {
        "mechanism": "double_pendulum", "actuated": ["elbow"], "start_noise": 0.05, "reward": height,
    },
    # Turn the crank of a four-bar evenly, while the weights of its bars disturb it.
    "FourBarSpeed": {
        "mechanism": "four_bar", "actuated": ["crank_pivot"], "start_noise": 0.02,
        "effort_limits": {"crank_pivot": 25.0}, "reward": evenly,
    },
}  # fmt: skip


def register_tasks() -> None:
    """Make the tasks known to `gymnasium.make` and `make_vec`; calling it again changes nothing."""
    for name, task in TASKS.items():
        if (known := f"mbd_sim/{name}-v0") not in gymnasium.registry:
            entry = "mbd_sim.gym.environment:MechanismEnv"
            gymnasium.register(known, entry, max_episode_steps=EPISODE, kwargs=task)
