"""The names of the coordinates q, one for each number, and positions by the names of coordinates."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import of_vector, rotation_vector
from mbd_sim.dynamics.layouts.vectors import CoordinateLayout
from mbd_sim.mechanism.mechanism import Mechanism

DRIVE_STATES = ("position", "velocity", "acceleration")


def names_of_q(mechanism: Mechanism, layout: CoordinateLayout) -> tuple[str, ...]:
    """What each of the coordinates q (nq,) is.

    A joint of one coordinate has its own name; others have one like `base.x`, and `base.qw` to `base.qz` for their
    quaternion. A drive that follows commands has its position, velocity and acceleration.
    """
    names = [""] * layout.nq
    for joint in mechanism.joints.values():
        quaternion = joint.kind.quaternion
        own = list(joint.motion_names[:quaternion])
        if quaternion is not None:
            own += [f"{joint.name}.q{letter}" for letter in "wxyz"]
        names[layout.q[joint.name]] = [] if joint.drive else own
    for name, place in layout.drives.items():
        names[place] = [f"{name}.{state}" for state in DRIVE_STATES]
    return tuple(names)


def named_positions(mechanism: Mechanism, layout: CoordinateLayout, q: Array) -> dict[str, float]:
    """The position in rad or m of each coordinate and of each drive that follows commands, by its name.

    :param q: (nq,). Quaternions in it become rotation vectors.
    """
    found: dict[str, float] = {}
    for joint in mechanism.joints.values():
        if joint.name in layout.drives:
            found[joint.name] = float(q[layout.drives[joint.name].start])
        elif not joint.drive:
            own, quaternion = q[layout.q[joint.name]], joint.kind.quaternion
            values = own if quaternion is None else [*own[:quaternion], *rotation_vector(own[quaternion:])]
            found |= zip(joint.motion_names, map(float, values), strict=True)
    return found


def with_positions(mechanism: Mechanism, layout: CoordinateLayout, q: Array, positions: Mapping[str, float]) -> Array:
    """The coordinates (nq,) with other positions, by the names of `named_positions`; drives that get one are at rest.

    Joints of which none is given keep their coordinates bit for bit. Loops stay as open as that makes them.
    """
    before, changed = named_positions(mechanism, layout, q), q.copy()
    for joint in mechanism.joints.values():
        if joint.name in layout.drives and joint.name in positions:
            changed[layout.drives[joint.name]] = positions[joint.name], 0.0, 0.0
        elif not joint.drive and any(name in positions for name in joint.motion_names):
            values = [positions.get(name, before[name]) for name in joint.motion_names]
            quaternion = joint.kind.quaternion
            if quaternion is not None:
                values = [*values[:quaternion], *of_vector(np.array(values[quaternion:]))]
            changed[layout.q[joint.name]] = values
    return changed
