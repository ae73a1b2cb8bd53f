"""Random outlines as entries of a mechanism file: star-shaped chains of lines and arcs, with rounded corners."""

from __future__ import annotations

import math
import random

from mbd_sim.files.builders.bodies.outlines import outline_of
from mbd_sim.files.schema.shapes import OutlineSpec
from mbd_sim.mechanism.outlines.pieces import Outline


def built(points: list[object], **others: object) -> Outline:
    """The outline of a chain."""
    return outline_of(OutlineSpec.model_validate({"type": "outline", "points": points, **others}))


def random_chain(seed: int) -> list[object]:
    """The points of a closed chain around the origin, from 1 to 2 m away, some reached by arcs or rounded."""
    drawn = random.Random(seed)
    count, found = drawn.randint(4, 9), list[object]()
    for number in range(count):
        angle, radius = 2.0 * math.pi * (number + drawn.uniform(-0.2, 0.2)) / count, drawn.uniform(1.0, 2.0)
        to = [radius * math.cos(angle), radius * math.sin(angle)]
        kind = drawn.choice(["line", "arc", "round"]) if number else "line"
        if kind == "line":
            found.append(to)
        elif kind == "round":
            found.append({"to": to, "round": 0.05})
        else:
            before = found[-1] if isinstance(found[-1], list) else found[-1]["to"]  # type: ignore[index]
            radius = drawn.choice([-1.0, 1.0]) * drawn.uniform(1.5, 4.0) * math.dist(before, to)
            found.append({"to": to, "radius": radius})
    return found
