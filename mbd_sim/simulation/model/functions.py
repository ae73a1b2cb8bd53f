"""Functions of a model that are traced and compiled when they are first read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING

from mbd_sim.base import disk_cache
from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.python.bound_call import CompiledFunction

if TYPE_CHECKING:  # what was compiled before is read without CasADi
    import casadi as ca

    from mbd_sim.dynamics.equations import Equations
    from mbd_sim.dynamics.kinematics.frames import FrameQuantity
    from mbd_sim.dynamics.terms import DynamicsTerm


def _contact_places(equations: Equations) -> ca.Function:
    assert equations.one_sided is not None
    return equations.one_sided.places


FUNCTIONS: Mapping[str, Callable[[Equations], ca.Function]] = {
    "accelerations": lambda equations: equations.measurements.accelerations,
    "part_motions": lambda equations: equations.measurements.part_motions,
    "momentum": lambda equations: equations.measurements.momentum,
    "reactions": lambda equations: equations.reactions,
    "multipliers": lambda equations: equations.multipliers,
    "derivatives": lambda equations: equations.derivatives,
    "load_paths": lambda equations: equations.load_paths.function,
    "contact_places": _contact_places,
}


class RequestedFunctions:
    """The compiled functions of equations and of their `Measurements`; the simulations of one model share them."""

    __repr__ = short_repr

    def __init__(self, equations: Callable[[], Equations], key: str | None) -> None:
        """`equations` traces the equations, or returns those that are known.

        :param key: of the model in the cache, from which functions that were compiled before are loaded, without
            tracing anything; None if it is not there.
        """
        self._equations, self._key, self._lock = equations, key, Lock()
        self._found: dict[tuple[str | None, str], CompiledFunction] = {}

    def frame(self, part: str | None, quantity: FrameQuantity) -> CompiledFunction:
        """(t, y, inputs, point) -> a quantity of a point of a part; None: of the center of mass."""
        return self._compiled((part, quantity), lambda: self._equations().measurements.frame(part, quantity))

    def term(self, term: DynamicsTerm) -> CompiledFunction:
        """(t, y, inputs, u') -> a term of the equations of motion."""
        return self._compiled(("", term), lambda: self._equations().measurements.term(term))

    def sensor(self, name: str) -> CompiledFunction:
        """(t, y, inputs) -> the exact values of a sensor, under inputs that contain the contact forces."""
        return self._compiled(("sensor", name), lambda: self._sensors[name])

    @cached_property
    def _sensors(self) -> Mapping[str, ca.Function]:
        equations = self._equations()
        return equations.measurements.sensors(equations.actuators)

    def named(self, name: str) -> CompiledFunction:
        """(t, y, inputs) -> one of `FUNCTIONS`."""
        return self._compiled(("", name), lambda: FUNCTIONS[name](self._equations()))

    def _compiled(self, name: tuple[str | None, str], trace: Callable[[], ca.Function]) -> CompiledFunction:
        if (found := self._found.get(name)) is not None:  # without waiting for another one that is being compiled
            return found
        with self._lock:
            if name not in self._found:
                key = None if self._key is None else disk_cache.key("function", self._key, repr(name))
                self._found[name] = CompiledFunction.of(trace, key)
            return self._found[name]
