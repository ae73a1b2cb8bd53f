"""What machine code uses of the interpreter and of NumPy: names and addresses.

See https://numpy.org/doc/stable/reference/c-api/array.html for NumPy's table of functions.
"""

from __future__ import annotations

import ctypes
import functools
from importlib import import_module

import numpy as np

NONE = "_Py_NoneStruct"
NAMES = (
    "PyTuple_GetItem",
    "PyBytes_AsString",
    "PyLong_AsLongLong",
    "PyErr_Occurred",
    "PyErr_Clear",
    "PyObject_Vectorcall",
    "PyEval_SaveThread",
    "PyEval_RestoreThread",
    "Py_IncRef",
    "PyList_Size",
    "PyList_GetItem",
    "PyTuple_Size",
    "PyFloat_AsDouble",
)

VERSION = 0  # of `PyArray_GetNDArrayCVersion` in NumPy's table of functions
_KNOWN = (0x0100_0009, 0x0200_0000)  # binary interfaces: those of NumPy 1 and 2


@functools.cache
def external_symbols() -> dict[str, int]:
    """The addresses by the names that machine code has for them.

    NumPy's arrays must have their fields where machine code reads them; C modules check the same when imported.

    :raises ImportError: this version of NumPy may place the fields differently.
    """
    version = ctypes.CFUNCTYPE(ctypes.c_uint)(_numpy_functions()[VERSION])()
    if version not in _KNOWN:
        raise ImportError(
            f"NumPy {np.__version__} has the binary interface {version:#x}, which mbd_sim does not know. "
            "Install an older NumPy: pip install 'numpy<3'."
        )
    functions = {name: ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0 for name in NAMES}
    return {**functions, NONE: id(None)}


def _numpy_functions() -> ctypes.Array[ctypes.c_size_t]:
    """The beginning of NumPy's table of functions."""
    core = "numpy._core" if np.lib.NumpyVersion(np.__version__) >= "2.0.0" else "numpy.core"
    capsule = import_module(f"{core}._multiarray_umath")._ARRAY_API
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return (ctypes.c_size_t * (VERSION + 1)).from_address(pointer(capsule, None))
