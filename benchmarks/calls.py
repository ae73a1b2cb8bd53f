"""Times of single calls from Python, beside their targets: the table "Times of single calls" of docs/measurements.md.

`python -m benchmarks.calls`. Each figure is the median of the rounds, of processor time, after a first call that
compiles what is missing; the calls of one round alternate with those of the others. The steps of Gymnasium need the
package `gymnasium`.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from mbd_sim import Simulation

ROUNDS, BUDGET = 15, 0.01  # s for each call and round
ARM, LINK, RODS, CART = "six_axis_arm", "four_bar", "double_rod", "cart_pendulum"

Calls = dict[tuple[str, str], Callable[[], object]]  # by mechanism and call

# µs that a call should not exceed, of those for which there is a target.
TARGETS = {
    (RODS, "set_efforts(…); step()"): 1.0,
    (RODS, "poses()"): 2.0,
    (RODS, "reactions()"): 5.0,
    (RODS, "linearize()"): 50.0,
    (ARM, "point(…).jacobian"): 3.0,
    ("double pendulum", "Gymnasium: env.step(action)"): 1e6 / 60_000,
}


def started(name: str) -> Simulation:
    """A simulation that moves."""
    sim = Simulation.from_file(name)
    sim.run(until=0.1)
    return sim


def calls_around_a_step(name: str) -> Calls:
    """What a controller or a learner calls in each step."""
    sim = started(name)
    efforts, saved = 0.1 * np.ones(sim.u.size), sim.snapshot()

    def advance() -> None:
        sim.set_efforts(efforts)
        sim.step()

    calls: dict[str, Callable[[], object]] = {
        "set_efforts(…); step()": advance,
        "set_efforts(…)": lambda: sim.set_efforts(efforts),
        "step()": sim.step,
        "q, u": lambda: (sim.q, sim.u),
        "poses()": sim.poses,
        "energies": lambda: sim.energies,
        "reactions()": sim.reactions,
        "linearize()": sim.linearize,
        "snapshot()": sim.snapshot,
        "restore(…)": lambda: sim.restore(saved),
        "reset()": sim.reset,
    }
    return {(name, call): function for call, function in calls.items()}


def calls_of_the_page(name: str, part: str) -> Calls:
    """The functions of docs/api_kinematics.md."""
    sim = started(name)
    point, frame, center = sim.point(part), sim.frame(part), sim.center_of_mass
    rates, efforts = np.ones(sim.u.size), np.ones(sim.u.size)
    calls: dict[str, Callable[[], object]] = {}
    for label, of, names in (
        ("point(…)", point, ("position", "velocity", "acceleration", "jacobian", "jacobian_rate", "bias_acceleration")),
        (
            "frame(…)",
            frame,
            (
                *("rotation", "pose", "angular_velocity", "angular_acceleration"),
                *("jacobian", "jacobian_rate", "bias_acceleration"),
            ),
        ),
        ("center_of_mass", center, ("position", "velocity", "acceleration", "jacobian")),
    ):
        calls |= {f"{label}.{attribute}": _reading(of, attribute) for attribute in names}
    calls |= {
        "motion(…)": lambda: sim.motion(part),
        "momentum()": sim.momentum,
        "u_rates": lambda: sim.u_rates,
        "mass_matrix()": sim.mass_matrix,
        "bias_terms()": sim.bias_terms,
        "coriolis_terms()": sim.coriolis_terms,
        "gravity_terms()": sim.gravity_terms,
        "generalized_forces()": sim.generalized_forces,
        "forward_dynamics()": sim.forward_dynamics,
        "forward_dynamics(efforts)": lambda: sim.forward_dynamics(efforts),
        "inverse_dynamics(u_rates)": lambda: sim.inverse_dynamics(rates),
    }
    return {(name, call): function for call, function in calls.items()}


def calls_of_loops(name: str) -> Calls:
    """Those that only mechanisms with loops or constraints need."""
    sim = started(name)
    return {(name, "constraint_jacobian()"): sim.constraint_jacobian, (name, "constraint_bias()"): sim.constraint_bias}


def calls_of_gymnasium() -> Calls:
    """A step of the environment of the double pendulum, of one integration step; empty without Gymnasium."""
    try:
        import gymnasium  # noqa: F401
    except ImportError:
        return {}
    from mbd_sim.many.gym import TASKS, MechanismEnv

    env = MechanismEnv(**(TASKS["DoublePendulumSwingUp"] | {"frame_skip": 1}))
    env.reset(seed=1)
    action: Any = np.zeros(env.action_space.shape, dtype=np.float32)
    return {("double pendulum", "Gymnasium: env.step(action)"): lambda: env.step(action)}


def _reading(of: object, attribute: str) -> Callable[[], object]:
    return lambda: getattr(of, attribute)


def medians(calls: Calls) -> dict[tuple[str, str], float]:
    """Processor time in µs of each call."""
    numbers: dict[tuple[str, str], int] = {}
    for key, call in calls.items():
        call()
        began = time.thread_time()
        for _ in range(20):
            call()
        numbers[key] = max(5, int(BUDGET / max((time.thread_time() - began) / 20, 1e-8)))
    found: dict[tuple[str, str], list[float]] = {key: [] for key in calls}
    for _ in range(ROUNDS):
        for key, call in calls.items():
            began = time.thread_time()
            for _ in range(numbers[key]):
                call()
            found[key].append(1e6 * (time.thread_time() - began) / numbers[key])
    return {key: statistics.median(values) for key, values in found.items()}


def main() -> None:
    """Print the table."""
    calls = calls_around_a_step(RODS) | calls_of_the_page(ARM, "tool") | calls_of_loops(LINK) | calls_of_gymnasium()
    print(f"load {os.getloadavg()[0]:.1f}\n\n| | | µs | target |\n|---|---|--:|--:|")
    for (name, call), value in medians(calls).items():
        target = TARGETS.get((name, call))
        print(f"| `{name}` | `{call}` | {value:.2f} | {'' if target is None else f'{target:.3g}'} |")


if __name__ == "__main__":
    main()
