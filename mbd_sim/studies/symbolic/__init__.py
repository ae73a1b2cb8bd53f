"""Equations of motion as formulas: exact, simplified, as SymPy expressions and as LaTeX.

The equations are Lagrange's, from the kinetic and potential energies (Huston & Liu, ch. 11; Géradin & Rixen), evaluated
over exact polynomials in place of numbers. Importing this package does not import SymPy; deriving equations does.
"""

from __future__ import annotations

from mbd_sim.studies.symbolic.equations import SymbolicEquations, SympyModel, symbolic_equations, sympy
from mbd_sim.studies.symbolic.latex import to_latex
from mbd_sim.studies.symbolic.linearization import SymbolicLinearization, linearized
from mbd_sim.studies.symbolic.sensors import SymbolicSensor

__all__ = [
    "SymbolicEquations",
    "SymbolicLinearization",
    "SymbolicSensor",
    "SympyModel",
    "linearized",
    "symbolic_equations",
    "sympy",
    "to_latex",
]
