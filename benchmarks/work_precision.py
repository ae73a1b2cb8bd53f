"""Work–precision plots: the error after three seconds against the computing time of a simulated second."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from benchmarks.engines import OURS, Engine, load
from benchmarks.judge import END, Judge
from benchmarks.measure import STEP
from benchmarks.mechanisms import MECHANISMS
from benchmarks.plan import Plan, plan_of

PLOTTED = ("2 rods", "7 rods", "four-bar", "7-axis arm")
COUNTS = (94, 188, 375, 750, 1500, 3000, 6000, 12000, 24000)  # steps in three seconds
TOLERANCES = (1e-5, 1e-8, 1e-12, None)
SAMPLES = 3
COLORS = {
    "euler": "#b0b0b0", "midpoint": "#8c8c8c", "rk4": "#d62728", "verner7": "#2ca02c", "tsitouras8": "#1f77b4",
    "dop853": "#ff7f0e", "rosenbrock": "#9467bd", "gauss4": "#8c564b", "gauss6": "#17becf", "taylor": "#000080",
}  # fmt: skip
OTHER_COLOR = "#bcbd22"
PEERS = {"MuJoCo Euler": ("#000000", "s"), "MuJoCo RK4": ("#000000", "^"), "heyoka": ("#7f5f00", "D")}
Point = tuple[float, float]


def plots(engines: list[str], file: Path) -> None:
    """Draw them into a file."""
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 9.0), layout="constrained")
    for place, name in zip(axes.flat, PLOTTED, strict=True):
        text = MECHANISMS[name]()
        plan, judge = plan_of(text), Judge(text)
        panel(place, name, plan, judge, engines)
    for place in axes[1]:
        place.set_xlabel("ms of computing for a simulated second")
    for place in axes[:, 0]:
        place.set_ylabel("relative error of the state at t = 3 s")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)
    print(f"\nWork–precision plots: {file}")


def panel(place: Axes, name: str, plan: Plan, judge: Judge, engines: list[str]) -> None:
    """One mechanism."""
    ours = load(OURS)
    default = judge.sim.model.method.name
    for method in (name for name in ours.INTEGRATORS if name != "rosenbrock_w" and name != default):
        points = list(by_steps(ours.MbdSim, plan, judge, method))
        draw(place, f"mbd_sim {method}", points, color=COLORS.get(method, OTHER_COLOR), marker="o", linestyle="-")
    # The default above the others, with a star where the step is the usual one.
    points = list(by_steps(ours.MbdSim, plan, judge, default))
    draw(place, f"mbd_sim {default} (default)", points, linewidth=3.0, color="#e6007e", marker="o", linestyle="-")
    usual = list(measured_point(ours.MbdSim(plan, STEP, default), plan, judge, round(END / STEP)))
    draw(place, "… with steps of 1 ms", usual, markersize=15.0, color="#e6007e", marker="*", linestyle="none")
    if "mujoco" in engines:
        for method in ("Euler", "RK4"):
            color, marker = PEERS[f"MuJoCo {method}"]
            points = list(by_steps(load("mujoco").MuJoCo, plan, judge, method))
            draw(place, f"MuJoCo {method}", points, color=color, marker=marker, linestyle="--")
    if "heyoka" in engines:
        color, marker = PEERS["heyoka"]
        points = list(by_tolerances(plan, judge))
        draw(place, "heyoka, own steps", points, color=color, marker=marker, linestyle="--")
    place.set(title=name, xscale="log", yscale="log", ylim=(3e-15, 1.0))
    place.grid(True, which="major", color="#e4e4e4", linewidth=0.8)
    place.set_axisbelow(True)
    place.spines[["top", "right"]].set_visible(False)


def draw(place: Axes, label: str, points: list[Point], **style: str | float) -> None:
    """A curve, without points that diverged."""
    kept = [(work, error) for work, error in points if math.isfinite(error) and error < 1.0]
    place.plot(
        *zip(*kept, strict=True) if kept else ((), ()), label=label, **{"linewidth": 1.4, "markersize": 4.0, **style}
    )


def by_steps(kind: type[Engine], plan: Plan, judge: Judge, method: str) -> Iterator[Point]:
    """Points for decreasing step sizes."""
    for count in COUNTS:
        engine = kind(plan, END / count, method)
        yield from measured_point(engine, plan, judge, count)


def by_tolerances(plan: Plan, judge: Judge) -> Iterator[Point]:
    """Points for decreasing tolerances of heyoka."""
    for tolerance in TOLERANCES:
        yield from measured_point(
            load("heyoka").Heyoka(plan, 1e-3, "taylor", tolerance), plan, judge, round(END / 1e-3)
        )


def measured_point(engine: Engine, plan: Plan, judge: Judge, count: int) -> Iterator[Point]:
    """The median work and the error of `count` steps, or nothing if the computation fails.

    Work is processor time, because other processes may run during samples of this length.
    """
    work = []
    for _ in range(SAMPLES):
        engine.reset(plan.q, plan.u)
        began = time.thread_time()
        try:
            engine.many(count)
        except Exception:  # simulators raise all kinds of exceptions for steps that are too large
            return
        work.append(1e3 * (time.thread_time() - began) / END)
    yield statistics.median(work), judge.error(*engine.state())
