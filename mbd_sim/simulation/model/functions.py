"""Functions of a model that are traced and compiled when they are first read."""

from __future__ import annotations

from collections.abc import Callable
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

    def momentum(self) -> CompiledFunction:
        """(t, y, inputs) -> the linear momentum, and the angular one about ground's origin."""
        return self._compiled(("", "momentum"), lambda: self._equations().measurements.momentum)

    def reactions(self) -> CompiledFunction:
        """(t, y, inputs) -> the force and the moment (joints, 6) across each joint, see `joint_reactions`."""
        return self._compiled(("", "reactions"), lambda: self._equations().reactions)

    def multipliers(self) -> CompiledFunction:
        """(t, y, inputs) -> the Lagrange multipliers (m,) of all rows; redundant ones do not share the load."""
        return self._compiled(("", "multipliers"), lambda: self._equations().multipliers)

    def derivatives(self) -> CompiledFunction:
        """(t, y, inputs) -> the derivatives of the rates and of the constraints, see `rate_derivatives`."""
        return self._compiled(("", "derivatives"), lambda: self._equations().derivatives)

    def _compiled(self, name: tuple[str | None, str], trace: Callable[[], ca.Function]) -> CompiledFunction:
        with self._lock:
            if name not in self._found:
                key = None if self._key is None else disk_cache.key("function", self._key, repr(name))
                self._found[name] = CompiledFunction.of(trace, key)
            return self._found[name]
