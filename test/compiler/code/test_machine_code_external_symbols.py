"""What machine code uses of NumPy lies where it is looked for."""

import re
from pathlib import Path

import numpy as np
import pytest

from mbd_sim.compiler.code import machine_code


def test_the_version_has_its_place_in_the_table():
    (header,) = Path(np.get_include()).glob("numpy/__multiarray_api.h")
    (found,) = re.findall(
        r"#define PyArray_GetNDArrayCVersion \\\n.*?PyArray_API\[(\d+)\]", header.read_text(), re.DOTALL
    )
    assert int(found) == machine_code.VERSION


def test_other_binary_interfaces_are_refused(monkeypatch):
    monkeypatch.setattr(machine_code, "_KNOWN", (0x0300_0000,))
    with pytest.raises(ImportError, match=r"binary interface 0x\d+, which mbd_sim does not know.*Install an older"):
        machine_code.external_symbols.__wrapped__()
