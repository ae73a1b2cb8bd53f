"""Functions traced once give the expressions of those that are traced at every call, operation by operation."""

from __future__ import annotations

from functools import partial

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.lists.instruction_list import instructions_of
from mbd_sim.dynamics.math.spatial import constant, inlined, symmetric
from mbd_sim.dynamics.recursion.articulated_body import _turned

X = ca.SX.sym("x", 3, 3)
Q = ca.SX.sym("q")
BLOCKS = {
    "dense": X,
    "symmetric": symmetric(X),
    "sparse": ca.sparsify(X * constant(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 2.0], [0.0, -1.0, 1.0]]))),
    "numbers": constant(np.diag([0.1, 0.0, 3.0])),
}


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("block", BLOCKS.values(), ids=BLOCKS)
def test_an_inlined_function_gives_the_same_instructions(axis, block):
    arguments = -ca.sin(Q), ca.cos(Q), block
    direct, found = ca.sparsify(_turned(axis, *arguments)), inlined(partial(_turned, axis))(*arguments)
    assert found.sparsity() == direct.sparsity()
    one, other = (instructions_of(ca.Function("f", [X, Q], [result])) for result in (direct, found))
    assert one == other and len(one) >= 5


def test_it_is_traced_once_for_each_shape():
    traced = []

    @inlined
    def doubled(matrix):
        traced.append(matrix.shape)
        return 2.0 * matrix

    for shape in ((2, 1), (2, 1), (1, 2)):
        symbols = ca.SX.sym("a", *shape)
        assert ca.is_equal(doubled(symbols), 2.0 * symbols, 2)
    assert traced == [(2, 1), (1, 2)]
