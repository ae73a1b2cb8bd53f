"""Packed operations: all of them, each after its operands, in any way of packing."""

from __future__ import annotations

import casadi as ca
import pytest

from mbd_sim.compiler.lists import packing
from mbd_sim.compiler.lists.instruction_list import Graph, Node, Output, graph_of, is_leaf
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.packing import in_order, packed
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from test.generators.legged_robots import legged


def require_complete(found):
    """Each node that is needed is in one unit, after its operands, with its own operands up to their order and signs."""
    placed = set()
    for unit in found.units:
        for lane, node in enumerate(unit.nodes):
            own = found.graph.nodes[node]
            if not is_leaf(own):
                operands = [nodes[lane] for nodes in unit.operands]
                assert sorted(operands) == sorted(own.operands)
                assert placed.issuperset(operands)
        assert placed.isdisjoint(unit.nodes)
        placed.update(unit.nodes)
    assert sorted(placed) == found.graph.used


@pytest.mark.parametrize(("mirrored", "most"), [(False, 0.7), (True, 0.9)])
def test_four_legs_take_fewer_operations(monkeypatch, mirrored, most):
    monkeypatch.setattr(packing, "WORTHWHILE", most)
    equations = derive(parse_mechanism(legged(mirrored=mirrored)))
    program = arranged(equations.rates)
    found = packed(program, equations.like_branches)
    require_complete(found)
    assert found.cost <= most * instruction_count(program)


def test_short_code_and_single_branches_stay_as_they_are(monkeypatch):
    equations = derive(parse_mechanism(legged(2)))
    program = arranged(equations.rates)
    assert packed(program, []) is None
    monkeypatch.setattr(packing, "SHORTEST", len(program.instructions) + 1)
    assert packed(program, equations.like_branches) is None


def test_code_that_would_not_become_shorter_stays_as_it_is(monkeypatch):
    x = ca.SX.sym("x", 4)
    function = ca.Function("f", [x], [ca.vertcat(x[0] * x[1], x[2] * x[3])])
    monkeypatch.setattr(packing, "SHORTEST", 0)
    assert packed(function, [[[(0, 0)], [(0, 2)]]]) is None


def test_a_pack_that_would_wait_for_itself_is_divided():
    nodes = [
        Node(ca.OP_INPUT, (0, 0)),
        Node(ca.OP_SIN, (0,)),
        Node(ca.OP_SQ, (1,)),
        Node(ca.OP_SIN, (2,)),
        Node(ca.OP_SQ, (3,)),
    ]
    found = in_order(Graph(nodes, [Output(4, 0, 0)]), [(1, 3), (2, 4)])
    require_complete(found)
    assert [unit.nodes for unit in found.units] == [(0,), (1,), (2,), (3,), (4,)]


def test_operations_of_long_lists_are_placed_depth_first_from_the_outputs(monkeypatch):
    """Two chains side by side in the graph, whose packs alternate; the second output comes first."""
    nodes = [Node(ca.OP_INPUT, (0, lane)) for lane in range(4)]
    for _ in range(3):
        nodes += [Node(ca.OP_SQ, (len(nodes) - 4 + lane,)) for lane in range(4)]
    outputs = [Output(node, 0, place) for place, node in enumerate((14, 15, 12, 13))]
    packs = [(first, first + 1) for first in range(4, 16, 2)]
    monkeypatch.setattr(packing, "CANDIDATES", 1)
    for longest, expected in ((16, packs), (9, [packs[place] for place in (1, 3, 5, 0, 2, 4)])):
        monkeypatch.setattr(packing, "LONG", longest)
        found = in_order(Graph(nodes, outputs), packs)
        require_complete(found)
        assert [unit.nodes for unit in found.units if unit.operands] == expected


def test_operations_of_long_lists_do_not_wait_for_their_operands(monkeypatch):
    """A chain of square roots, then one of squares, which come first while a root is computed, if they are seen."""
    nodes, chains = [Node(ca.OP_INPUT, (0, place)) for place in range(2)], ([], [])
    for start, (operation, chain) in enumerate(zip((ca.OP_SQRT, ca.OP_SQ), chains, strict=True)):
        chain.append(start)
        for _ in range(4):
            nodes.append(Node(operation, (chain[-1],)))
            chain.append(len(nodes) - 1)
    graph = Graph(nodes, [Output(chain[-1], 0, place) for place, chain in enumerate(chains)])
    monkeypatch.setattr(packing, "LONG", 1)
    for candidates, after_the_first in ((1, 0), (3, 0), (5, 4)):
        monkeypatch.setattr(packing, "CANDIDATES", candidates)
        found = in_order(graph, [])
        require_complete(found)
        (order,) = zip(*(unit.nodes for unit in found.units if unit.operands), strict=True)
        between = order[order.index(chains[0][1]) + 1 : order.index(chains[0][2])]
        assert between == tuple(chains[1][1 : 1 + after_the_first])


def test_two_divisions_by_one_number_are_left_to_the_reciprocal(monkeypatch):
    monkeypatch.setattr(packing, "SHORTEST", 0)
    x = ca.SX.sym("x", 3)
    function = ca.Function("f", [x], [ca.vertcat(ca.sin(x[0]) / x[2], ca.sin(x[1]) / x[2])])
    assert packed(function, [[[(0, 0)], [(0, 1)]]]) is None


def test_a_single_node_is_its_own_unit():
    x = ca.SX.sym("x", 2)
    graph = graph_of(ca.Function("f", [x], [ca.sin(x[0]) - x[1]]))
    assert in_order(graph, []).cost == 2
