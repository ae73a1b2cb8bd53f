"""Test robots whose legs or arms have the same joints but other numbers."""

from __future__ import annotations

LEG = """
  {name}_hip: {{mass: {m1}, center: [{x}, 0.03125, -0.0625], inertia: [0.01, 0.02, 0.015], points: {{knee: [0, {y}, -0.25]}}}}
  {name}_shank: {{mass: {m2}, center: [0, 0.0625, -0.125], inertia: [0.004, 0.005, 0.002]}}
"""
JOINTS = """
  {name}_roll: {{type: revolute, between: [base.{name}, {name}_hip], axis: [1, 0, 0], position: {q1}, velocity: 0.3}}
  {name}_bend: {{type: revolute, between: [{name}_hip.knee, {name}_shank], axis: [0, 1, 0], position: {q2}, velocity: -0.7}}
"""
NAMES = ("lf", "rf", "lh", "rh")


def legged(count: int = 4, *, mirrored: bool = False) -> str:
    """A robot with a free base and `count` legs of two joints; if `mirrored`, with signs as on the left and right.

    The numbers have few bits, so that what cancels in one leg does so in all of them.
    """
    points, parts, joints = [], "", ""
    for index, name in enumerate(NAMES[:count]):
        side, end = (1 - 2 * (index % 2), 1 - index // 2 * 2) if mirrored else (1, 1)
        points.append(f"{name}: [{(0.3 + 0.01 * index) * end}, {(0.1 + 0.01 * index) * side}, 0.01]")
        numbers = {"m1": 1.5 + 0.125 * index, "m2": 0.5 + 0.0625 * index, "x": 0.03125 * end, "y": 0.125 * side}
        parts += LEG.format(name=name, **numbers)
        joints += JOINTS.format(name=name, q1=0.1 * index - 0.2, q2=0.5 - 0.07 * index)
    base = f"  base: {{mass: 20, inertia: [0.5, 0.9, 1.1], points: {{{', '.join(points)}}}}}\n"
    return (
        f"mechanism: legged{count}\nparts:\n{base}{parts}joints:\n"
        f"  float: {{type: free, between: [ground, base]}}\n{joints}"
    )
