"""Functions of a model that are traced and compiled when they are first read."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock

import casadi as ca

from mbd_sim.compiler.bound_call import CompiledFunction
from mbd_sim.dynamics.dynamics_terms import DynamicsTerm
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.frame_functions import FrameQuantity


class RequestedFunctions:
    """The compiled functions of equations and of their `Measurements`; the simulations of one model share them."""

    def __init__(self, equations: Equations) -> None:
        self._equations, self._measurements, self._lock = equations, equations.measurements, Lock()
        self._found: dict[tuple[str | None, str], CompiledFunction] = {}

    def frame(self, part: str | None, quantity: FrameQuantity) -> CompiledFunction:
        """(t, y, inputs, point) -> a quantity of a point of a part; None: of the center of mass."""
        return self._compiled((part, quantity), lambda: self._measurements.frame(part, quantity))

    def term(self, term: DynamicsTerm) -> CompiledFunction:
        """(t, y, inputs, u') -> a term of the equations of motion."""
        return self._compiled(("", term), lambda: self._measurements.term(term))

    def momentum(self) -> CompiledFunction:
        """(t, y, inputs) -> the linear momentum, and the angular one about ground's origin."""
        return self._compiled(("", "momentum"), lambda: self._measurements.momentum)

    def reactions(self) -> CompiledFunction:
        """(t, y, inputs) -> the force and the moment (joints, 6) across each joint, see `joint_reactions`."""
        return self._compiled(("", "reactions"), lambda: self._equations.reactions)

    def derivatives(self) -> CompiledFunction:
        """(t, y, inputs) -> the derivatives of the rates and of the constraints, see `rate_derivatives`."""
        return self._compiled(("", "derivatives"), lambda: self._equations.derivatives)

    def _compiled(self, key: tuple[str | None, str], trace: Callable[[], ca.Function]) -> CompiledFunction:
        with self._lock:
            if key not in self._found:
                self._found[key] = CompiledFunction.of(trace())
            return self._found[key]
