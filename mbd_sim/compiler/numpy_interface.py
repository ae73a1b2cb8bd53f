"""NumPy's C interface for machine code: where the fields of an array lie.

See https://numpy.org/doc/stable/reference/c-api/types-and-structures.html, `PyArrayObject` and `PyArray_Descr`.
"""

from __future__ import annotations

import ctypes
import functools
from importlib import import_module

import numpy as np

from mbd_sim.compiler.python_callable import HEAD

# Offsets of `PyArrayObject` and `PyArray_Descr` in bytes.
DATA, DIMENSIONS, LENGTHS, STRIDES, DTYPE, FLAGS = (HEAD + offset for offset in (0, 8, 16, 24, 40, 48))
BYTE_ORDER, TYPE_NUMBER = HEAD + 10, HEAD + 12

ALIGNED = 0x0100  # of the flags
NATIVE = ord("=")  # of the byte order
SINGLE, DOUBLE = 11, 12  # of the type number

_KNOWN = (0x0100_0009, 0x0200_0000)  # binary interfaces: those of NumPy 1 and 2
_VERSION = 0  # index of `PyArray_GetNDArrayCVersion` in NumPy's table of functions


@functools.cache
def require_known_layout() -> None:
    """Check that the fields lie where machine code reads them, as C modules do when they are imported.

    :raises ImportError: this version of NumPy may place them differently.
    """
    version = ctypes.CFUNCTYPE(ctypes.c_uint)(_functions()[_VERSION])()
    if version not in _KNOWN:
        raise ImportError(
            f"NumPy {np.__version__} has the binary interface {version:#x}, which mbd_sim does not know. "
            "Install an older NumPy: pip install 'numpy<3'."
        )


@functools.cache
def _functions() -> ctypes.Array[ctypes.c_size_t]:
    """The beginning of NumPy's table of functions."""
    core = "numpy._core" if np.lib.NumpyVersion(np.__version__) >= "2.0.0" else "numpy.core"
    capsule = import_module(f"{core}._multiarray_umath")._ARRAY_API
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return (ctypes.c_size_t * 1).from_address(pointer(capsule, None))
