"""Everything in records, with every digit, as plain tuples that can be compared."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np


def contents(value):
    """A record, a mapping, a sequence or an array with all that is in it."""
    if is_dataclass(value):
        return type(value).__name__, *((field.name, contents(getattr(value, field.name))) for field in fields(value))
    if isinstance(value, Mapping):
        return (*((key, contents(each)) for key, each in value.items()),)
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, tuple | list):
        return (*(contents(each) for each in value),)
    return repr(value)
