"""The inertia of rotors, as the coordinates that they drive feel it.

A rotor that turns N times as fast as its coordinate adds N² J to the diagonal of the mass matrix: its kinetic energy is
½ J (N q')². Its mass is that of the part that carries it, whose rotation changes this energy only by terms of the order
of 1/N, which are left out (Featherstone, sec. 9.6).
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import is_absent
from mbd_sim.mechanism.actuators import Actuator, CoordinatePort
from mbd_sim.mechanism.cylinders import Cylinder


def speed_rows(links: Sequence[Link]) -> dict[str, int]:
    """The index in u of each coordinate."""
    return {name: link.u.start + offset for link in links for offset, name in enumerate(link.joint.coordinate_names)}


def rotor_inertias(actuators: Sequence[Actuator], links: Sequence[Link], nv: int) -> ca.SX | None:
    """The inertias (nv,) of rotors as their coordinates feel them, N² J in kg·m² or kg; None without any."""
    rows, added, present = speed_rows(links), ca.SX(nv, 1), False
    for actuator in actuators:
        motor = actuator.motor
        if isinstance(motor, Cylinder) or not isinstance(actuator.port, CoordinatePort):
            continue
        if not is_absent(motor.rotor_inertia):
            added[rows[actuator.port.coordinate]] += motor.gear**2 * motor.rotor_inertia
            present = True
    return added if present else None
