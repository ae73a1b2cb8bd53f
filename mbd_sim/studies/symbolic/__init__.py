"""Equations of motion as formulas: exact, simplified, as SymPy expressions and as LaTeX.

The equations are Lagrange's, from the kinetic and potential energies (Huston & Liu, ch. 11; Géradin & Rixen), evaluated
over exact polynomials in place of numbers. Importing this package imports SymPy.
"""

from __future__ import annotations

from mbd_sim.base.packages import require_packages

require_packages("sympy", purpose="Deriving equations as formulas")  # before the modules below, which import it

from mbd_sim.studies.symbolic.equations import SymbolicEquations, SympyModel, symbolic_equations, sympy  # noqa: E402
from mbd_sim.studies.symbolic.latex import to_latex  # noqa: E402
from mbd_sim.studies.symbolic.linearization import SymbolicLinearization, linearized  # noqa: E402
from mbd_sim.studies.symbolic.sensors import SymbolicSensor  # noqa: E402

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
