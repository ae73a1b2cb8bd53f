"""Gymnasium environments of mechanisms, without ROS: `pip install gymnasium`.

Importing this package registers the tasks of `mbd_sim.many.gym.environment` with Gymnasium:

import gymnasium, mbd_sim.many.gym

env = gymnasium.make("mbd_sim/CartPendulumSwingUp-v0")
"""

from __future__ import annotations

from mbd_sim.many.gym.environment import TASKS, MechanismEnv, register_tasks
from mbd_sim.many.gym.vector_environment import MechanismVectorEnv

__all__ = ["TASKS", "MechanismEnv", "MechanismVectorEnv", "register_tasks"]

register_tasks()
