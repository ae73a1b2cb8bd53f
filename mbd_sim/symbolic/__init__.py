"""Equations of motion as formulas: exact, simplified, and as LaTeX.

The equations are Lagrange's, from the kinetic and potential energies (Huston & Liu, ch. 11; Géradin & Rixen), evaluated
over exact polynomials in place of numbers. Importing this package does not import SymPy; deriving equations does.
"""

from __future__ import annotations

from mbd_sim.symbolic.latex import to_latex
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations, symbolic_equations

__all__ = ["SymbolicEquations", "symbolic_equations", "to_latex"]
