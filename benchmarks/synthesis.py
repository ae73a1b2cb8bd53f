"""Global and local search for linkages: seeded problems whose best solution is known, because it made the path.

python -m benchmarks.synthesis [--problems 0 1 2] [--generations 40]
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from mbd_sim import Mechanism, parse_mechanism
from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.studies.kinematic_analysis import driven_motion
from mbd_sim.studies.synthesis import PathGoal
from mbd_sim.studies.synthesis.global_search import SearchSettings, global_design
from mbd_sim.studies.synthesis.synthesis import MOST_STEPS, design_problem, local_design

BOUNDS = {
    "a": (0.1, 2.0),
    "b": (0.3, 4.0),
    "c": (0.3, 4.0),
    "d": (0.3, 4.0),
    "px": (-3.0, 3.0),
    "py": (-3.0, 3.0),
    "x": (-2.0, 2.0),
    "y": (-2.0, 2.0),
    "tilt": (-3.1, 3.1),  # of the frame
}
ROWS = 9
RANGE = (0.2, 6.0)  # rad, of the crank
EXACT = 1e-9  # m: the linkage that made the path was found, or a cognate of it with the same timing

FOUR_BAR = """
mechanism: four_bar
parameters: {{a: {a!r}, b: {b!r}, c: {c!r}, d: {d!r}, px: {px!r}, py: {py!r}, x: {x!r}, y: {y!r}, tilt: {tilt!r}}}
ground: {{points: {{left: [x, y, 0], right: ["x + d*cos(tilt)", "y + d*sin(tilt)", 0]}}}}
parts:
  crank: {{mass: 1, shape: {{type: sphere, radius: 0.1}}, points: {{tip: [a, 0, 0]}}}}
  coupler: {{mass: 1, shape: {{type: sphere, radius: 0.1}}, points: {{tip: [b, 0, 0], tracer: [px, py, 0]}}}}
  rocker: {{mass: 1, shape: {{type: sphere, radius: 0.1}}, points: {{tip: [c, 0, 0]}}}}
joints:
  motor: {{type: revolute, between: [ground.left, crank], axis: [0, 0, 1], position: 0.2}}
  pin: {{type: revolute, between: [crank.tip, coupler], axis: [0, 0, 1], position: {pin!r}, guess: true}}
  pivot: {{type: revolute, between: [ground.right, rocker], axis: [0, 0, 1], position: {pivot!r}, guess: true}}
  rocker_pin: {{type: revolute, between: [coupler.tip, rocker.tip], axis: [0, 0, 1], cut: true}}
"""


def crank_rocker(random: np.random.Generator) -> Mechanism:
    """A random crank-rocker between the bounds, whose dead points are not near."""
    while True:
        a, b, c, d = random.uniform([0.3, 0.8, 0.8, 0.8], [1.0, 3.0, 3.0, 3.0]).tolist()
        apart = np.array([d - a, d + a])
        sines = 1.0 - np.abs((b * b + c * c - apart**2) / (2.0 * b * c))
        if np.min(sines) > 0.1:
            px, py, x, y = random.uniform([-2.0, -2.0, -1.0, -1.0], [2.0, 2.0, 1.0, 1.0]).tolist()
            tilt, mode = random.uniform(-3.0, 3.0), random.choice([-1.0, 1.0])
            across = x + 1j * y + d * np.exp(1j * tilt) - (x + 1j * y + a * np.exp(1j * RANGE[0]))
            reach = abs(across)
            coupler = np.angle(across) + mode * np.arccos((b * b + reach**2 - c * c) / (2.0 * b * reach))
            rocker = np.angle(b * np.exp(1j * coupler) - across)
            text = FOUR_BAR.format(
                a=a, b=b, c=c, d=d, px=px, py=py, x=x, y=y, tilt=float(tilt),
                pin=float(coupler - RANGE[0]), pivot=float(rocker),
            )  # fmt: skip
            return parse_mechanism(text)


def path_of(mechanism: Mechanism) -> PathGoal:
    """The path of its tracer, with the timing."""
    motion = driven_motion(mechanism, {"motor": RANGE}, ROWS)
    return PathGoal("coupler.tracer", motion.point("coupler.tracer").position, motion.drive)


def compared(seed: int, settings: SearchSettings) -> tuple[float, float]:
    """The deviation in m of the local search from a random start, and of the global search; nan if one fails."""
    random = np.random.default_rng(seed)
    goal = path_of(crank_rocker(random))
    problem = design_problem(crank_rocker(random), "motor", goal, BOUNDS, "rms")
    searches = (
        lambda: local_design(problem, BOUNDS, "motor", "rms", MOST_STEPS),
        lambda: global_design(problem, BOUNDS, "motor", "rms", settings),
    )
    found: list[float] = []
    for search in searches:
        try:
            found.append(search().rms)
        except MbdSimError:
            found.append(float("nan"))
    return found[0], found[1]


def main() -> None:
    """Print a table and the counts."""
    parser = argparse.ArgumentParser(prog="benchmarks.synthesis", description=__doc__)
    parser.add_argument("--problems", type=int, nargs="*", default=list(range(20)), help="seeds (default 0 to 19)")
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--population", type=int, default=10)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    print("| problem | local search, rms in m | global search, rms in m | s |\n|--:|--:|--:|--:|", flush=True)
    results: list[tuple[float, float]] = []
    for seed in options.problems:
        began = time.process_time()
        local, whole = compared(seed, SearchSettings(seed, options.generations, options.population, options.workers))
        results.append((local, whole))
        print(f"| {seed} | {local:.2g} | {whole:.2g} | {time.process_time() - began:.0f} |", flush=True)
    table: Array = np.array(results)
    with np.errstate(invalid="ignore"):
        exact = table <= EXACT
    print(f"\nfound: local {exact[:, 0].sum()}, global {exact[:, 1].sum()} of {len(table)}; "
          f"global only: {np.sum(exact[:, 1] & ~exact[:, 0])}")  # fmt: skip


if __name__ == "__main__":
    main()
