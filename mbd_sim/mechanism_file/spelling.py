"""How names in a mechanism file are spelled, and keys that were once spelled in another way."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

FORMER_KEYS = {"regularisation": "regularization"}  # still read in their place


def as_written(key: Any, data: Collection[Any]) -> Any:
    """The spelling of a key in the data of a file, which may have a former one."""
    spellings = [former for former, current in FORMER_KEYS.items() if current == key]
    spellings.append(FORMER_KEYS.get(key, key))
    return next((spelling for spelling in spellings if key not in data and spelling in data), key)
