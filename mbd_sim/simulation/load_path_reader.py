"""The loads of redundant joints as a function that is compiled when it is first read, if that pays off."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from mbd_sim.compiler.bound_call import Call, Clock
from mbd_sim.compiler.readers import CompiledReaders
from mbd_sim.dynamics.equations import Equations
from mbd_sim.geometry.pose import Array

# Instructions up to which the function is compiled, within about 0.3 s, which pay off after some three thousand calls.
# The time of compilation and the calls grow in proportion.
COMPILED = 5_000
NAME = "load_paths"


class LoadPathReader:
    """The output (size,) of the function of `Equations.load_paths`, compiled or, if that is long, by CasADi."""

    def __init__(self, equations: Equations) -> None:
        self._equations = equations

    def __call__(self, time: float, y: Array, inputs: Array) -> Array:
        """The output (size,) at a state."""
        if self._compiled is None:
            return self._equations.load_paths.values(time, y, inputs)
        return self._compiled.read(NAME, time, y, inputs)

    def bound(self, clock: Clock, arrays: Sequence[Array]) -> Call | None:
        """The function of arrays that stay where they are, see `CompiledReaders.bound_to`; None if not compiled."""
        return None if self._compiled is None else self._compiled.bound_to(NAME, clock, arrays)

    @cached_property
    def _compiled(self) -> CompiledReaders | None:
        function = self._equations.load_paths.function
        return None if function.n_instructions() > COMPILED else CompiledReaders({NAME: function})
