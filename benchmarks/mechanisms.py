"""The mechanisms that are measured, as mechanism files: each is described here, or in a file, and nowhere else."""

from __future__ import annotations

from pathlib import Path

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
    from mbd_sim.mechanism_file.library import find

    return find(name).read_text(encoding="utf-8")


MECHANISMS = {
    "1 rod": lambda: rods(1),
    "2 rods": lambda: rods(2),
    "7 rods": lambda: rods(7),
    "30 rods": lambda: rods(30),
    "cart+pendulum": lambda: shipped("cart_pendulum_spring"),
    "four-bar": lambda: shipped("four_bar"),
    "7-axis arm": lambda: (Path(__file__).parent / "arm.yaml").read_text(encoding="utf-8"),
}
