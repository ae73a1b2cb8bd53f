"""Arranged instruction lists: equal values to round-off, no longer critical path, and the same list every time."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.lists.instruction_list import MULTIPLY_ADD, SUBTRACT_PRODUCT, InstructionList, graph_of, is_leaf
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.schedule import ADD, FUSED, MULTIPLY, arranged, critical_path_order, latency
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism
from test.oracles.instruction_interpreter import interpret


def cycles(function):
    """The length of the critical path in cycles."""
    graph = graph_of(function)
    ready = []
    for node in graph.nodes:
        start = 0 if is_leaf(node) else max(ready[operand] for operand in node.operands)
        ready.append(start + latency(node))
    return max(ready[output.node] for output in graph.outputs)


def listed(program):
    return [
        (
            program.instruction_id(index),
            tuple(program.instruction_input(index)),
            tuple(program.instruction_output(index)),
            program.instruction_constant(index) if program.instruction_id(index) == ca.OP_CONST else None,
        )
        for index in range(program.n_instructions())
    ]


def operations(program):
    return [entry[0] for entry in listed(program) if entry[0] not in (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)]


def by_library(angle):
    return np.sin(angle), np.cos(angle)


@pytest.mark.parametrize("name", ["quadratic_drag", "arm", "spring_chain", "double_rod", "four_bar", "spherical_top"])
def test_rates_of_shipped_mechanisms(name):
    equations = derive(load_mechanism(name))
    rng = np.random.default_rng(50)
    for function in filter(None, (equations.rates, equations.project)):
        program = arranged(function)
        assert cycles(program) <= cycles(function)
        assert instruction_count(program) <= 1.02 * instruction_count(function) + 4  # a shared reciprocal is one more
        assert listed(program) == listed(arranged(function))
        arguments = [[0.3], equations.start_state + 1e-3 * rng.normal(size=len(equations.start_state))]
        if function.n_in() > 2:
            arguments.append(0.1 * rng.normal(size=equations.layout.nv))
        with np.errstate(all="ignore"):
            found, plain = (interpret(one, by_library, arguments) for one in (program, function))
        assert found == pytest.approx(plain, rel=1e-9, abs=1e-10 * np.max(np.abs(plain)))


def function_of(expression, *symbols):
    return ca.Function("f", list(symbols), [expression])


def test_a_long_sum_is_a_tree():
    x = ca.SX.sym("x", 64)
    chain = function_of(sum(x[i] for i in range(64)), x)
    assert cycles(chain) == 63 * ADD
    assert cycles(arranged(chain)) == 6 * ADD


def test_sums_may_be_as_long_as_they_like():
    x = ca.SX.sym("x", 2000)
    chain = function_of(-sum((x[i] * x[i] for i in range(2000)), x[0]), x)
    assert interpret(arranged(chain), None, [range(2000)]) == [-sum(i * i for i in range(2000))]


def test_a_long_product_is_a_tree():
    x = ca.SX.sym("x", 8)
    product = x[0]
    for i in range(1, 8):
        product = product * x[i]
    assert cycles(arranged(function_of(product, x))) == 3 * MULTIPLY


def test_what_comes_last_is_added_last():
    x, y, z = (ca.SX.sym(name) for name in "xyz")
    program = arranged(function_of(((ca.sqrt(x) + y) + z) - y * z, x, y, z))
    assert operations(program)[-1] == ca.OP_ADD
    assert cycles(program) == cycles(function_of(ca.sqrt(x), x)) + ADD


def test_products_are_fused_with_what_they_are_added_to():
    x, y, z = (ca.SX.sym(name) for name in "xyz")
    assert operations(arranged(function_of(x * y + z, x, y, z))) == [MULTIPLY_ADD]
    assert operations(arranged(function_of(z - x * y, x, y, z))) == [SUBTRACT_PRODUCT]
    late = arranged(function_of(x * y + ca.sqrt(z), x, y, z))
    assert MULTIPLY_ADD not in operations(late)
    assert cycles(late) < cycles(function_of(ca.sqrt(z), z)) + FUSED


def test_without_fusing_what_is_the_same_cancels():
    x = ca.SX.sym("x", 3)
    difference = function_of(ca.sqrt(x[0]) * x[1] - x[2] * x[1], x)
    values = [3.0, 0.1, np.sqrt(3.0)]
    assert interpret(arranged(difference, fused=False), None, [values]).tolist() == [0.0]
    assert interpret(arranged(difference), None, [values])[0] != 0.0


def test_what_others_need_as_well_is_computed_once():
    x, y, z = (ca.SX.sym(name) for name in "xyz")
    shared = x * y
    program = arranged(function_of(ca.vertcat(shared + z, shared - z), x, y, z))
    assert sorted(operations(program)) == sorted([ca.OP_MUL, ca.OP_ADD, ca.OP_SUB])


def test_signs():
    x, y, z = (ca.SX.sym(name) for name in "xyz")
    expressions = [-x - y - z, -(x - y) * z, -(x * y) - (-(y * z)), x - (y - (z - (-x))), -(x * -y) * 2 - y / z]
    function = function_of(ca.vertcat(*expressions), x, y, z)
    numbers = [[3.0], [5.0], [8.0]]
    assert interpret(arranged(function), None, numbers).tolist() == np.array(function(3.0, 5.0, 8.0)).ravel().tolist()


def test_a_wide_list_keeps_its_order():
    """Eighty roots of two sums: in critical-path order all sums would come first, and eighty values would wait."""
    x = ca.SX.sym("x", 160)
    function = function_of(ca.vertcat(*(ca.sqrt(x[2 * i] + x[2 * i + 1]) for i in range(80))), x)
    assert operations(arranged(function)) == [ca.OP_ADD, ca.OP_SQRT] * 80
    few = function_of(ca.vertcat(*(ca.sqrt(x[2 * i] + x[2 * i + 1]) for i in range(8))), x)
    assert operations(arranged(few)) == [ca.OP_ADD] * 8 + [ca.OP_SQRT] * 8


def test_unused_operations_are_left_out_and_work_vector_entries_are_reused():
    rates = derive(load_mechanism("double_rod")).rates
    graph = graph_of(arranged(rates))
    order = critical_path_order(graph)
    assert len(order) == len(graph.nodes)
    places = {number: step for step, number in enumerate(order)}
    for number in order:
        if not is_leaf(graph.nodes[number]):
            assert all(places[operand] < places[number] for operand in graph.nodes[number].operands)
    assert InstructionList(rates, graph, order).sz_w() < len(order) / 2
