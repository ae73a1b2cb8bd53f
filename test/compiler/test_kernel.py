"""The stepping loop: the formula of the method bit for bit, however it is compiled, and its failures."""

from __future__ import annotations

import gc
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from mbd_sim.base import disk_cache
from mbd_sim.compiler import kernel as kernel_module
from mbd_sim.compiler.code import host_module, machine_code
from mbd_sim.compiler.ir import module
from mbd_sim.compiler.kernel import compile_kernel
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.integrators.explicit import EXPLICIT
from mbd_sim.integrators.methods import METHODS
from mbd_sim.simulation.model import builder
from mbd_sim.simulation.model.model import build_model
from test.generators.mechanisms import AUDITED, FLOATING
from test.oracles.instruction_interpreter import fma, interpret

MECHANISMS = {
    "double_rod": lambda: load_mechanism("double_rod"),
    "audited": lambda: parse_mechanism(AUDITED.replace("STOP", "limits: {lower: -0.6, upper: 2, stiffness: 90}")),
    "floating": lambda: parse_mechanism(FLOATING),
}


def compile_model(name, method="rk4"):
    equations = derive(MECHANISMS[name]())
    return compile_kernel(equations.rates, equations.project, {}, METHODS[method]), equations


def advance(kernel, y, efforts, first, h, steps):
    return kernel.advance(y.ctypes.data, efforts.ctypes.data, first, h, steps)


def run(kernel, equations, steps, h=1e-3, first=0):
    y = equations.start_state.copy()
    efforts = np.linspace(-0.4, 0.5, equations.layout.nv)
    history = np.zeros(METHODS["adams11"].history_size(y.size, efforts.size))  # which other methods leave alone
    assert advance(kernel, y, np.concatenate([efforts, history]), first, h, steps) == 1
    return y


def bits(values):
    return values.view(np.uint64).tolist()


def test_two_compilations_give_the_same_bits():
    first, second = (run(*compile_model("double_rod", "dop853"), 10_000) for _ in range(2))
    assert bits(first) == bits(second)
    assert np.all(np.abs(first[2:4]) > 1e-3)


def test_a_processor_without_fused_operations_gets_the_same_bits(monkeypatch):
    """Without them, fused operations are calls of the C library, which also round once."""
    here = run(*compile_model("audited", "dop853"), 300)
    for user in (machine_code, host_module):
        monkeypatch.setattr(user, "host", lambda: ("generic", ""))
    assert bits(run(*compile_model("audited", "dop853"), 300)) == bits(here)


@pytest.mark.parametrize(("name", "method"), [("double_rod", "rk4"), ("audited", "rosenbrock"), ("floating", "gauss6")])
def test_many_steps_in_one_call_are_as_many_calls_of_one_step(name, method):
    kernel, equations = compile_model(name, method)
    at_once = run(kernel, equations, 500)
    y, efforts = equations.start_state.copy(), np.linspace(-0.4, 0.5, equations.layout.nv)
    for step in range(500):
        assert advance(kernel, y, efforts, step, 1e-3, 1) == 1
    assert bits(y) == bits(at_once)


@pytest.mark.parametrize(
    ("name", "method"),
    [("double_rod", "rk4"), ("double_rod", "adams11"), ("audited", "gauss4")],
)
def test_how_it_is_compiled_does_not_show(monkeypatch, name, method):
    """Rates inlined or called, arrays in registers, in memory or in loops, optimized or not: the same bits."""
    found = []
    for level, inlined, unrolled, few in (
        (1, 10**9, 10**9, 0),
        (1, 0, 10**9, 0),
        (1, 0, 0, 0),
        (1, 2000, 40, 0),
        (1, 2000, 40, 10**9),
        (0, 2000, 40, 0),
    ):
        if (name, method) != ("double_rod", "rk4") and (inlined, few) != (2000, 0):
            continue  # they have all parts, and take longer
        monkeypatch.setattr(machine_code, "LEVEL", level)
        monkeypatch.setattr(kernel_module, "INLINED", inlined)
        monkeypatch.setattr(module, "UNROLLED", unrolled)
        monkeypatch.setattr(kernel_module, "FEW", few)
        found.append(bits(run(*compile_model(name, method), 300)))
    assert len(found) >= 2
    assert all(other == found[0] for other in found)


def by_numpy(function, *, fused=True):
    """A function as the kernel computes it."""
    return lambda t, *vectors: interpret(arranged(function, fused=fused), None, [[t], *vectors])


def textbook_step(rates, project, method, y, inputs, step, h):
    """y + h Σ b k, term by term in the order of the stages; of a stage the last term is added to all others."""
    k = []
    t = np.float64(step) * h
    fused = np.vectorize(fma)

    def total(terms):
        (weight, slope), *more = terms
        found = slope if weight == 1.0 else weight * slope
        for weight, slope in more:
            found = fused(weight, slope, found)
        return found

    def stage(weights):
        terms = [(weight, slope) for weight, slope in zip(weights, k, strict=False) if weight]
        if not terms:
            return y
        *early, (weight, last) = terms
        return fused(h * weight, last, fused(h, total(early), y) if early else y)

    for a, c in zip(method.a, method.c, strict=True):
        k.append(rates(t if c == 0.0 else t + c * h, stage(a), inputs))
    new = fused(h, total([(weight, slope) for weight, slope in zip(method.b, k, strict=True) if weight]), y)
    return new if project is None else project(np.float64(step + 1) * h, new)


@pytest.mark.parametrize("method", EXPLICIT.values(), ids=EXPLICIT)
def test_a_step_is_the_formula_of_the_method(method):
    """A system without sine and cosine, so that numpy has the same bits; it depends on time."""
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", 3), ca.SX.sym("e", 2)
    rates = ca.Function(
        "rates",
        [t, y, inputs],
        [ca.vertcat(y[1] * t - inputs[0], -y[0] / ca.sqrt(1.0 + y[2] ** 2), y[0] * y[1] - 0.1 * t * t + inputs[1])],
    )
    project = ca.Function("settle", [t, y], [y * (1.0 - 1e-3 * t * ca.dot(y, y))])
    start, forces = np.array([0.3, -0.2, 0.7]), np.array([0.11, -0.7])
    for scale in (None, project):
        kernel = compile_kernel(rates, scale, {}, method)
        found, expected = start.copy(), start.copy()
        for step in range(3, 15):
            assert advance(kernel, found, forces, step, 0.037, 1) == 1
            expected = textbook_step(
                by_numpy(rates), scale and by_numpy(scale, fused=False), method, expected, forces, step, 0.037
            )
            assert bits(found) == bits(expected)


@pytest.mark.parametrize("unrolled", [0, 100])
@pytest.mark.parametrize("bad", [0, 1, 2])
def test_divergence_leaves_the_state_as_it_was(monkeypatch, unrolled, bad):
    """y' = y² is infinite at t = 1 from y = 1; whichever component it is, none is written."""
    monkeypatch.setattr(module, "UNROLLED", unrolled)
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", 3), ca.SX.sym("e", 1)
    slopes = [ca.SX(1.0)] * 3
    slopes[bad] = y[bad] * y[bad]
    rates = ca.Function("rates", [t, y, inputs], [ca.vertcat(*slopes)])
    kernel = compile_kernel(rates, None, {}, METHODS["rk4"])
    state, nothing = np.ones(3), np.zeros(1)
    before = state.copy()
    assert advance(kernel, state, nothing, 0, 0.01, 500) == 0
    assert bits(state) == bits(before)
    assert advance(kernel, state, nothing, 0, 0.01, 90) == 1
    assert state[bad] == pytest.approx(10.0, rel=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_an_input_that_is_not_finite_is_noticed(value):
    kernel, equations = compile_model("double_rod")
    y, efforts = equations.start_state.copy(), np.array([0.0, value])
    assert advance(kernel, y, efforts, 0, 1e-3, 1) == 0
    assert bits(y) == bits(equations.start_state)


def test_no_steps_change_nothing():
    kernel, equations = compile_model("double_rod")
    assert bits(run(kernel, equations, 0)) == bits(equations.start_state)


def test_time_is_the_step_index_times_the_step():
    """y' = t in one Euler step of length h from step k adds h (k h), rounded as written."""
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y"), ca.SX.sym("e")
    kernel = compile_kernel(ca.Function("rates", [t, y, inputs], [t]), None, {}, METHODS["euler"])
    for first in (0, 1, 3, 10**9 + 7, 2**52 + 1):
        state = np.zeros(1)
        assert advance(kernel, state, np.zeros(1), first, 0.1, 1) == 1
        assert state[0] == 0.1 * (first * 0.1)


def test_kernels_count_their_instructions():
    x, y, t = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("t")
    kernel = compile_kernel(ca.Function("rates", [t, y, x], [ca.sin(y * x + 2.5)]), None, {}, METHODS["euler"])
    assert kernel.instructions == 2  # one of them fused


def test_a_model_is_usable_after_its_equations_are_gone():
    """The code stays alive as long as the kernel does."""
    model = build_model(load_mechanism("rod_pendulum"), "rk4")
    kernel, y, start = model.kernel, model.start.copy(), model.start.copy()
    del model
    gc.collect(1)
    assert advance(kernel, y, np.zeros(1), 0, 1e-3, 10) == 1
    assert y[0] < start[0]


BOUNCING = """
mechanism: bouncing
parts: {ball: {shape: {type: sphere, mass: 1, radius: 0.1}}}
joints: {height: {type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: 1}}
contacts: {floor: {parts: [ball], plane: ground, restitution: 0.5}}
"""


@pytest.fixture
def emitted_once(monkeypatch, tmp_path):
    """Kernels of contacts are looked up, as for users, in a folder of their own."""
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path))
    monkeypatch.setattr(kernel_module, "compiled_before", host_module.compiled_before)
    monkeypatch.setattr(kernel_module, "records_digest", disk_cache.records_digest)


@pytest.mark.usefixtures("emitted_once")
def test_code_of_contacts_is_emitted_once(monkeypatch, tmp_path):
    """A second start of a robot on its floor took six seconds, of which four emitted what was compiled before."""

    def compiled(text, method="tsitouras8"):
        return builder._kernel(derive(parse_mechanism(text)), SimpleNamespace(method=METHODS[method]))

    first = compiled(BOUNCING)

    def emitted():
        raise AssertionError("emitted again")

    monkeypatch.setattr(kernel_module, "new_module", emitted)
    again = compiled(BOUNCING)
    assert again.signature == first.signature
    assert again.code.key == first.code.key
    stopped = BOUNCING.replace("position: 1", "position: 1, limits: {lower: -5, upper: 5, restitution: 0.1}")
    for others in ((BOUNCING, "rk4"), (stopped,)):
        with pytest.raises(AssertionError, match="emitted again"):
            compiled(*others)
    for entry in tmp_path.iterdir():
        if entry.is_file() and entry.stat().st_size > 1500:
            entry.unlink()  # the code itself is gone, as when the cache is full
    with pytest.raises(AssertionError, match="emitted again"):
        compiled(BOUNCING)


@pytest.mark.usefixtures("emitted_once")
def test_a_long_compilation_is_announced_once(monkeypatch, caplog):
    """The first start of a mechanism with many contacts took a minute without a word."""
    caplog.set_level("INFO", logger="mbd_sim.compiler.kernel")
    mechanism, said = (
        parse_mechanism(BOUNCING),
        "compiling the equations may take {} s; later starts find them in the cache",
    )

    def told():
        caplog.clear()
        builder._kernel(derive(mechanism), SimpleNamespace(method=METHODS["tsitouras8"]))
        return [record.getMessage() for record in caplog.records]

    monkeypatch.setattr(kernel_module, "WITH_CONTACTS", 1.0)
    (first,) = told()
    seconds = int(first.split()[5])
    assert first == said.format(seconds)
    assert seconds >= 10
    assert told() == []
    monkeypatch.setenv("MBD_SIM_CACHE", "off")
    (without,) = told()
    assert without.endswith("s; without a cache (MBD_SIM_CACHE), at each start")
    monkeypatch.setattr(kernel_module, "WITH_CONTACTS", 5.0 / seconds)
    assert told() == []
