"""Linear analysis of simulations: working points, root loci and stability maps, Bode plots, animated modes.

| module | contents |
|---|---|
| `loci` | a simulation set to an equilibrium; eigenvalues over values of the file |
| `plots` | Bode plots, root loci and stability maps as pictures; a mode as an animation of the mechanism |

The linear systems themselves are in `mbd_sim.analysis`. docs/linear_analysis.md shows everything in use.
"""

from __future__ import annotations

from mbd_sim.studies.linear_analysis.loci import (
    EigenvalueLocus,
    eigenvalue_locus,
    equilibria_of,
    set_to_equilibrium,
    to_equilibrium,
)
from mbd_sim.studies.linear_analysis.plots import animate_mode, draw_bode, draw_locus

__all__ = [
    "EigenvalueLocus",
    "animate_mode",
    "draw_bode",
    "draw_locus",
    "eigenvalue_locus",
    "equilibria_of",
    "set_to_equilibrium",
    "to_equilibrium",
]
