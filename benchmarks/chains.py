"""Mechanism files of rods hung from one another, for measurements."""

from __future__ import annotations

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
