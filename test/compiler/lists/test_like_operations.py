"""Operations of like branches: those that do the same with what is alike."""

from __future__ import annotations

import casadi as ca
import pytest

from mbd_sim.compiler.lists.instruction_list import (
    MULTIPLY_ADD,
    SUBTRACT_PRODUCT,
    Graph,
    Node,
    Output,
    graph_of,
    is_leaf,
)
from mbd_sim.compiler.lists.like_operations import like_operations, saved
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from test.generators.legged_robots import legged


def graph_from(*expressions, symbols):
    return graph_of(ca.Function("f", [symbols], [ca.vertcat(*expressions)]))


def kinds(graph, packs):
    return [[graph.nodes[node].operation for node in pack] for pack in packs]


def branches(*components):
    return [[(0, index) for index in branch] for branch in components]


def test_the_same_steps_on_other_numbers_are_alike():
    x = ca.SX.sym("x", 5)
    graph = graph_from(
        *(ca.sin(0.3 * index * x[index] + x[4]) * x[index] for index in range(1, 3)), x[0] * x[3], symbols=x
    )
    packs = like_operations(graph, [branches([1], [2])])
    assert kinds(graph, packs) == [[operation] * 2 for operation in (ca.OP_MUL, ca.OP_ADD, ca.OP_SIN, ca.OP_MUL)]
    assert saved(packs) == 4


def test_operations_on_several_branches_are_left_alone():
    x = ca.SX.sym("x", 2)
    assert like_operations(graph_from(x[0] * x[1], x[1] + x[0], symbols=x), [branches([0], [1])]) == []


def test_signs_may_differ():
    nodes = [
        Node(ca.OP_INPUT, (0, 0)),
        Node(ca.OP_INPUT, (0, 1)),
        Node(ca.OP_INPUT, (0, 2)),
        Node(MULTIPLY_ADD, (0, 0, 2)),
        Node(SUBTRACT_PRODUCT, (1, 1, 2)),
        Node(ca.OP_SUB, (3, 2)),
        Node(ca.OP_ADD, (2, 4)),
        Node(ca.OP_DIV, (5, 2)),
        Node(ca.OP_MUL, (6, 2)),
    ]
    graph = Graph(nodes, [Output(7, 0, 0), Output(8, 0, 1)])
    assert like_operations(graph, [branches([0], [1])]) == [(3, 4), (5, 6)]


def test_of_several_the_one_with_the_same_constant_or_use_is_chosen():
    x = ca.SX.sym("x", 2)
    one, other = ca.sin(2.0 * x[0]) + ca.exp(3.0 * x[0]), ca.exp(3.0 * x[1]) + ca.sin(2.0 * x[1])
    graph = graph_from(one, other, symbols=x)
    packs = like_operations(graph, [branches([0], [1])])
    assert len(packs) == 5
    for pack in packs:
        if graph.nodes[pack[0]].operation == ca.OP_MUL:
            values = [
                {graph.nodes[operand].value for operand in graph.nodes[node].operands if is_leaf(graph.nodes[operand])}
                for node in pack
            ]
            assert values[0] == values[1]


def test_sums_in_different_orders_are_alike_when_they_are_complete():
    nodes = [
        *(Node(ca.OP_INPUT, (0, index)) for index in range(4)),
        Node(ca.OP_MUL, (0, 1)),
        Node(MULTIPLY_ADD, (0, 0, 4)),  # x0 x0 + x0 x1
        Node(ca.OP_MUL, (2, 3)),
        Node(ca.OP_SQ, (2,)),
        Node(ca.OP_ADD, (6, 7)),
        Node(ca.OP_SIN, (5,)),
        Node(ca.OP_SIN, (8,)),
    ]
    graph = Graph(nodes, [Output(9, 0, 0), Output(10, 0, 1)])
    assert (9, 10) in like_operations(graph, [branches([0, 1], [2, 3])])


@pytest.mark.parametrize("count", [2, 3, 4])
def test_legs_are_packed_by_fours_and_pairs(count):
    equations = derive(parse_mechanism(legged(count)))
    graph = graph_of(arranged(equations.rates))
    packs = like_operations(graph, equations.like_branches)
    assert {len(pack) for pack in packs} == {4 if count == 4 else 2}
    assert saved(packs) > 0.2 * len(graph.nodes)
    inside = [node for pack in packs for node in pack]
    assert len(set(inside)) == len(inside)
