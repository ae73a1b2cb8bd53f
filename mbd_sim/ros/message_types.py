"""Message classes by the names of their types."""

from __future__ import annotations

import importlib


def message_type(name: str) -> type:
    """The class of a type such as `std_msgs/msg/String`.

    :raises ImportError, AttributeError: it is not installed.
    :raises ValueError: the name is not that of a type.
    """
    package, _, kind = name.partition("/")
    kind = kind.rpartition("/")[2]
    if not package or not kind:
        raise ValueError(f"'{name}' is not the name of a message type.")
    found: type = getattr(importlib.import_module(f"{package}.msg"), kind)
    return found
