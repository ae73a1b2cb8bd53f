"""Packages that export names of their modules, and import these modules only when such a name is first used.

What every run needs is imported as usual. What a run needs only after the first step, or only if nothing is found in
the cache, is used through the package: `from mbd_sim import dynamics`, then `dynamics.derive(…)`.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def lazy_names(package: str, modules: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """The `__getattr__` of a package that exports names lazily.

    :param package: its `__name__`.
    :param modules: the exported names by the modules of the package that define them. No name is that of a module of
        the package: importing that module would replace it.
    """
    module_of = {name: module for module, names in modules.items() for name in names}

    def find(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        found = getattr(importlib.import_module(f"{package}.{module_of[name]}"), name)
        setattr(sys.modules[package], name, found)
        return found

    return find
