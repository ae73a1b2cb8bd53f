"""Loops that CAD exporters describe by pairs of frames, as URDF has only trees.

onshape-to-robot turns a mate named closing_NAME into the links closing_NAME_1 and closing_NAME_2, one on each of the
two bodies, and, if the mate is a hinge, closing_NAME_1_z and closing_NAME_2_z, 0.1 m along its axis. The kind of other
mates is not in the URDF.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

from mbd_sim.files.text.xml import Reading
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.values.names import reference, unique_name

_FIRST = re.compile(r"(closing_.+)_1")
HINGES = "frames of exporters that close loops, here by hinges about their z axes"
BALLS = "frames of exporters that close loops, here by ball joints as their kind is not in the file"


def closing_joints(reading: Reading, parts: Mapping[str, str], joints: Collection[str]) -> dict[str, Any]:
    """The joints for the pairs of frames among the links, by name; they are noted.

    :param parts: the parts of the mechanism by the names of their links.
    :param joints: the names of the joints so far.
    """
    found: dict[str, Any] = {}
    for link in parts:
        match = _FIRST.fullmatch(link)
        if match is None or f"{match[1]}_2" not in parts:
            continue
        ends = [parts[f"{match[1]}_{end}"] for end in (1, 2)]
        if GROUND in ends:
            continue
        hinge = all(f"{match[1]}_{end}_z" in parts for end in (1, 2))
        name = unique_name(match[1], [*joints, *found])
        kind = {"type": "revolute", "axis": [0.0, 0.0, 1.0]} if hinge else {"type": "spherical"}
        found[name] = {**kind, "between": [reference(end) for end in ends]}
        reading.leave_out(HINGES if hinge else BALLS, name)
    return found
