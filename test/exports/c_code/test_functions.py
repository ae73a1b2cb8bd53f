"""Every operation of kernels has a C expression, with the same bits."""

import ctypes
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler.lists import lowering
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.python.bound_call import CompiledFunction
from mbd_sim.exports.c_code import functions
from mbd_sim.exports.c_code.functions import c_function, literal, sine_cosine_text
from mbd_sim.exports.c_code.module import FLAGS

SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 1e300, np.inf, -np.inf, np.nan, 1e6, -3e6, 1e22]


def operations(x, z):
    """Values with all operations of CasADi that kernels have."""
    less, equal = x < z, x == z
    return ca.vertcat(
        x + z, x - z, x * z, x / z, z / x + 1.0 / x, -x, x**2, x + x, 1.0 / z, ca.sqrt(x), ca.fabs(x), ca.sign(x), ca.floor(x),
        ca.sin(x), ca.cos(x), ca.tan(x), ca.exp(x), ca.log(x), ca.asin(x), ca.acos(x), ca.atan(x), ca.tanh(x),
        ca.atan2(x, z), x**z, x**2.5, ca.fmin(x, z), ca.fmax(x, z), less, x <= z, equal, x != z, ca.logic_not(equal),
        ca.if_else(less, x, z), x * z + x, x * x - z, z - x * x,
    )  # fmt: skip


def test_every_operation_of_kernels_has_an_expression():
    kernels = {*lowering._UNARY, *lowering._BINARY, *lowering._TERNARY, *lowering.LIBRARY}
    elsewhere = {ca.OP_ASSIGN, ca.OP_SIN, ca.OP_COS}  # see `_Statements.write`
    assert set(functions._EXPRESSIONS) == kernels - elsewhere


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
def test_operations_have_the_bits_of_the_kernel(tmp_path):
    t, y, inputs = ca.SX.sym("t"), ca.SX.sym("y", 1), ca.SX.sym("inputs", 1)
    plain = ca.Function("operations", [t, y, inputs], [ca.densify(operations(y, inputs))], {"cse": True})
    listed = arranged(plain)
    listed.nnz_out = plain.nnz_out
    text = c_function(listed, "all_of", ("t", "y", "in"), ("out",), ("t",))
    start = "#include <math.h>\n#include <stdint.h>\n#include <string.h>\n"
    call = "void run(const double *y, const double *in, double *out) { all_of(0.0, y, in, out); }\n"
    source, library = tmp_path / "all.c", tmp_path / "all.so"
    source.write_text(f"{start}{sine_cosine_text()}{text}\n{call}", encoding="utf-8")
    subprocess.run(["gcc", *FLAGS.split(), "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
    run, kernel = ctypes.CDLL(str(library)).run, CompiledFunction.of(lambda: listed)
    random = np.random.default_rng(0)
    angles = [*SPECIAL, *random.normal(scale=10.0, size=300), *random.normal(scale=1e6, size=100)]
    out = np.empty(plain.nnz_out(0))
    for x in angles:
        for z in (0.0, -2.5, 0.7, np.nan, x):
            one, other = np.array([x]), np.array([z])
            run(*(ctypes.c_void_p(array.ctypes.data) for array in (one, other, out)))
            expected = kernel.read(0.0, one, other)
            same = out.view(np.int64) == expected.view(np.int64)
            assert np.all(same | (np.isnan(out) & np.isnan(expected))), (x, z)


@pytest.mark.parametrize("value", [0.1, -0.1, 1e-308, -0.0, 5e-324, 1.7976931348623157e308])
def test_literals_are_exact(value):
    assert float(literal(value).strip("()")).hex() == value.hex()
