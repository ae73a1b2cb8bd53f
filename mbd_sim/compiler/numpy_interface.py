"""Where machine code finds the fields of NumPy's arrays.

See https://numpy.org/doc/stable/reference/c-api/types-and-structures.html for `PyArrayObject` and `PyArray_Descr`.
"""

from __future__ import annotations

from mbd_sim.compiler.python_callable import HEAD

# Offsets of `PyArrayObject` and `PyArray_Descr` in bytes.
DATA, DIMENSIONS, LENGTHS, STRIDES, DTYPE, FLAGS = (HEAD + offset for offset in (0, 8, 16, 24, 40, 48))
BYTE_ORDER, TYPE_NUMBER = HEAD + 10, HEAD + 12

ALIGNED = 0x0100  # of the flags
NATIVE = ord("=")  # of the byte order
SINGLE, DOUBLE = 11, 12  # of the type number
