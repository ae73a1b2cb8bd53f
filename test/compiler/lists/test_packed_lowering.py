"""Packed operations compute the same bits as single ones."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import Phase, given, settings

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.compiler.lists import lowering, packing
from mbd_sim.compiler.lists.instruction_list import (
    MULTIPLY_ADD,
    MULTIPLY_SUBTRACT,
    SUBTRACT_PRODUCT,
    Graph,
    InstructionList,
    Node,
    Output,
    graph_of,
)
from mbd_sim.compiler.lists.like_operations import like_operations
from mbd_sim.compiler.lists.lowering import export, lower
from mbd_sim.compiler.lists.packed_lowering import lower_packed
from mbd_sim.compiler.lists.packing import in_order
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.python.bound_kernel import function_of_addresses
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.integrators.methods import METHODS
from test.generators.legged_robots import legged
from test.generators.mechanisms import random_trees

LIKE = ("three_cranks", "tube_particles")


def both(program, likes, sizes, arguments):
    """The results of a program by single operations and by packed ones, and the packing."""
    graph = graph_of(program)
    found = in_order(graph, like_operations(graph, likes))
    module = new_module()
    export(module, "single", lower(module, program, inline=False))
    other = new_module()
    export(other, "packed", lower_packed(other, program, found, inline=False))
    codes = {"single": compile_module(module), "packed": compile_module(other)}
    results = []
    for name, code in codes.items():
        call = function_of_addresses(code.address(name), program.n_in() + program.n_out())
        given = [np.array(argument, dtype=float).ravel() for argument in arguments]
        out = [np.full(max(size, 1), 7.0) for size in sizes]
        call(*[array.ctypes.data for array in (*given, *out)])
        results.append(b"".join(array.tobytes() for array in out))
    return *results, found


def rates_of(equations, seed):
    """The rates near the start, by single and by packed operations."""
    rng = np.random.default_rng(seed)
    rates = equations.rates
    arguments = [
        [0.3],
        equations.start_state + 0.1 * rng.normal(size=len(equations.start_state)),
        rng.normal(size=rates.nnz_in(2) + 1),
    ]
    sizes = [rates.nnz_out(index) for index in range(rates.n_out())]
    return both(arranged(rates), equations.like_branches, sizes, arguments)


@pytest.mark.parametrize("name", LIKE)
def test_rates_of_shipped_mechanisms(name):
    single, packed, found = rates_of(derive(load_mechanism(name)), 3)
    assert any(len(unit.nodes) > 1 for unit in found.units)
    assert single == packed


@settings(max_examples=2, phases=[Phase.generate])
@given(random_trees(most=3, fewest=2))
def test_rates_of_random_trees(tree):
    text, _ = tree
    single, packed, _ = rates_of(derive(parse_mechanism(text)), 5)
    assert single == packed


def test_steps_of_legs():
    equations = derive(parse_mechanism(legged(2, mirrored=True)))
    states, keys = [], set()
    for likes in ((), equations.like_branches):
        kernel = compile_kernel(equations.rates, equations.project, {}, METHODS["rk4"], like_branches=likes)
        y, inputs = equations.start_state.copy(), np.zeros(equations.rates.nnz_in(2))
        assert kernel.advance(y.ctypes.data, inputs.ctypes.data, 0, 1e-3, 20)
        states.append(y.tobytes())
        keys.add(kernel.code.key)
    assert len(keys) == 2
    assert states[0] == states[1]


def test_pieces_and_depth_first_order_give_the_same_bits(monkeypatch):
    equations = derive(parse_mechanism(legged(2, mirrored=True)))
    whole, *_ = rates_of(equations, 8)
    monkeypatch.setattr(packing, "LONG", 100)
    monkeypatch.setattr(lowering, "PIECE", 100)
    monkeypatch.setattr(lowering, "UNSPLIT", 100)
    single, cut, _ = rates_of(equations, 8)
    assert single == cut == whole


def test_sines_of_two_packs_share_a_vector_of_four():
    equations = derive(parse_mechanism(legged(2, mirrored=True)))
    program = arranged(equations.rates)
    found = in_order(graph_of(program), like_operations(graph_of(program), equations.like_branches))
    sines = [unit for unit in found.units if unit.operation == ca.OP_SIN]
    assert [len(unit.nodes) for unit in sines] == [2, 2]
    module = new_module()
    lower_packed(module, program, found, inline=False)
    assert [name.split(".")[1] for name in module.functions if name.startswith("sine_cosine.")] == ["4"]


@pytest.mark.parametrize("width", [2, 4])
def test_signs_of_all_sums(width):
    """Sums and fused operations of every kind side by side, with zeros of both signs among the operands."""
    kinds = [(ca.OP_ADD, 2), (ca.OP_SUB, 2), (MULTIPLY_ADD, 3), (MULTIPLY_SUBTRACT, 3), (SUBTRACT_PRODUCT, 3)]
    values = [0.0, -0.0, 0.1, -0.3, 1e200, 3.0]
    nodes = [Node(ca.OP_INPUT, (0, index)) for index in range(width)]
    nodes += [Node(ca.OP_CONST, (), value) for value in values]
    outputs = []
    rng = np.random.default_rng(width)
    for _ in range(60):
        operands = [int(number) for number in rng.integers(width, len(values) + width, 2)]
        size = int(rng.integers(2, 4))
        for lane in range(width):
            fitting = [operation for operation, count in kinds if count == size]
            operation = fitting[int(rng.integers(len(fitting)))]
            own = [lane, *operands[: size - 1]]
            if rng.integers(2):
                own[:2] = own[1::-1]
            nodes.append(Node(operation, tuple(own)))
            outputs.append(Output(len(nodes) - 1, 0, len(outputs)))
    graph = Graph(nodes, outputs)
    x = ca.SX.sym("x", width)
    program = InstructionList(ca.Function("signs", [x], [x]), graph, range(len(nodes)))
    likes = [[[(0, lane)] for lane in range(width)]]
    for argument in ([0.0, -0.0, 0.7, -0.2], [1.3, -2.5, 1e-300, -0.0]):
        single, packed, found = both(program, likes, [len(outputs)], [argument])
        assert sum(len(unit.nodes) == width for unit in found.units) > 10
        assert single == packed
