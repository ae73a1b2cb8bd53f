"""The mechanisms that are measured, as mechanism files: each is described here, or in a file, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.plan import Plan, plan_of, robot_plan
from benchmarks.robots import ROBOTS, robot_text

ROD = "{mass: 1, shape: {type: rod, to: [0, 0, -1]}, points: {tip: [0, 0, -1]}}"


def rods(count: int) -> str:
    """A chain of uniform rods, released at rest with all of them horizontal."""
    parts = "".join(f"  rod{index}: {ROD}\n" for index in range(count))
    joints = ""
    for index in range(count):
        inboard, start = ("ground", ", position: 90 deg") if index == 0 else (f"rod{index - 1}.tip", "")
        between = f"[{inboard}, rod{index}]"
        joints += f"  pin{index}: {{type: revolute, between: {between}, axis: [0, -1, 0]{start}}}\n"
    return f"mechanism: rods{count}\nparts:\n{parts}joints:\n{joints}"


def shipped(name: str) -> str:
    """The file of a mechanism that comes with `mbd_sim`."""
    from mbd_sim.files.text.library import find

    return find(name).read_text(encoding="utf-8")


MECHANISMS: dict[str, Callable[[], str]] = {
    "1 rod": partial(rods, 1),
    "2 rods": partial(rods, 2),
    "7 rods": partial(rods, 7),
    "30 rods": partial(rods, 30),
    "100 rods": partial(rods, 100),
    "cart+pendulum": partial(shipped, "cart_pendulum_spring"),
    "four-bar": partial(shipped, "four_bar"),
    "6-axis arm": partial(shipped, "six_axis_arm"),
    "7-axis arm": partial((Path(__file__).parent / "arm.yaml").read_text, encoding="utf-8"),
    **{name: partial(robot_text, name) for name in ROBOTS},
}
LARGE = ("100 rods", *ROBOTS)  # of ours, only the default, `rk4`, `tsitouras8` and `taylor` are measured
SLOW = {"exudyn": ("100 rods",)}  # simulators, and mechanisms that would take them minutes


def plan_named(name: str, text: str) -> Plan:
    """The plan of one of the mechanisms."""
    return robot_plan(text) if name in ROBOTS else plan_of(text)


def left_out(name: str, module: str) -> str:
    """Why a simulator is not measured on a mechanism; empty if it is."""
    if name in ROBOTS and module not in ("mbd_sim", "mujoco", "heyoka"):
        return "reads neither our MJCF nor our equations here"
    return "takes minutes" if name in SLOW.get(module, ()) else ""
