"""Every operation of an instruction list becomes the IEEE 754 operation of the same name, and nothing else."""

from __future__ import annotations

import math
import platform
from itertools import product

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.code.object_code import object_code
from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.compiler.lists import lowering
from mbd_sim.compiler.lists.instruction_list import Graph, InstructionList, Node, Output
from mbd_sim.compiler.lists.lowering import export
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.python.bound_kernel import function_of_addresses
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.integrators.methods import METHODS
from test.generators.loops import state_near_start
from test.generators.mechanisms import AUDITED, random_state, random_trees
from test.oracles import kane
from test.oracles.instruction_interpreter import BINARY, LIBRARY, TERNARY, UNARY, interpret

SPECIAL = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.1,
    -2.5,
    3.0,
    1e-320,
    1e-200,
    1e200,
    1.7976931348623157e308,
    math.inf,
    -math.inf,
    math.nan,
]


def compiled(*functions):
    """Functions of casadi as functions of numpy arrays, by their machine code."""
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y"), ca.SX.sym("e")
    kernel = compile_kernel(
        ca.Function("rates", [t, y, inputs], [y]), None, {f.name(): f for f in functions}, METHODS["euler"]
    )

    def wrap(function):
        reader = kernel.readers[function.name()]

        def call(*arguments):
            arrays = [np.atleast_1d(np.array(argument, dtype=float)) for argument in arguments]
            out = np.full(function.nnz_out(0), 77.0)
            assert [a.size for a in arrays] == [function.nnz_in(i) for i in range(function.n_in())]
            reader(*[a.ctypes.data for a in arrays], out.ctypes.data)
            return out

        call.kernel = kernel  # the code lives as long as this
        return call

    return [wrap(function) for function in functions]


def bits(values):
    return np.asarray(values, dtype=float).view(np.uint64).tolist()


def same(found, expected):
    """The same bits, or both NaN."""
    return bits([found]) == bits([expected]) or (math.isnan(found) and math.isnan(expected))


def operations(function):
    return [function.instruction_id(index) for index in range(function.n_instructions())]


def test_the_tables_below_name_every_operation_that_is_lowered():
    assert set(UNARY) | {ca.OP_SIN, ca.OP_COS} == set(lowering._UNARY)
    assert set(BINARY) == set(lowering._BINARY)
    assert set(TERNARY) == set(lowering._TERNARY)
    assert set(LIBRARY) == set(lowering.LIBRARY)


def test_unary_operations():
    x = ca.SX.sym("x")
    functions = [ca.Function(f"f{op}", [x], [ca.SX.unary(op, x)]) for op in UNARY if op != ca.OP_ASSIGN]
    with np.errstate(all="ignore"):
        for function, call in zip(functions, compiled(*functions), strict=True):
            operation = int(function.name()[1:])
            assert operation in operations(function)
            for value in map(np.float64, SPECIAL):
                assert same(call(value)[0], UNARY[operation](value)), (operation, value)


def test_binary_operations():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    functions = [ca.Function(f"f{op}", [x, y], [ca.SX.binary(op, x, y)]) for op in BINARY]
    with np.errstate(all="ignore"):
        for (operation, expected), function, call in zip(BINARY.items(), functions, compiled(*functions), strict=True):
            assert operation in operations(function)
            for a, b in product(map(np.float64, SPECIAL), repeat=2):
                found = call(a, b)[0]
                assert same(found, expected(a, b)) or found == expected(a, b) == 0.0, (operation, a, b)


def test_fused_operations():
    x, module = ca.SX.sym("x", 3), new_module()
    inputs = [Node(ca.OP_INPUT, (0, place)) for place in range(3)]
    for number, operation in enumerate(TERNARY):
        function = ca.Function(f"fused{number}", [x], [x[0]])
        graph = Graph([*inputs, Node(operation, (0, 1, 2))], [Output(3, 0, 0)])
        export(
            module, f"read_{number}", lowering.lower(module, InstructionList(function, graph, range(4)), inline=True)
        )
    code = compile_module(module)
    rng = np.random.default_rng(42)
    usual = rng.normal(size=(50, 3)) * 10.0 ** rng.integers(-3, 4, (50, 3))
    cases = np.array([*usual, *product([0.0, -0.0, 1.0, -2.5], repeat=3)])
    for number, expected in enumerate(TERNARY.values()):
        call = function_of_addresses(code.address(f"read_{number}"), function.n_in() + 1)
        for case in cases:
            out = np.empty(1)
            call(case.ctypes.data, out.ctypes.data)
            assert out[0] == expected(*case)


@pytest.mark.parametrize("name", ["exp", "log", "tan", "asin", "acos", "atan", "tanh"])
def test_functions_of_the_c_library(name):
    x = ca.SX.sym("x")
    (call,) = compiled(ca.Function("f", [x], [getattr(ca, name)(x)]))
    for value in (-3.5, -0.7, 0.0, 0.3, 0.9, 12.0, math.inf, math.nan):
        with np.errstate(all="ignore"):
            expected = getattr(np, {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}.get(name, name))(value)
        assert call(value)[0] == pytest.approx(expected, rel=1e-15, abs=0.0, nan_ok=True)


def test_powers_and_the_angle_of_two_sides():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    power, angle, cube_root = compiled(
        ca.Function("power", [x, y], [x**y]),
        ca.Function("angle", [x, y], [ca.atan2(x, y)]),
        ca.Function("root", [x, y], [x ** (1.0 / 3.0) + y]),
    )
    assert power(2.5, -1.5)[0] == pytest.approx(2.5**-1.5, rel=1e-15)
    assert angle(-1.0, -2.0)[0] == pytest.approx(math.atan2(-1.0, -2.0), rel=1e-15)
    assert cube_root(27.0, 0.0)[0] == pytest.approx(3.0, rel=1e-15)


def test_zeros_of_sums_and_products_keep_their_sign():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    functions = [ca.Function(name, [x, y], [value]) for name, value in (("sum", x + y), ("less", x - y), ("of", x * y))]
    calls = compiled(*functions)
    for a, b in product([0.0, -0.0], repeat=2):
        for call, expected in zip(calls, (a + b, a - b, a * b), strict=True):
            assert bits(call(a, b)) == bits([expected])


def test_constants():
    x = ca.SX.sym("x")
    values = [0.1, -1.0 / 3.0, 1e-310, 1.7976931348623157e308, math.inf, -math.inf]
    (call,) = compiled(ca.Function("f", [x], [ca.vertcat(*[ca.SX(value) for value in values], x)]))
    assert bits(call(2.0)) == bits([*values, 2.0])


def test_inputs_and_outputs_have_their_indices():
    a, b = ca.SX.sym("a", 3), ca.SX.sym("b", 2)
    (call,) = compiled(ca.Function("f", [a, b], [ca.vertcat(b[1], a[2], a[0] * 0, b[0] - a[1])]))
    assert call([1.0, 2.0, 4.0], [8.0, 16.0]).tolist() == [16.0, 4.0, 0.0, 6.0]


@pytest.mark.parametrize("function", [ca.ceil, ca.erf, ca.sinh], ids=lambda f: f.__name__)
def test_an_operation_that_kernels_do_not_support_is_refused(function):
    x = ca.SX.sym("x")
    with pytest.raises(NotImplementedError, match=r"no kernel instruction for CasADi operation \d+"):
        lowering.lower(new_module(), ca.Function("f", [x], [function(x)]), inline=True)


def test_binary_operations_that_kernels_do_not_support_are_refused():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    for value in (ca.fmod(x, y), ca.copysign(x, y)):
        with pytest.raises(NotImplementedError):
            lowering.lower(new_module(), ca.Function("f", [x, y], [value]), inline=True)


def test_lowering_contracts_and_reassociates_nothing_by_itself():
    """x y + z with one rounding, or (x + y) + z as x + (y + z), would give other bits for these."""
    x, y, z = (ca.SX.sym(name) for name in "xyz")
    functions = [ca.Function("fused", [x, y, z], [x * y + z]), ca.Function("sum", [x, y, z], [(x + y) + z])]
    fused, added = compiled(*functions)
    a = 1.0 + 2.0**-30
    assert fused(a, a, -(a * a)).tolist() == [0.0]
    assert added(1.0, 1e16, -1e16).tolist() == [0.0]
    assert added(1e16, -1e16, 1.0).tolist() == [1.0]
    module = new_module()
    lowering.lower(module, functions[0], inline=False)
    assert not any(flag in str(module) for flag in ("fast", "contract", "reassoc", "nsz", "arcp", "fma"))


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="addresses have one length elsewhere")
def test_values_on_the_stack_have_short_addresses():
    """The same code is shorter than without the attributes; here forty values are live at a time."""
    x = ca.SX.sym("x", 40)
    values = ca.vertsplit(x)
    for layer in range(6):
        values = [values[i] * values[(7 * i + layer) % 40] - values[(3 * i + 1) % 40] for i in range(40)]
    module = new_module()
    lowering.lower(module, ca.Function("f", [x], [ca.vertcat(*values)]), inline=False).linkage = ""
    text = str(module)
    attributes = " ".join(lowering.SHORT_ADDRESSES)
    assert text.count(attributes) == 1
    short, long = (object_code(each, "x86-64-v3", "", 1) for each in (text, text.replace(attributes, "")))
    assert len(short) < len(long)


def check_machine_code(mechanism, rng, states=2):
    """Bit for bit with our sine and cosine; to round-off with those of CasADi."""
    equations = derive(mechanism)
    x = ca.SX.sym("x")
    pair = ca.Function("pair", [x], [ca.vertcat(ca.sin(x), ca.cos(x))])
    symbols = equations.rates.sx_in()
    rates = ca.Function("slopes", symbols, equations.rates.call(symbols)[:1])  # without the margin of the constraints
    readers = {"pair": pair, "slopes": rates, "energies": equations.energies, "poses": equations.poses}
    kernel = compile_kernel(equations.rates, equations.project, readers, METHODS["euler"])
    sine_cosine = _reader(kernel, "pair", 2)
    for _ in range(states):
        q, u, efforts = random_state(mechanism, rng)
        if len(equations.start.active) > len(equations.start.independent):
            # Of a state that contradicts dependent constraints, the accelerations are not determined to round-off.
            q, u, efforts = state_near_start(mechanism, equations, rng, 0.0)
        state = np.concatenate([q, u, rng.normal(size=3)])
        plain = interpret(rates, sine_cosine, [[0.0], state, efforts])
        assert bits(_reader(kernel, "slopes", len(plain))(0.0, state, efforts)) == bits(plain)
        expected = interpret(arranged(equations.rates), sine_cosine, [[0.0], state, efforts])
        if not equations.rows:
            stepped = state.copy()
            assert kernel.advance(stepped.ctypes.data, efforts.ctypes.data, 0, 1.0, 1) == 1
            moved = state + expected  # Euler's step of length one
            if equations.project is not None:
                moved = interpret(arranged(equations.project, fused=False), sine_cosine, [[1.0], moved])
            assert bits(stepped) == bits(moved)
        for name, function in (("energies", equations.energies), ("poses", equations.poses)):
            arguments = [[0.4], state]
            found = _reader(kernel, name, function.nnz_out(0))(*arguments)
            assert bits(found) == bits(interpret(function, sine_cosine, arguments))
        by_casadi = np.array(rates(0.0, state, efforts)).ravel()
        if len(u):
            oracle = kane.equations(mechanism, q, u, efforts)
            condition = oracle.condition * oracle.constraint_condition
            size = 1e-13 * condition * np.max(np.abs(by_casadi))
            assert plain == pytest.approx(by_casadi, rel=1e-11, abs=size)
            assert expected == pytest.approx(by_casadi, rel=1e-11, abs=size)


def _reader(kernel, name, size):
    def call(*arguments):
        arrays = [np.atleast_1d(np.array(argument, dtype=float)) for argument in arguments]
        out = np.empty(size)
        kernel.readers[name](*[a.ctypes.data for a in arrays], out.ctypes.data)
        return out

    return call


@pytest.mark.parametrize("name", ["gas_engine", "four_bar", "spherical_top"])
def test_machine_code_of_shipped_mechanisms(name):
    check_machine_code(load_mechanism(name), np.random.default_rng(40))


def test_machine_code_with_stops():
    mechanism = parse_mechanism(AUDITED.replace("STOP", "limits: {lower: -0.6, upper: 0.5, stiffness: 90}"))
    check_machine_code(mechanism, np.random.default_rng(41), states=5)


@settings(max_examples=2)
@given(random_trees())
def test_machine_code_of_random_trees(drawn):
    text, rng = drawn
    check_machine_code(parse_mechanism(text), rng, states=1)
