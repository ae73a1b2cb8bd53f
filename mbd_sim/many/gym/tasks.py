"""Ready-made learning tasks, registered with Gymnasium as `mbd_sim/NAME-v0`.

Rewards and ends of episodes are functions of one simulation, or of all members of an ensemble: the first axis of their
transposed arrays counts coordinates. Of one simulation, its entries are scalars, with which NumPy computes three times
as fast as with arrays without axes. Squares are products: `** 2` of a scalar is rounded differently from an array's.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array

Efforts = NDArray[np.floating[Any]]

EPISODE = 500  # actions: 10 s
RAIL = 1.8  # m, half the length of the rail
LEAN = 0.3  # rad from upright, beyond which the pendulum has fallen
SPEED = 6.0  # rad/s, the desired speed of the four-bar's crank


class Simulated(Protocol):
    """A `Simulation` with q (nq,), or an `Ensemble` with q (k, nq)."""

    @property
    def q(self) -> Array:
        """The generalized coordinates."""
        ...

    @property
    def u(self) -> Array:
        """The generalized speeds."""
        ...


def upright(sim: Simulated, action: Efforts) -> Any:
    """1 if the pendulum stands upright at rest in the middle of the rail, 0 if it hangs."""
    q, rate, push = sim.q.T, sim.u.T[1], action.T[0]
    place, up = q[0], 0.5 * (1.0 - np.cos(q[1]))
    return up - 0.1 * (place * place) - 0.001 * (rate * rate) - 0.0005 * (push * push)


def off_the_rail(sim: Simulated) -> Any:
    """Whether the cart has left the rail."""
    return abs(sim.q.T[0]) > RAIL


def alive(sim: Simulated, action: Efforts) -> Any:
    """1 for each action."""
    return np.ones(action.shape[:-1])


def fallen(sim: Simulated) -> Any:
    """Whether the pendulum has fallen or the cart has left the rail."""
    return off_the_rail(sim) | (abs(np.remainder(sim.q.T[1], 2.0 * math.pi) - math.pi) > LEAN)


def height(sim: Simulated, action: Efforts) -> Any:
    """The height of the tip, from -1 to 1, minus a cost of fast motion."""
    q, u = sim.q.T, sim.u.T
    first, shoulder, elbow = q[0], u[0], u[1]
    up = -0.5 * (np.cos(first) + np.cos(first + q[1]))
    return up - 0.0005 * (shoulder * shoulder + elbow * elbow)


def speed_error(sim: Simulated, action: Efforts) -> Any:
    """Minus the squared relative error of the crank's speed, minus a cost of the effort."""
    error, effort = sim.u.T[0] / SPEED - 1.0, action.T[0]
    return -(error * error) - 1e-5 * (effort * effort)


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
            gymnasium.register(
                known,
                "mbd_sim.many.gym.environment:MechanismEnv",
                vector_entry_point="mbd_sim.many.gym.vector_environment:MechanismVectorEnv",
                max_episode_steps=EPISODE,
                kwargs=task,
            )
