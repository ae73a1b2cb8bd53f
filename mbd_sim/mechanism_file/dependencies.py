"""The order in which names that refer to each other can be evaluated."""

from __future__ import annotations

from collections.abc import Mapping


def dependencies_first(uses: Mapping[str, set[str]]) -> list[str]:
    """The names, each after those that it uses; without names in circles and those that depend on them."""
    used_by = users(uses)
    waiting = {name: len(used & uses.keys()) for name, used in uses.items()}
    order = [name for name, count in waiting.items() if not count]
    for name in order:
        for user in sorted(used_by[name]):
            waiting[user] -= 1
            if not waiting[user]:
                order.append(user)
    return order


def users(uses: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The names that use each name."""
    found: dict[str, set[str]] = {name: set() for name in uses}
    for name, used in uses.items():
        for other in used & uses.keys():
            found[other].add(name)
    return found
