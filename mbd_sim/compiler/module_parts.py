"""Modules in parts, whose object code is linked together.

A function that is not inlined is compiled in the same way wherever it is defined, so the parts have the same results
as the whole module to the bit.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from mbd_sim.compiler.ir import Function, Module

EXPORTED = ""  # the linkage of functions that other parts may call
_NAME = re.compile(r'@"([^"]+)"')


class ModuleParts:
    """The functions of a module that are not yet in a part."""

    def __init__(self, module: Module) -> None:
        self._module = module
        self._texts: dict[str, str] = {}
        self._called: dict[str, list[str]] = {}
        self._taken: set[str] = set()

    def sizes(self) -> dict[str, int]:
        """The characters of each function that is in no part yet, with those of the functions inlined into it."""
        return {
            name: sum(len(self._text(each)) for each in [name, *self._inlined(name)])
            for name, function in self._module.functions.items()
            if function.blocks and not function.is_inlined and name not in self._taken
        }

    def take(self, names: Sequence[str]) -> str:
        """The IR of a part with these functions; none of them may change from now on.

        Functions that are inlined into them are in the part too; other functions that they call are declared.
        """
        self._taken.update(names)
        defined = dict.fromkeys(each for name in names for each in [name, *self._inlined(name)])
        needed = {called for name in defined for called in self._callees(name)} | defined.keys()
        functions = [function for name, function in self._module.functions.items() if name in needed]
        return "\n".join([self._module.header(), *(self._written(one, one.name in defined) for one in functions), ""])

    def _written(self, function: Function, is_defined: bool) -> str:
        return self._text(function.name) if is_defined else function.declaration()

    def _text(self, name: str) -> str:
        """The definition of a function as it is in a part."""
        if name not in self._texts:
            function = self._module.functions[name]
            self._texts[name] = str(function) if function.is_inlined else function.definition(EXPORTED)
        return self._texts[name]

    def _callees(self, name: str) -> list[str]:
        if name not in self._called:
            called = dict.fromkeys(_NAME.findall(self._text(name)))
            self._called[name] = [each for each in called if each != name and each in self._module.functions]
        return self._called[name]

    def _inlined(self, name: str) -> list[str]:
        """The functions that are inlined into one, also by way of others."""
        found: dict[str, None] = {}
        waiting = [name]
        while waiting:
            for each in self._callees(waiting.pop()):
                if self._module.functions[each].is_inlined and each not in found:
                    found[each] = None
                    waiting.append(each)
        return list(found)


def shares(sizes: dict[str, int], count: int) -> list[list[str]]:
    """The functions of these sizes as at most `count` lists of similar total size."""
    found: list[list[str]] = [[] for _ in range(count)]
    totals = [0] * count
    for name in sorted(sizes, key=lambda name: -sizes[name]):  # the longest first, to the shortest list
        shortest = totals.index(min(totals))
        found[shortest].append(name)
        totals[shortest] += sizes[name]
    return [share for share in found if share]
