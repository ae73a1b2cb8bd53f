"""Modules of IR that the process emits which compiles them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mbd_sim.compiler.ir import Module


class ModuleOrder(NamedTuple):
    """A module at a level of LLVM's code generator; `emit`, which can be pickled, adds its functions."""

    triple: str
    level: int
    emit: Callable[[Module], object]

    def text(self) -> str:
        """The IR."""
        module = Module(self.triple, self.level)
        self.emit(module)
        return str(module)
