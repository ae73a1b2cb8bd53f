"""Names of parts as names of topics, which know only letters, digits and underscores."""

from __future__ import annotations

import re
from collections.abc import Iterable


def topic_names(names: Iterable[str]) -> dict[str, str]:
    """A valid and unique token of a topic's name for each name, the name itself where it is one.

    >>> topic_names(["rod", "bob-1", "bob.1", "2nd"])
    {'rod': 'rod', 'bob-1': 'bob_1', 'bob.1': 'bob_1_2', '2nd': '_2nd'}
    """
    names = list(names)
    found: dict[str, str] = {}
    for name in sorted(names, key=lambda name: _token(name) != name):  # what is valid as it is keeps its name
        token, count = _token(name), 1
        while token in found.values():
            count += 1
            token = f"{_token(name)}_{count}"
        found[name] = token
    return {name: found[name] for name in names}


def _token(name: str) -> str:
    token = re.sub(r"_{2,}", "_", re.sub(r"[^A-Za-z0-9_]", "_", name)) or "_"
    return f"_{token}" if token[0].isdigit() else token
