"""The one-sided rows of a mechanism as a system for the compiler."""

from __future__ import annotations

import casadi as ca

from mbd_sim.compiler.active_rows import Load
from mbd_sim.compiler.guarded_system import OneSidedSystem
from mbd_sim.dynamics.contact_functions import OneSidedFunctions, SolvedPair
from mbd_sim.dynamics.equations import Equations

TOLERANCE = 1e-13  # of guards in natural units, for a mechanism of up to the natural length


def guard_tolerance(equations: Equations) -> float:
    """How negative a guard may be by round-off."""
    assert equations.one_sided is not None
    return TOLERANCE * max(1.0, equations.constraints.size / equations.one_sided.contacts.units.length)


def one_sided_system(equations: Equations, contact: OneSidedFunctions) -> OneSidedSystem:
    """The system for `compile_kernel`, from the functions of the `contact` among the equations."""
    layout = contact.contacts.layout
    rows = [element.rows[0] for element in contact.contacts.frictions if element.joint is not None]
    loads = tuple(Load(row, load.nnz_out(0)) for row, load in zip(rows, contact.loads, strict=True))
    slips = [element.rows for element in contact.contacts.frictions]
    single_loads = sum(load.components == 1 for load in loads)

    def pair(functions: SolvedPair) -> tuple[ca.Function, ca.Function]:
        return functions.system, functions.result

    return OneSidedSystem(
        gaps=layout.gaps,
        rows=layout.rows,
        guards=layout.gaps + len(contact.contacts.frictions) + single_loads,
        rates=pair(contact.rates),
        project=pair(contact.project),
        readings=(contact.rates.system, contact.readings),
        open_guards=contact.open_guards,
        first_mode=equations.inputs.one_sided.start,
        modes=2 * layout.rows,
        loads=loads,
        slips=tuple((rows[0], rows[1]) for rows in slips if len(rows) == 2),
        tolerance=guard_tolerance(equations),
        gap_units=contact.contacts.gap_units,
        slow=contact.contacts.slow,
    )
