"""Sines and cosines of inputs are taken in vectors, with the bits of single ones."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.lists.instruction_list import Instruction, instructions_of
from mbd_sim.compiler.lists.lowering import export, lower
from mbd_sim.compiler.lists.packing import angle_groups, packed_angles, vector_size
from mbd_sim.compiler.python.bound_kernel import function_of_addresses


def taking_sines_of(*places, name="f"):
    """The sines of some components of the first argument, and the cosine of the last, times one of the second."""
    x, y = ca.SX.sym("x", 12), ca.SX.sym("y", 2)
    values = [*(ca.sin(x[place]) for place in places), ca.cos(x[places[-1]]) * y[1], ca.sin(y[0] + y[1])]
    return ca.Function(name, [x, y], [ca.vertcat(*values)])


def grouped(function):
    instructions = instructions_of(function)
    return angle_groups(instructions, range(len(instructions)))


def test_four_angles_share_a_vector_in_the_order_in_which_they_are_needed():
    groups = grouped(taking_sines_of(7, 2, 3, 9, 0, 5))
    assert groups[0, 7] == groups[0, 2] == [(0, 9), (0, 7), (0, 3), (0, 2)]
    assert groups[0, 0] == groups[0, 5] == [(0, 5), (0, 0)]
    assert set(groups) == {(0, place) for place in (7, 2, 3, 9, 0, 5)}


def test_an_angle_that_is_left_alone_and_one_that_is_computed_belong_to_no_group():
    assert grouped(taking_sines_of(4)) == grouped(taking_sines_of(4, 5, 7)) == {}
    assert set(grouped(taking_sines_of(1, 2, 3, 4, 6))) == {(0, 1), (0, 2), (0, 3), (0, 4)}


def test_an_entry_of_the_work_vector_that_was_an_input_is_no_angle_any_more():
    instructions = [
        Instruction(ca.OP_INPUT, (0, 0), (0,)),
        Instruction(ca.OP_INPUT, (0, 1), (1,)),
        Instruction(ca.OP_SIN, (0,), (0,)),
        Instruction(ca.OP_COS, (0,), (0,)),
        Instruction(ca.OP_SIN, (1,), (1,)),
    ]
    assert set(angle_groups(instructions, range(5))) == {(0, 0), (0, 1)}
    assert angle_groups(instructions, range(1, 5)) == {}  # the first angle was loaded before this piece


def test_packs_of_angles_fill_vectors_of_four():
    pair, other, third, four, single = (1, 5), (2, 6), (3, 7), (10, 11, 12, 13), (9,)
    groups = packed_angles([pair, four, single, other, pair, third])
    assert groups[pair] == groups[single] == [(9,), (1, 5)]  # the next pair does not fit
    assert groups[other] == groups[third] == [(3, 7), (2, 6)]
    assert set(groups) == {pair, single, other, third}
    assert packed_angles([pair, four]) == {}


def test_lanes():
    assert [vector_size(count) for count in (2, 3, 4)] == [2, 4, 4]


@pytest.mark.parametrize("fast", [True, False])
def test_bits_of_vectors_are_those_of_single_sines(fast):
    """Of two to seven angles, some of which are so large that the C library is called, or not finite."""
    module = new_module()
    module.fast = fast
    functions = [taking_sines_of(*range(1, 1 + count), name=f"f{count}") for count in range(1, 8)]
    for number, function in enumerate(functions):
        export(module, f"read_{number}", lower(module, function, inline=True))
    assert ("sine_cosine.4" in module.functions) == fast
    code = compile_module(module)
    rng = np.random.default_rng(43)
    single = function_of_addresses(code.address("read_0"), 3)
    for number, function in enumerate(functions):
        together = function_of_addresses(code.address(f"read_{number}"), 3)
        for scale in (1.0, 1e3, 1e6, 1e12):
            x, y = scale * rng.normal(size=12), rng.normal(size=2)
            x[3] = rng.choice([x[3], math.inf, math.nan, -0.0])
            found, one = np.empty(function.nnz_out(0)), np.empty(3)
            together(x.ctypes.data, y.ctypes.data, found.ctypes.data)
            for place in range(number + 1):
                moved = np.roll(x, -place)
                single(moved.ctypes.data, y.ctypes.data, one.ctypes.data)
                assert found[place].tobytes() == one[0].tobytes() or math.isnan(one[0])
            assert found[number + 1].tobytes() == one[1].tobytes() or math.isnan(one[1])
