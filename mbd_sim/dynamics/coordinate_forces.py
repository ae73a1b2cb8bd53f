"""Efforts and potentials of the file that act along joint coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.power import PowerSplit
from mbd_sim.dynamics.state_variables import StateVariables, function_of_coordinates
from mbd_sim.mechanism.records import Mechanism


@dataclass(frozen=True, eq=False)
class CoordinateForces:
    """The forces along the coordinates in N or N·m: `generalized` (nv,), and `on_driven` coordinates by name.

    `potential` is in J, and the powers are in W.
    """

    generalized: ca.SX
    on_driven: Mapping[str, ca.SX]
    potential: ca.SX
    power: PowerSplit


def coordinate_forces(
    mechanism: Mechanism, state: StateVariables, q: ca.SX, q_rates: ca.SX, u: ca.SX
) -> CoordinateForces:
    """All of them; those on driven coordinates are taken up by the drives.

    :param q_rates: (nq,) N(q) u.
    """
    generalized, potential, power = ca.SX(u.shape[0], 1), ca.SX(1, 1), PowerSplit()
    on_driven: dict[str, ca.SX] = {}
    for effort in mechanism.efforts:
        value = state.value(effort.effort)
        power.add([effort.effort], value * state.speeds[effort.coordinate])
        if (row := state.rows.get(effort.coordinate)) is None:
            on_driven[effort.coordinate] = on_driven.get(effort.coordinate, ca.SX(1, 1)) + value
        else:
            generalized[row] += value
    for element in mechanism.potentials:
        found = function_of_coordinates(element.energy, state.positions, state.t)
        potential += found.value
        generalized -= ca.jacobian(q_rates, u).T @ ca.gradient(found.value, q)
        power.applied += found.time_slope  # a potential that changes with time is changed from outside
        for name, slope in found.slopes.items():
            if name not in state.rows:
                on_driven[name] = on_driven.get(name, ca.SX(1, 1)) - slope
    return CoordinateForces(ca.sparsify(generalized), on_driven, potential, power)
