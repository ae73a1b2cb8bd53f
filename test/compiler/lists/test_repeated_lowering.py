"""Sections that repeat are found, and computed in loops with the same bits as one after the other."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.compiler.code import machine_code
from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.lists import repeated_lowering
from mbd_sim.compiler.lists.instruction_list import graph_of, is_leaf
from mbd_sim.compiler.lists.lowering import export, lower
from mbd_sim.compiler.lists.repeated_lowering import lower_repeated
from mbd_sim.compiler.lists.repeats import find_repeats
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.python.bound_kernel import function_of_addresses
from mbd_sim.compiler.steps import guarded

BALLS = """
mechanism: balls
parts: {"b{i}": {for: {i: 1..4}, shape: {type: sphere, mass: i, radius: 0.1}}}
joints:
  "b{i}":
    for: {i: 1..4}
    type: planar
    between: [ground, "b{i}"]
    axis: [0, -1, 0]
    x_axis: [1, 0, 0]
    position: ["0.3*i", "0.3 + 0.15*(-1)**i", 0]
    velocity: ["-1 - i/7", "0.3*i", i]
contacts:
  all: {among: all, restitution: 0.8}
  floor: {parts: [b1, b2, b3, b4], plane: ground, restitution: 0.7, friction: 0.2}
"""


@pytest.fixture
def always(monkeypatch):
    """Loops also where they save little; the groups for which they are emitted."""
    monkeypatch.setattr(repeated_lowering, "SHORTEST", 0)
    monkeypatch.setattr(repeated_lowering, "WORTHWHILE", 0.0)
    found = []

    def find(graph):
        repeats = find_repeats(graph)
        found.extend((*repeats.first, *repeats.last))
        return repeats

    monkeypatch.setattr(repeated_lowering, "find_repeats", find)
    return found


def pairs(count, seed):
    """Like terms of all pairs of points, which share a turn of each point and a divisor, and a sum of like terms."""
    rng = np.random.default_rng(seed)
    x, p, z = ca.SX.sym("x", count), ca.SX.sym("p", 4), ca.SX.sym("z", 5 * count)
    turned = [ca.sin(x[i]) * p[0] + ca.cos(x[i]) / p[1] for i in range(count)]
    each, total = [], ca.SX(0)
    for i in range(count):
        for j in range(i + 1, count):
            difference = turned[i] - turned[j]
            length = ca.sqrt(difference**2 + p[2] ** 2)
            force = float(rng.normal()) * difference / length - p[3] / p[1]
            each += [length, ca.if_else(length > 1, force, 0.5), ca.atan2(difference, length)]
        own = z[5 * i : 5 * i + 5]
        total += ca.sin(own[0]) * own[1] / (1 + own[2] ** 2 * ca.sqrt(own[3] ** 2 + own[4] ** 2))
    results = [ca.vertcat(*each), ca.vertcat(total, total * turned[0]), x[0]]
    return ca.Function("pairs", [x, p, z], results)


def results(emit, function, arguments):
    """What a function gives, as bytes."""
    module = new_module()
    export(module, "emitted", emit(module, function))
    code = compile_module(module)
    call = function_of_addresses(code.address("emitted"), function.n_in() + function.n_out())
    out = [np.full(300, 7.0) for _ in range(function.n_out())]
    call(*[array.ctypes.data for array in (*arguments, *out)])
    return b"".join(array.tobytes() for array in out)


@pytest.mark.parametrize("count", [5, 6, 7, 8])
@pytest.mark.parametrize("as_interpreted", [False, True])
def test_loops_give_the_same_bits(always, count, as_interpreted):
    rng = np.random.default_rng(count)
    function = pairs(count, count)
    function = function if as_interpreted else arranged(function)
    arguments = [rng.normal(size=count), 1.0 + rng.random(4), rng.normal(size=5 * count)]
    alone, looped = (
        results(lambda m, f, how=how: how(m, f, inline=False, as_interpreted=as_interpreted), function, arguments)
        for how in (lower, lower_repeated)
    )
    assert looped == alone
    assert sorted(len(group.sections) for group in always)[-2:] == sorted([count, count * (count - 1) // 2])


@pytest.mark.parametrize("count", [5, 12])
def test_sections_are_found_whatever_they_share(count):
    graph = graph_of(arranged(pairs(count, 1)))
    found = find_repeats(graph)
    assert max(len(group.sections) for group in found.first) == count
    assert max(len(group.sections) for group in found.last) == count * (count - 1) // 2
    first, last = (
        [node for group in one for section in group.sections for node in section] for one in (found.first, found.last)
    )
    assert len({*first, *last}) == len(first) + len(last)
    leaves = {node for node in graph.used if is_leaf(graph.nodes[node])}
    assert all(leaves.issuperset(operands) for group in found.first for operands in group.operands)
    needed = {
        operand
        for node in graph.used
        if node not in {*last} and node not in leaves
        for operand in graph.nodes[node].operands
    }
    assert needed.isdisjoint(last)


def test_code_without_repeats_stays_as_it_is(monkeypatch):
    monkeypatch.setattr(repeated_lowering, "SHORTEST", 0)
    x = ca.SX.sym("x", 3)
    function = ca.Function("f", [x], [ca.sin(x[0]) * x[1] + x[2]])
    plain, other = new_module(), new_module()
    lower(plain, function, inline=False)
    lower_repeated(other, function, inline=False)
    assert str(other) == str(plain)


def test_balls_that_strike_each_other_move_the_same_bits_in_loops(always, monkeypatch):
    """With loops over all like sections, and over gaps in the guards of steps; `test_loops_…` runs optimized code."""
    monkeypatch.setattr(machine_code, "LEVEL", 0)
    monkeypatch.setattr(guarded, "FEW", 2)
    looped = Simulation.from_text(BALLS)
    assert always
    with monkeypatch.context() as patch:
        patch.setattr(repeated_lowering, "SHORTEST", 10**9)
        patch.setattr(guarded, "FEW", 40)
        plain = Simulation.from_text(BALLS.replace("balls", "plain"))
    for _ in range(40):
        plain.step(20)
        looped.step(20)
        np.testing.assert_array_equal(plain.q, looped.q)
        np.testing.assert_array_equal(plain.u, looped.u)
    assert len(plain.contact_events) > 5
