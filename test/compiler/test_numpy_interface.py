"""The fields of NumPy's arrays lie where machine code reads them."""

import ctypes

import numpy as np
import pytest

from mbd_sim.compiler import numpy_interface
from mbd_sim.compiler.python_callable import TYPE


def field(thing, offset, kind):
    return kind.from_address(id(thing) + offset).value


@pytest.mark.parametrize(
    "array", [np.ones(3), np.ones((2, 5), dtype=np.float32).T, np.arange(7)[::-2], np.ones(4, dtype=">f8"), np.ones(())]
)
def test_fields_lie_where_they_are_read(array):
    pointer, length = ctypes.c_void_p, ctypes.c_ssize_t
    assert field(array, TYPE, pointer) == id(type(array)) and field(1.0, TYPE, pointer) == id(float)
    assert field(array, numpy_interface.DATA, pointer) == array.ctypes.data
    assert field(array, numpy_interface.DIMENSIONS, ctypes.c_int) == array.ndim
    if array.ndim:
        lengths, strides = (
            (length * array.ndim).from_address(field(array, offset, pointer))
            for offset in (numpy_interface.LENGTHS, numpy_interface.STRIDES)
        )
        assert tuple(lengths) == array.shape and tuple(strides) == array.strides
    assert field(array, numpy_interface.DTYPE, pointer) == id(array.dtype)
    assert field(array, numpy_interface.FLAGS, ctypes.c_int) & numpy_interface.ALIGNED == numpy_interface.ALIGNED
    assert field(array.dtype, numpy_interface.BYTE_ORDER, ctypes.c_char).decode() == array.dtype.byteorder
    assert field(array.dtype, numpy_interface.TYPE_NUMBER, ctypes.c_int) == array.dtype.num


def test_flags_and_numbers_are_those_of_numpy():
    misaligned = np.zeros(17, dtype=np.uint8)[1:].view(float)
    assert not misaligned.flags.aligned
    assert field(misaligned, numpy_interface.FLAGS, ctypes.c_int) & numpy_interface.ALIGNED == 0
    assert (np.dtype(np.float32).num, np.dtype(float).num) == (numpy_interface.SINGLE, numpy_interface.DOUBLE)
    assert chr(numpy_interface.NATIVE) == np.dtype(float).byteorder
