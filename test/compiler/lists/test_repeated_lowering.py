"""Parts that repeat are found, and computed in loops with the same bits as one after the other."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir import module as ir_module
from mbd_sim.compiler.lists import repeated_lowering
from mbd_sim.compiler.lists.instruction_list import graph_of
from mbd_sim.compiler.lists.lowering import lower
from mbd_sim.compiler.lists.repeated_lowering import lower_repeated
from mbd_sim.compiler.lists.repeats import find_repeats
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.python.bound_call import export
from mbd_sim.compiler.python.bound_kernel import function_of_addresses

BALLS = """
mechanism: balls
parts: {"b{i}": {for: {i: 1..5}, shape: {type: sphere, mass: i, radius: 0.1}}}
joints:
  "b{i}":
    for: {i: 1..5}
    type: planar
    between: [ground, "b{i}"]
    axis: [0, -1, 0]
    x_axis: [1, 0, 0]
    position: [0.3*i, "0.11 + 0.15*(i % 3)", 0]
    velocity: [-1 - i/7, 0.3*i, i]
contacts:
  all: {among: all, restitution: 0.8, friction: 0.3}
  floor: {parts: [b1, b2, b3, b4, b5], plane: ground, restitution: 0.7, friction: 0.2}
  wall: {parts: [b1, b2, b3, b4, b5], plane: ground, normal: [1, 0, 0], restitution: 0.9, friction: 0.1}
"""


@pytest.fixture
def always(monkeypatch):
    """Loops also where they save little."""
    monkeypatch.setattr(repeated_lowering, "SHORTEST", 0)
    monkeypatch.setattr(repeated_lowering, "WORTHWHILE", 0.0)


def pairs(count, seed):
    """Like terms of many pairs of points, which share a turn of each point and a divisor, and sums of all of them."""
    rng = np.random.default_rng(seed)
    x, p = ca.SX.sym("x", count), ca.SX.sym("p", 4)
    turned = [ca.sin(x[i]) * p[0] + ca.cos(x[i]) / p[1] for i in range(count)]
    each, total = [], [ca.SX(0)] * count
    for i in range(count):
        for j in range(i + 1, count):
            difference = turned[i] - turned[j]
            length = ca.sqrt(difference**2 + p[2] ** 2)
            force = rng.integers(1, 4) * difference / length - p[3] / p[1] + ca.if_else(length > 1, length, 0.5)
            each += [length, force, ca.atan2(difference, length)]
            total[i] += force
            total[j] -= force
    return ca.Function("pairs", [x, p], [ca.vertcat(*each), ca.vertcat(*total), x[0]])


def results(emit, function, arguments):
    """What a function gives, as bytes."""
    module = new_module()
    export(module, "emitted", emit(module, function))
    call = function_of_addresses(compile_module(module).address("emitted"), function.n_in() + function.n_out())
    out = [np.full(300, 7.0) for _ in range(function.n_out())]
    call(*[array.ctypes.data for array in (*arguments, *out)])
    return b"".join(array.tobytes() for array in out)


@pytest.mark.parametrize("count", [4, 5, 6, 7])
@pytest.mark.parametrize("as_interpreted", [False, True])
def test_loops_give_the_same_bits(always, count, as_interpreted):
    rng = np.random.default_rng(count)
    function = pairs(count, count)
    function = function if as_interpreted else arranged(function)
    arguments = [rng.normal(size=count), 1.0 + rng.random(4)]
    alone, looped = (
        results(lambda m, f, how=how: how(m, f, inline=False, as_interpreted=as_interpreted), function, arguments)
        for how in (lower, lower_repeated)
    )
    assert looped == alone


def test_parts_are_found_whatever_they_share():
    """The sums of all pairs need the pairs, but a pair needs no other one."""
    graph = graph_of(arranged(pairs(12, 1)))
    found = find_repeats(graph)
    most = max((*found.first, *found.last), key=lambda family: family.saved)
    assert len(most.parts) >= 12
    inside = [node for family in (*found.first, *found.last) for part in family.parts for node in part]
    assert len(inside) == len(set(inside))
    first = {node for family in found.first for part in family.parts for node in part}
    for family in found.first:
        for part, operands in zip(family.parts, family.operands, strict=True):
            assert all(graph.nodes[node].operation in (ca.OP_INPUT, ca.OP_CONST) for node in operands)
            assert first.issuperset(part)
    last = {node for family in found.last for part in family.parts for node in part}
    assert not any(last & set(graph.nodes[node].operands) for node in graph.used if node not in last)


def test_code_without_repeats_stays_as_it_is(monkeypatch):
    monkeypatch.setattr(repeated_lowering, "SHORTEST", 0)
    x = ca.SX.sym("x", 3)
    module = new_module()
    lower_repeated(module, ca.Function("f", [x], [ca.sin(x[0]) * x[1] + x[2]]), inline=False)
    assert list(module.functions) == ["f", *(name for name in module.functions if name != "f" and "each" not in name)]


def test_balls_that_strike_each_other_move_the_same_bits_in_loops(monkeypatch):
    """With loops over all like parts, and over gaps in the guards of steps."""
    plain = Simulation.from_text(BALLS)
    monkeypatch.setattr(repeated_lowering, "SHORTEST", 0)
    monkeypatch.setattr(repeated_lowering, "WORTHWHILE", 0.0)
    monkeypatch.setattr(ir_module, "UNROLLED", 19)  # components of vectors are unrolled in both, gaps are not
    looped = Simulation.from_text(BALLS)
    assert looped.model is not plain.model
    for _ in range(40):
        plain.step(20)
        looped.step(20)
        np.testing.assert_array_equal(plain.q, looped.q)
        np.testing.assert_array_equal(plain.u, looped.u)
    assert len(plain.contact_events) > 10
