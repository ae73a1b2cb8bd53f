"""The energies of a mechanism as simplified SymPy expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from mbd_sim.dynamics.lagrange import LagrangeEquations


@dataclass(frozen=True, eq=False)
class SymbolicEnergies:
    """The `kinetic` and the `potential` energy in J, and Rayleigh's `dissipation` function in W.

    Springs whose force is an expression have no part in the potential: they are among the forces.
    """

    kinetic: Any
    potential: Any
    dissipation: Any

    @property
    def lagrangian(self) -> Any:
        """L = T - V."""
        return self.kinetic - self.potential


def energy_function(lagrange: LagrangeEquations) -> ca.Function:
    """(t, q, u), and parameters if there are any, -> T, V and D."""
    given = lagrange.energies.sx_in()
    *kinetic, potential = lagrange.energies.call(given)
    dissipation = lagrange.dissipation.call(given)[0]
    outputs = [ca.sparsify(one) for one in (sum(kinetic, ca.SX(1, 1)), potential, dissipation)]
    return ca.Function("energies", given, outputs)
