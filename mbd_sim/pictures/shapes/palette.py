"""How curves and parts are shown in the scene and the plots: their colors, and the energy residual.

A part and the curves of its joint share a color. The residual is prepared for a logarithmic scale.
"""

from __future__ import annotations

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism

Color = tuple[int, int, int]

PARTS: tuple[Color, ...] = (
    (77, 163, 224),  # blue
    (245, 166, 66),  # amber
    (111, 199, 127),  # green
    (229, 101, 98),  # coral
    (167, 139, 230),  # violet
    (72, 196, 190),  # teal
    (238, 134, 181),  # pink
    (202, 195, 120),  # sand
)
JOINT: Color = (222, 226, 232)
STEEL: Color = (164, 172, 184)
DRIVEN: Color = (255, 208, 0)  # joints with a drive
CLOSING: Color = (255, 64, 160)  # joints that close loops, and constraints
ROPE: Color = (226, 204, 160)
SPRING: Color = (196, 204, 216)
DAMPER: Color = (128, 138, 152)
CURVE: Color = (136, 150, 170)
CONTACT: Color = (255, 240, 150)
APPLIED: Color = (255, 96, 80)  # forces of the file
COMMANDED: Color = (96, 224, 128)  # commanded efforts and wrenches
REACTION: Color = (96, 208, 255)  # forces through joints
AXIS_X: Color = (224, 92, 92)
AXIS_Y: Color = (104, 190, 104)
AXIS_Z: Color = (92, 132, 232)
GRID: Color = (96, 104, 116)
BACKGROUND: Color = (22, 26, 33)

KINETIC: Color = (245, 166, 66)
POTENTIAL: Color = (77, 163, 224)
TOTAL: Color = (232, 236, 241)
DISSIPATED: Color = (229, 101, 98)
WORK_APPLIED: Color = (111, 199, 127)
WORK_DRIVES: Color = (167, 139, 230)
RESIDUAL: Color = (229, 101, 98)


def from_hex(text: str) -> Color:
    """The color of '#rrggbb'."""
    return (int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16))


def mixed(color: Color, other: Color, share: float) -> Color:
    """`color` with a share (0 to 1) of `other`."""
    r, g, b = (round(a + (o - a) * share) for a, o in zip(color, other, strict=True))
    return (r, g, b)


def lit(color: Color) -> Color:
    """The color of a surface that appears as `color` once it is shaded."""
    return mixed(color, (255, 255, 255), 0.12)


def part_colors(mechanism: Mechanism) -> dict[str, Color]:
    """A color for each part, in the order of the file."""
    return {name: PARTS[index % len(PARTS)] for index, name in enumerate(mechanism.parts)}


def series_colors(mechanism: Mechanism) -> list[Color]:
    """A color for each generalized speed: that of the part which its joint moves.

    Where a part has several degrees of freedom, their curves would share a color: then colors go by coordinate.
    """
    joints = [joint for joint in mechanism.joints.values() for _ in joint.coordinate_names]
    movers = [joint.outboard_part for joint in joints]
    if len(set(movers)) < len(movers) or GROUND in movers:
        return [PARTS[index % len(PARTS)] for index in range(len(movers))]
    colors = part_colors(mechanism)
    return [colors[name] for name in movers]


MIN_RESIDUAL = 1e-18  # J


def residual_magnitude(energies: Array) -> Array:
    """The magnitude (n,) in J of the residual in rows (n, 7) of `Energies`.

    It is bounded below by the rounding error of the energies that it is the difference of: smaller values are not
    significant, and zero has no place on a logarithmic scale.
    """
    rounding = np.finfo(float).eps * np.max(np.abs(energies[:, :6]), axis=1, initial=0.0)
    return np.asarray(np.maximum(np.abs(energies[:, 6]), np.maximum(0.5 * rounding, MIN_RESIDUAL)))
