"""Topic names of parts: ROS allows only letters, digits and underscores."""

from __future__ import annotations

import re
from collections.abc import Iterable

LONGEST = 100  # of a token: a topic has at most 247 characters


def topic_names(names: Iterable[str]) -> dict[str, str]:
    """A valid and unique topic token for each name: the name itself if it is valid.

    >>> topic_names(["rod", "bob-1", "bob.1", "2nd"])
    {'rod': 'rod', 'bob-1': 'bob_1', 'bob.1': 'bob_1_2', '2nd': '_2nd'}
    """
    names = list(names)
    tokens: dict[str, str] = {}
    for name in sorted(names, key=lambda name: _token(name) != name):  # valid names first: they stay as they are
        token, count = _token(name), 1
        while token in tokens.values():
            count += 1
            token = f"{_token(name)}_{count}"
        tokens[name] = token
    return {name: tokens[name] for name in names}


def _token(name: str) -> str:
    token = re.sub(r"_{2,}", "_", re.sub(r"[^A-Za-z0-9_]", "_", name))[:LONGEST] or "_"
    return f"_{token}" if token[0].isdigit() else token
