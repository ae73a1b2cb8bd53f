"""Equations of motion as a person writes them: exact, simplified, and as LaTeX.

Importing this package does not import SymPy; deriving equations does.
"""

from __future__ import annotations

from mbd_sim.symbolic.latex import to_latex
from mbd_sim.symbolic.symbolic_equations import SymbolicEquations, symbolic_equations

__all__ = ["SymbolicEquations", "symbolic_equations", "to_latex"]
