"""The fields of NumPy's arrays lie where machine code reads them."""

import ctypes

import numpy as np
import pytest

from mbd_sim.compiler.python import bound_kernel
from mbd_sim.compiler.python.bound_kernel import TYPE


def field(thing, offset, kind):
    return kind.from_address(id(thing) + offset).value


@pytest.mark.parametrize(
    "array", [np.ones(3), np.ones((2, 5), dtype=np.float32).T, np.arange(7)[::-2], np.ones(4, dtype=">f8"), np.ones(())]
)
def test_fields_lie_where_they_are_read(array):
    pointer, length = ctypes.c_void_p, ctypes.c_ssize_t
    assert field(array, TYPE, pointer) == id(type(array)) and field(1.0, TYPE, pointer) == id(float)
    assert field(array, bound_kernel.DATA, pointer) == array.ctypes.data
    assert field(array, bound_kernel.DIMENSIONS, ctypes.c_int) == array.ndim
    if array.ndim:
        lengths, strides = (
            (length * array.ndim).from_address(field(array, offset, pointer))
            for offset in (bound_kernel.LENGTHS, bound_kernel.STRIDES)
        )
        assert tuple(lengths) == array.shape and tuple(strides) == array.strides
    assert field(array, bound_kernel.DTYPE, pointer) == id(array.dtype)
    assert field(array, bound_kernel.FLAGS, ctypes.c_int) & bound_kernel.ALIGNED == bound_kernel.ALIGNED
    assert field(array.dtype, bound_kernel.BYTE_ORDER, ctypes.c_char).decode() == array.dtype.byteorder
    assert field(array.dtype, bound_kernel.TYPE_NUMBER, ctypes.c_int) == array.dtype.num


def test_flags_and_numbers_are_those_of_numpy():
    misaligned = np.zeros(17, dtype=np.uint8)[1:].view(float)
    assert not misaligned.flags.aligned
    assert field(misaligned, bound_kernel.FLAGS, ctypes.c_int) & bound_kernel.ALIGNED == 0
    assert (np.dtype(np.float32).num, np.dtype(float).num) == (bound_kernel.SINGLE, bound_kernel.DOUBLE)
    assert chr(bound_kernel.NATIVE) == np.dtype(float).byteorder
