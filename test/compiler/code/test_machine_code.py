"""Machine code in memory."""

import ctypes
import gc

import pytest

from mbd_sim.compiler.code.host_module import compile_once
from mbd_sim.compiler.code.machine_code import load_code

# Both use constants; the second one calls the C library and the interpreter.
TEXT = """
declare double @sin(double)
declare i64 @PyList_Size(ptr)
define double @scaled(double %x) {
  %y = fmul double %x, 0x3FF8000000000000
  ret double %y
}
define double @sine_and_size(double %x, ptr %list) {
  %s = call double @sin(double %x)
  %n = call i64 @PyList_Size(ptr %list)
  %m = sitofp i64 %n to double
  %t = fmul double %s, 0x4008000000000000
  %y = fadd double %t, %m
  ret double %y
}
"""
scaled = ctypes.PYFUNCTYPE(ctypes.c_double, ctypes.c_double)
sine_and_size = ctypes.PYFUNCTYPE(ctypes.c_double, ctypes.c_double, ctypes.py_object)


def test_addresses_remain_valid_while_the_code_is_kept():
    gc.freeze()  # what other tests keep is not searched
    code = compile_once([TEXT], lambda: TEXT)
    first, second = scaled(code.address("scaled")), sine_and_size(code.address("sine_and_size"))
    gc.collect()
    others = [load_code(code.key) for _ in range(3)]
    assert [scaled(other.address("scaled"))(2.0) for other in others] == [3.0] * 3
    del others
    gc.collect()
    assert (first(2.0), second(0.0, [1, 2])) == (3.0, 2.0)
    assert code.address("scaled") == ctypes.cast(first, ctypes.c_void_p).value


def test_a_function_that_the_code_does_not_have_is_named():
    with pytest.raises(RuntimeError, match="velocity"):
        compile_once([TEXT], lambda: TEXT).address("velocity")
