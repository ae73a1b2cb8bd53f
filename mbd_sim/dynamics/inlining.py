"""Functions of CasADi matrices that are traced once and then inlined by one call, instead of one call an operator.

An operator on CasADi's matrices takes 20 to 50 µs in Python, most of it for the types of its operands. A call of a
small function takes 35 to 50 µs. CasADi simplifies each operation when it inlines it, so zeros and ones in the
arguments save the same operations as without. But it traces x * -c as -(x * c), which for a constant c would be one
product with the number -c: a function that changes the sign of an argument before it multiplies may give other
expressions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from mbd_sim.dynamics.spatial_algebra import sparse


def inlined(function: Callable[..., ca.SX]) -> Callable[..., ca.SX]:
    """Trace a function of matrices once and inline it; the expressions are equal, with zeros made structural.

    :param function: of matrices, whose number and shapes may differ from call to call.
    """
    several = inlined_results(lambda *arguments: [function(*arguments)])
    return lambda *arguments: several(*arguments)[0]


def inlined_results(function: Callable[..., Sequence[ca.SX]]) -> Callable[..., list[ca.SX]]:
    """`inlined` for a function with several results."""
    traced: dict[tuple[tuple[int, int], ...], ca.Function] = {}

    def call(*arguments: ca.SX) -> list[ca.SX]:
        shapes = tuple([argument.shape for argument in arguments])
        if shapes not in traced:
            symbols = [ca.SX.sym("argument", *shape) for shape in shapes]
            results = [ca.densify(result) for result in function(*symbols)]
            traced[shapes] = ca.Function("inlined", symbols, results)
        return [sparse(result) for result in traced[shapes].call(arguments)]

    return call
