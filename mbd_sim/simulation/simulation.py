"""A mechanism in motion: build it, step it, read it. Knows no ROS, no files but the mechanism's, and no clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from mbd_sim.compiler.fastcall import LARGEST
from mbd_sim.errors import CommandError, DivergedError, nearest
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.compiled_model import (
    Drive,
    Energies,
    Model,
    Reaction,
    Violation,
    build_model,
)
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.live_values import LiveValues
from mbd_sim.simulation.step_advice import step_advice
from mbd_sim.simulation.wrenches import WrenchMap

OPENED = 1e-6  # violation of the constraints that a change of live values must not exceed, m or 1

if TYPE_CHECKING:
    from mbd_sim.analysis.inverse_dynamics import InverseDynamics
    from mbd_sim.analysis.linearization import Linearization


class Simulation:
    """A mechanism and its state, advanced by a fixed step.

    `q` (nq,) are the generalized coordinates and `u` (nv,) the generalized speeds in the order of the file's
    joints, in m, rad, m/s and rad/s; free joints have a position and a unit quaternion (w, x, y, z) in q, and a
    velocity in the first part's axes and an angular velocity in the second's in u. They, `y` (the integrated state: q,
    u, and the audit's energies), `efforts` and `inputs` are read-only views of the kernel's own memory: they show the
    motion as it goes on; copy what you want to keep. Not to be shared by threads.

    >>> sim = Simulation.from_file("double_rod")
    >>> sim.run(until=3.0)
    >>> abs(sim.energies.residual) < 1e-11
    True
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        method: str | None = None,
        step: float | None = None,
        wrenches: Sequence[str] = (),
        live: Sequence[str] = (),
    ) -> None:
        """Compile a mechanism; `method` and `step` (s) replace those of its file.

        :param wrenches: parts on which forces from outside can act, see `set_wrench`.
        :param live: values of the file that can change while it runs, see `set_live`: keys such as `gravity[2]`,
            `parameters.l`, `joints.elbow.damping`, or patterns such as `joints.*.damping`.
        :raises MechanismError: an unknown method, equations that are singular at the start, or a live value that is
            none or cannot change.
        :raises ValueError: the step is not a positive number.
        :raises CommandError: there is no such part to load.
        """
        self.mechanism = mechanism
        self.step_size = mechanism.step if step is None else float(step)
        if not (math.isfinite(self.step_size) and self.step_size > 0.0):
            raise ValueError(f"the step must be a positive number of seconds, not {step!r}")
        for part in wrenches:
            if part not in mechanism.parts:
                raise CommandError(f"there is no part '{part}'. {nearest(part, mechanism.parts)}")
        self._live = LiveValues(mechanism, live)
        self.model: Model = build_model(mechanism, method, wrenches, self._live.values)
        self._y, self._inputs = self.model.start.copy(), self.model.inputs.copy()
        taken = self.model.equations.inputs
        self._efforts, self._values = self._inputs[taken.efforts], self._inputs[taken.of_values]
        self.wrench_map = WrenchMap(mechanism, taken)
        self.effort_map = EffortMap(self.model.coordinate_names, mechanism.effort_limits(), self.model.driven_names)
        self._clock, self._step = np.zeros(1, dtype=np.int64), np.array([self.step_size])
        self._estimate = np.zeros(1)
        arrays = (self._clock, self._step, self._y, self._inputs, self._estimate)
        # On the instance it comes before the method of this name, which it calls where something is wrong.
        vars(self)["step"] = self.model.kernel.stepper(self.step, [array.ctypes.data for array in arrays], arrays)
        self.y = _read_only(self._y)
        self.q = _read_only(self._y[self.model.q_range])
        self.u = _read_only(self._y[self.model.u_range])
        self.efforts = _read_only(self._efforts)
        self.inputs = _read_only(self._inputs)
        self.start_energy = 0.0
        self.reset()

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Simulation cannot be copied or pickled: build another one from its mechanism")

    @classmethod
    def from_file(
        cls,
        mechanism: str | Path,
        *,
        method: str | None = None,
        step: float | None = None,
        wrenches: Sequence[str] = (),
        live: Sequence[str] = (),
    ) -> Simulation:
        """Load a mechanism file, or a shipped mechanism by name, and compile it.

        :raises MechanismError: with all problems of the file.
        """
        return cls(load_mechanism(mechanism), method=method, step=step, wrenches=wrenches, live=live)

    @classmethod
    def from_text(
        cls,
        text: str,
        *,
        method: str | None = None,
        step: float | None = None,
        wrenches: Sequence[str] = (),
        live: Sequence[str] = (),
    ) -> Simulation:
        """The same from YAML text."""
        return cls(parse_mechanism(text), method=method, step=step, wrenches=wrenches, live=live)

    @property
    def steps(self) -> int:
        """Steps since time zero."""
        return int(self._clock[0])

    @property
    def time(self) -> float:
        """Simulated time in s: steps times step size, so that it cannot drift."""
        return self.steps * self.step_size

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each generalized speed and effort."""
        return self.model.coordinate_names

    @property
    def energies(self) -> Energies:
        """The energy audit at this moment, in J."""
        return self.model.energies(self.time, self._y, self.start_energy, self._inputs)

    @property
    def state(self) -> Array:
        """A copy of the integrated state: q, u, and the audit's energies."""
        return self._y.copy()

    def poses(self) -> Mapping[str, Pose]:
        """The pose of each part in ground's frame."""
        return self.model.poses(self.time, self._y, self._inputs)

    @property
    def violation(self) -> Violation:
        """How far the constraints are off at most, in position and velocity."""
        return self.model.violation(self.time, self._y, self._inputs)

    @property
    def error_estimate(self) -> float:
        """The largest estimated error of a step since time zero, as a part of 1 + |q| and 1 + |u| in SI units.

        One step of eight is looked at, the first included.
        """
        return float(self._estimate[0])

    @property
    def step_advice(self) -> str | None:
        """A sentence that names a better step or method where the step is too large for the mechanism, else None."""
        return step_advice(self.model, self.time, self._y, self._inputs, self.step_size, self.error_estimate)

    def multipliers(self) -> Mapping[str, Array]:
        """The multipliers of each loop and constraint, one a row: see `Model.multipliers`."""
        return self.model.multipliers(self.time, self._y, self._inputs)

    def drives(self) -> Mapping[str, Drive]:
        """The position, velocity and force (N or N·m) of each driven coordinate."""
        found = self.model.drives(self.time, self._y, self._inputs).T.tolist()
        return {name: Drive(*values) for name, values in zip(self.model.driven_names, found, strict=True)}

    def reactions(self) -> Mapping[str, Reaction]:
        """The force and the moment that go through each joint, at this moment."""
        return self.model.reactions(self.time, self._y, self._inputs)

    def inverse_dynamics(self, u_rates: Sequence[float] | Array) -> Array:
        """The efforts (nv,) in N and N·m that give the accelerations `u_rates` (nv,) in this state.

        :raises ValueError: the constraints do not allow them; see `mbd_sim.analysis.inverse_dynamics.InverseDynamics`.
        """
        return self._inverse(self.q, self.u, _checked(u_rates, self.u.size, "u_rates"), self.time)

    @cached_property
    def _inverse(self) -> InverseDynamics:
        from mbd_sim.analysis.inverse_dynamics import InverseDynamics

        return InverseDynamics(self.mechanism, equations=self.model.equations)

    def linearize(self) -> Linearization:
        """x' = A x + B e for small motions about this state and these efforts, by exact differentiation."""
        from mbd_sim.analysis.linearization import linearize

        return linearize(self.model.equations, self.q, self.u, self.efforts, self.time)

    def step(self, n: int = 1) -> None:
        """Advance by n steps.

        :raises DivergedError: the state would not stay finite; it stays as it was before this call.
        :raises TypeError, ValueError: n is not a whole number from 0 on.
        """
        n = index(n)
        if not 0 <= n <= LARGEST:
            raise ValueError(f"cannot take {n} steps")
        advance = self.model.kernel.estimating_advance
        addresses = self._y.ctypes.data, self._inputs.ctypes.data
        if not advance(*addresses, self.steps, self.step_size, n, self._estimate.ctypes.data):
            better = self.step_advice or f"Use a smaller step than {self.step_size:g} s."
            raise DivergedError(
                f"{self.mechanism.name}: the motion became infinite between t = {self.time:g} s and "
                f"{(self.steps + n) * self.step_size:g} s. {better[0].upper()}{better[1:]} Or check the "
                f"efforts, stiffnesses, start values and drives{self._loops_too()}."
            )
        self._clock[0] += n

    def advance(self, n: int) -> None:
        """Take n steps; where the motion becomes infinite, as many of them as can be taken.

        :raises DivergedError: the next step cannot be taken.
        """
        try:
            self.step(n)
        except DivergedError:
            if n == 1:
                raise
            self.advance(n // 2)
            self.advance(n - n // 2)

    def _loops_too(self) -> str:
        return ", and whether the loops can follow the motion" if self.model.equations.rows else ""

    def run(self, until: float, progress: Callable[[float], None] | None = None) -> None:
        """Advance to the step nearest to time `until` in s; `progress` hears the time now and then.

        :raises DivergedError: see `step`.
        """
        if not math.isfinite(until):
            raise ValueError(f"cannot run until t = {until} s")
        last = round(until / self.step_size)
        while self.steps < last:
            self.advance(min(last - self.steps, 20_000))
            if progress is not None:
                progress(self.time)

    def reset(self, q: Sequence[float] | Array | None = None, u: Sequence[float] | Array | None = None) -> None:
        """Back to time zero and the start state, or to the given one; efforts, wrenches and the audit are set to zero.

        Live values stay as they are. A given state is led to the nearest one that the constraints allow.

        :raises ValueError: wrong length, a value that is not finite, or loops that cannot be closed near this state;
            nothing is changed then.
        """
        y = self.model.start.copy()
        for values, where, symbol in ((q, self.model.q_range, "q"), (u, self.model.u_range, "u")):
            if values is not None:
                y[where] = _checked(values, where.stop - where.start, symbol)
        self.model.normalize(y)
        inputs = self.model.inputs.copy()
        inputs[self.model.equations.inputs.of_values] = self._values
        if q is not None or u is not None or not np.array_equal(inputs, self.model.inputs):
            y[self.model.q_range], y[self.model.u_range] = self.model.consistent(
                y[self.model.q_range], y[self.model.u_range], self._values
            )
        self._y[:], self._inputs[:], self._clock[0], self._estimate[0] = y, inputs, 0, 0.0
        self.start_energy = self.model.energies(0.0, self._y, 0.0, inputs).total

    def restore(
        self,
        state: Sequence[float] | Array,
        steps: int = 0,
        inputs: Sequence[float] | Array | None = None,
        start_energy: float | None = None,
        live: Mapping[str, float] | None = None,
    ) -> None:
        """Go on from where another run of the same equations was, bit for bit: nothing is projected or computed.

        :param state: all of `state`; `steps`, `inputs`, `start_energy` and `live` are those of that run. Inputs and
            energy that are not given stay as they are; `live` only names the values that `inputs` hold.
        :raises ValueError: wrong length, or a value that is not finite; nothing is changed then.
        """
        y = _checked(state, self._y.size, "the state")
        taken = self._inputs.copy() if inputs is None else _checked(inputs, self._inputs.size, "inputs")
        if index(steps) < 0:
            raise ValueError(f"a run has no {steps} steps")
        self._y[:], self._inputs[:], self._clock[0], self._estimate[0] = y, taken, index(steps), 0.0
        if start_energy is not None:
            self.start_energy = float(start_energy)
        if live is not None:
            self._live.current = {**self._live.current, **live}

    def set_efforts(self, efforts: Mapping[str, float] | Sequence[float] | Array) -> None:
        """Set the efforts (N or N·m) from the next step on: all in order, or some by name.

        They are clamped to the joints' effort limits; `efforts` shows what is applied.

        :raises CommandError: wrong length, an unknown name, or a value that is not finite; nothing is changed then.
        """
        self._efforts[:] = self.effort_map.clamped(self.effort_map.merged(self._efforts, efforts))

    def set_wrench(
        self,
        part: str,
        force: Sequence[float] | Array = (0.0, 0.0, 0.0),
        couple: Sequence[float] | Array = (0.0, 0.0, 0.0),
        *,
        at: str | Sequence[float] | Array | None = None,
        axes: str = "ground",
    ) -> None:
        """Let a force (N) and a couple (N·m) act on a part from the next step on, in place of those before.

        :param at: where the force acts: a point of the part by name, or (3,) in m in its frame; else its mass centre.
        :param axes: "ground", or "part" for axes that turn with it.
        :raises CommandError: the part is not among the `wrenches` of the simulation, an unknown point or axes, or
            what is not three finite numbers; nothing is changed then.
        """
        numbers = self.wrench_map.numbers(part, force, couple, at, axes)
        self._inputs[self.wrench_map.places[part]] = numbers

    @property
    def live(self) -> Mapping[str, float]:
        """The live values by key, in SI units."""
        return dict(self._live.current)

    def set_live(self, changes: Mapping[str, float]) -> None:
        """Change live values from the next step on. What this does to the energy is left out of the audit.

        :raises CommandError: an unknown key, a value that does not fit, or loops that it would open; nothing is
            changed then.
        """
        current, values = self._live.changed(changes)
        inputs = self._inputs.copy()
        inputs[self.model.equations.inputs.of_values] = values
        gap = self.model.violation(self.time, self._y, inputs).position
        if gap > max(OPENED, 10.0 * self.violation.position):
            raise CommandError(f"{', '.join(changes)}: this would open the loops by {gap:.3g}. Start anew with it.")
        before = self.energies.total
        self._inputs[:], self._live.current = inputs, current
        self.start_energy += self.energies.total - before


def _read_only(view: Array) -> Array:
    view = view[:]
    view.flags.writeable = False
    return view


def _checked(values: Sequence[float] | Array, size: int, symbol: str) -> Array:
    array = np.array(values, dtype=float)
    if array.shape != (size,):
        raise ValueError(f"{symbol} is a list of {size} values, not of shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{symbol} holds a value that is not finite")
    return array
