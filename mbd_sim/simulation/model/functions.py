"""Functions of a model that are traced and compiled when they are first read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING

from mbd_sim.base import disk_cache
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.python.bound_call import Call, Clock, CompiledFunction, CompiledReaders
from mbd_sim.simulation.model.state_records import PartMotion

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


class MotionReaders:
    """Accelerations of the coordinates and motions of the parts, under inputs that contain the contact forces."""

    def __init__(self, equations: Equations) -> None:
        """Compile the functions; this takes as long as for the kernel of the mechanism."""
        from mbd_sim.compiler.python.bound_call import CompiledReaders

        functions = {name: getattr(equations.measurements, name) for name in ("accelerations", "part_motions")}
        self._readers, self._part_names = CompiledReaders(functions), equations.part_names

    def accelerations(self, time: float, y: Array, inputs: Array) -> Array:
        """The accelerations of the coordinates, then of the driven ones."""
        return self._readers.read("accelerations", time, y, inputs)

    def bound_accelerations(self, clock: Clock, y: Array, inputs: Array, count: int) -> Call:
        """The first ones of arrays that stay where they are, as a callable: see `CompiledFunction.bound`."""
        return self._readers.bound_to("accelerations", clock, (y, inputs), slice(count))

    def rows(self, time: float, y: Array, inputs: Array) -> Array:
        """(parts, 4, 3): velocity, angular velocity and their rates."""
        return self._readers.read("part_motions", time, y, inputs).reshape(-1, 4, 3)

    def parts(self, time: float, y: Array, inputs: Array, poses: Mapping[str, Pose]) -> dict[str, PartMotion]:
        """The motion of each part, with its pose."""
        return {
            name: PartMotion(poses[name], *(vector.copy() for vector in row))
            for name, row in zip(self._part_names, self.rows(time, y, inputs), strict=True)
        }
