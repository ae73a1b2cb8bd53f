"""Functions of CasADi matrices that are traced once and then inlined by one call, instead of one call an operator."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from mbd_sim.dynamics.spatial_algebra import sparse


def inlined(function: Callable[..., ca.SX]) -> Callable[..., ca.SX]:
    """The same function of matrices, which gives the same expressions, with zeros made structural.

    An operator on CasADi's matrices takes 20 to 40 µs in Python, most of it for the types of its operands. A call of a
    small function takes 35 µs. CasADi simplifies each operation when it inlines it, so zeros and ones in the arguments
    save the same operations as without. But it traces x * -c as -(x * c), which for a constant c would be one product
    with the number -c: a function that changes the sign of an argument before it multiplies may give other expressions.

    :param function: of matrices, whose shapes may differ from call to call.
    """
    traced: dict[tuple[tuple[int, int], ...], ca.Function] = {}

    def call(*arguments: ca.SX) -> ca.SX:
        shapes = tuple([argument.shape for argument in arguments])
        if shapes not in traced:
            symbols = [ca.SX.sym("argument", *shape) for shape in shapes]
            traced[shapes] = ca.Function("inlined", symbols, [ca.densify(function(*symbols))])
        return sparse(traced[shapes].call(arguments)[0])

    return call
