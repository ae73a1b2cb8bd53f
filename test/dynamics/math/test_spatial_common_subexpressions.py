"""Equal operations of functions are done once, by CasADi or by the compiler."""

from __future__ import annotations

import casadi as ca
import numpy as np

from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.math import spatial
from mbd_sim.dynamics.math.spatial import merged_function


def repetitive(x: ca.SX, times: int) -> ca.SX:
    """A sum with `times` products, each of which is traced twice."""
    one, two = (sum((ca.sin(x[i % 3]) * (x[1] + i) for i in range(times)), ca.SX(0)) for _ in range(2))
    return one * two


def test_equal_operations_of_short_functions_are_merged() -> None:
    x = ca.SX.sym("x", 3)
    merged = merged_function("short", [x], repetitive(x, 20))
    plain = ca.Function("short", [x], [repetitive(x, 20)])
    assert merged.n_instructions() < 0.6 * plain.n_instructions()
    np.testing.assert_array_equal(np.array(merged([1, 2, 3])), np.array(plain([1, 2, 3])))


def test_the_compiler_merges_those_of_long_functions() -> None:
    x = ca.SX.sym("x", 3)
    long = repetitive(x, spatial.LONG // 6)
    function = merged_function("long", [x], long)
    assert function.n_instructions() >= spatial.LONG
    by_casadi = ca.Function("long", [x], [long], {"cse": True})
    assert instruction_count(arranged(function)) == instruction_count(arranged(by_casadi))
    assert instruction_count(arranged(function)) < 0.6 * instruction_count(function)


def test_outputs_are_dense() -> None:
    x = ca.SX.sym("x")
    function = merged_function("sparse", [x], ca.vertcat(ca.SX(2, 1), x))
    assert function.nnz_out(0) == 3
