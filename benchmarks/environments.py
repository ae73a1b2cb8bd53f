"""Vectorized Gymnasium environments: environment steps per second of ours, and of Gymnasium's own ones with MuJoCo.

`python -m benchmarks.environments [--count 1000] [--rounds 5]`. A cart with a pendulum, in one process each and in
several: ours as an ensemble, Gymnasium's `InvertedPendulum-v5` in a vector of single environments, in this process or
in one per processor. Each action lasts two integration steps of 0.02 s in MuJoCo (RK4), and one, two or twenty in ours.
The rows alternate, and the figures are medians of the rounds.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv

from mbd_sim.many.gym import TASKS, MechanismVectorEnv

BUDGET = 2.0  # s for each row and round


def ours(count: int, frame_skip: int, threads: int | None) -> VectorEnv[Any, Any, Any]:
    """`count` of our carts with an upright pendulum."""
    task = TASKS["CartPendulumBalance"] | {"frame_skip": frame_skip, "threads": threads}
    return MechanismVectorEnv(num_envs=count, max_episode_steps=500, **task)


def theirs(count: int, parallel: bool) -> VectorEnv[Any, Any, Any]:
    """`count` of Gymnasium's: MuJoCo is called in Python, so that processes are what makes them parallel."""
    make = [lambda: gymnasium.make("InvertedPendulum-v5")] * count
    return AsyncVectorEnv(make) if parallel else SyncVectorEnv(make)


def steps_per_second(envs: VectorEnv[Any, Any, Any]) -> float:
    """Environment steps per second of wall time with random actions, drawn before."""
    random = np.random.default_rng(1)
    actions = [random.uniform(-1.0, 1.0, envs.action_space.shape).astype(np.float32) for _ in range(16)]
    envs.reset(seed=1)
    began, calls = time.perf_counter(), 0
    while time.perf_counter() - began < BUDGET:
        for action in actions:
            envs.step(action)
        calls += len(actions)
    return envs.num_envs * calls / (time.perf_counter() - began)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000, help="environments (default 1000)")
    parser.add_argument("--rounds", type=int, default=5, help="interleaved samples (default 5)")
    options = parser.parse_args()
    count = options.count
    processors = len(os.sched_getaffinity(0))
    rows: list[tuple[str, Callable[[], VectorEnv[Any, Any, Any]]]] = [
        (f"MechanismVectorEnv, {count}, 1 integration step each", lambda: ours(count, 1, None)),
        (f"MechanismVectorEnv, {count}, 2 integration steps each", lambda: ours(count, 2, None)),
        (f"MechanismVectorEnv, {count}, 20 integration steps each", lambda: ours(count, 20, None)),
        (f"MechanismVectorEnv, {count}, 20 each, one thread", lambda: ours(count, 20, 1)),
        (f"InvertedPendulum-v5, {count} in one process", lambda: theirs(count, parallel=False)),
        (f"InvertedPendulum-v5, {processors} in as many processes", lambda: theirs(processors, parallel=True)),
    ]
    envs = [(name, make()) for name, make in rows]
    rates: dict[str, list[float]] = {name: [] for name, _ in rows}
    for _ in range(options.rounds):
        for name, env in envs:
            rates[name].append(steps_per_second(env))
    print(f"{processors} processors, load {os.getloadavg()[0]:.1f}\n\n| environments | steps/s | least | most |")
    print("|---|---|---|---|")
    for name, _ in rows:
        print(f"| {name} | {statistics.median(rates[name]):,.0f} | {min(rates[name]):,.0f} | {max(rates[name]):,.0f} |")
    for _, env in envs:
        env.close()


if __name__ == "__main__":
    main()
