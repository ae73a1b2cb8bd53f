"""What compiled code gets of a mechanism with one-sided rows: the functions for its steps, readings and events.

The rows that are active are solved for together: A λ = r with A = G P M⁻¹ (G + friction)ᵀ, where P M⁻¹ is the response
of the mechanism with its loops and other two-sided constraints. A is not symmetric while something slides. Functions
come in pairs: the first gives a memory and the system, the second takes the memory and the solution. Both take the
values of slots as well, see `mbd_sim.dynamics.contact.rows.slots`.

With many rows the system has factors of A, of which the compiled code computes what the active rows need.

The parts on which the slots of pools act are known to the compiled code alone, see `mbd_sim.compiler.rows.pooled_rows`.
Functions give it what the other forces do to the parts, and take from it the wrenches of these slots on them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from mbd_sim.compiler.rows.row_factors import Factors
from mbd_sim.dynamics.contact.one_sided_equations import OneSidedEquations
from mbd_sim.dynamics.contact.rows.combined_rows import matrix_of
from mbd_sim.dynamics.slot_functions import SlotFunctions


@dataclass(frozen=True, eq=False)
class SolvedPair:
    """`system(t, y, inputs, slots)` gives a memory (m,), a matrix (n, n), right sides (n, k), and perhaps a margin.

    With `factors` L and R, the matrix is Lᵀ R, and the system gives the numbers of both instead; without, the second of
    these outputs is empty. `result(memory, solution, slots)` takes the solution (n, k) of the active rows, with zeros
    for all others. Where friction depends on the loads of joints, the system also gives these loads: see
    `mbd_sim.compiler.steps.active_rows.Load`. With pools the last two outputs are how the forces of the rows of each
    slot follow from the solution (k, k), one after the other, and the rates of change (6 parts,) of the twists of parts
    without these; both are empty where there is no friction, and where rates do not count.
    """

    system: ca.Function
    result: ca.Function
    factors: Factors | None

    def product(self, left: ca.SX, right: ca.SX, vector: ca.SX) -> ca.SX:
        """The product of the matrix and a vector (n,), from what the system gives."""
        if self.factors is None:
            return ca.reshape(left, vector.shape[0], vector.shape[0]) @ vector
        first, second = map(matrix_of, self.factors, (left, right))
        return first.T @ (second @ vector)


@dataclass(frozen=True, eq=False)
class OneSidedFunctions:
    """The functions of a mechanism with one-sided rows; `equations` are those of the rows.

    The `slots` are the values of slots, and what follows them in a `SlotVector`.

    - `rates`: y' as in `Equations.rates`, with the active rows.
    - `project`: y moved back to the closed gaps and to the speeds of the active rows; what would change one of q and
      u by more than the `farthest` (nq + nv,) is no projection.
    - `readings(memory, solution, slots)`, with the memory of `rates`: gaps (gaps,), rates of all rows (rows,), λ
      (rows,), and the guards (gaps + frictions + loads with one component,), which are negative where a mode ends. They
      are in natural units, those of forces in that of the weight if it is larger. Then, for friction along two
      directions, the rates in 1/s at which it can turn its slip.
    - `gaps_and_rates(t, y, inputs, slots)`: the gaps (gaps,) and the rates of all rows (rows,).
    - `open_start(t, y, inputs)`: while nothing is closed, what `Equations.rates` gives, then the gaps (gaps,) and their
      rates (gaps,), but not of slots.
    - `terms(t, y, inputs, slots)`: A (rows, rows) without friction, as in `SolvedPair`, with `terms_factors`; then
      the rates of change (rows,) of the rows' rates without contact forces, the sizes of sliding friction
      (frictions,), and those of static friction.
    - `loads(t, y, inputs, slots)`: one after the other, the force (k,) of each load without contact forces, and by
      these (k, rows) column by column; k are the `load_components`.
    - `response(t, y, inputs, impulses, slots)`: the change of u (nv,) by impulses (rows,) of the rows.
    - `restitution(inputs)`: e (gaps,).
    - `places(t, y, inputs)`: the points in m, the forces in N and the normals (9, placed gaps), in ground's frame; λ is
      among the inputs. Of round bodies it is as long as all others together, and traced when it is first read.
    """

    equations: OneSidedEquations
    rates: SolvedPair
    project: SolvedPair
    readings: ca.Function
    gaps_and_rates: ca.Function
    open_start: ca.Function
    terms: ca.Function
    terms_factors: Factors | None
    loads: ca.Function
    load_components: tuple[int, ...]
    response: ca.Function
    restitution: ca.Function
    trace_places: Callable[[], ca.Function]
    slots: SlotFunctions
    farthest: tuple[float, ...]

    @cached_property
    def places(self) -> ca.Function:
        """Where contacts are, and their forces."""
        return self.trace_places()

    def read(self, t: ca.SX, y: ca.SX, inputs: ca.SX, solution: ca.SX) -> ca.SX:
        """The `readings` at a state, as expressions."""
        slots = self.slots.values(t, y, inputs)
        memory, *numbers = self.rates.system.call([t, y, inputs, slots])[:3]
        if self.rates.factors is not None:
            first, second = map(matrix_of, self.rates.factors, numbers)
            slots[-solution.shape[0] :] = ca.sum1(first * second).T
        return self.readings.call([memory, solution, slots])[0]
