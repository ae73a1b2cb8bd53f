"""Functions for optimizers: the equations of a mechanism as CasADi functions of its parameters."""

from __future__ import annotations

from mbd_sim.optimization.casadi_functions import CasadiFunctions, casadi_functions

__all__ = ["CasadiFunctions", "casadi_functions"]
