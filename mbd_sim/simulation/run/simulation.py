"""The simulation of one mechanism. It needs no ROS, no files other than the mechanism's, and no clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from threading import get_ident
from typing import TYPE_CHECKING, ClassVar, NoReturn, Self, TypeVar, Unpack

import numpy as np

from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.simulation.kernel.memory import AT_ONCE, BUSY, STEPPING
from mbd_sim.simulation.model.commands import Command, Efforts, by_name, require_parts
from mbd_sim.simulation.model.contact_pairs import require_computable_pairs
from mbd_sim.simulation.model.live_values import LiveValues, PreparedValues
from mbd_sim.simulation.model.model import Model, build_model
from mbd_sim.simulation.model.penetrations import require_free_start
from mbd_sim.simulation.run.arguments import (
    SimulationOptions,
    Value,
    changed_values,
    read_only,
    step_at,
    step_count,
    step_size,
)
from mbd_sim.simulation.run.changes import Coordinates, checked_steps, moved, started, with_live
from mbd_sim.simulation.run.events import ChangedValues, EventKind, RunListener, RunReports
from mbd_sim.simulation.run.inputs import EffortWriter, RunInputs
from mbd_sim.simulation.run.present_state import PresentState
from mbd_sim.simulation.run.run_point import RunLayout, RunPoint, require_same_layout

if TYPE_CHECKING:
    from mbd_sim.simulation.contact.records import ContactObserver

Kind = TypeVar("Kind", bound="BaseSimulation")
_RESET = "Call reset(q=…, u=…) to start from given coordinates and speeds."
_RESTORE = "Call reset() to return to time zero, or restore(…) to continue from a snapshot."
_BUILD = "Build a new Simulation with it."


class BaseSimulation(PresentState):
    """A mechanism and its state, advanced by a fixed step.

    `q` (nq,) are the generalized coordinates and `u` (nv,) the generalized speeds in the order of the file's joints,
    in m, rad, m/s and rad/s. A free joint has a position and a unit quaternion (w, x, y, z) in q; in u it has the
    velocity in the parent's axes and the angular velocity in the child's. `y` is the integrated state: q, u, the states
    of actuators, and the energies of the audit. `q`, `u`, `y`, `efforts` and `inputs` are read-only views of the
    kernel's own memory and follow the motion; copy what you want to keep. A simulation must not be used by several
    threads at once: while one takes steps, steps and changes of others raise a `CommandError`.

    >>> sim = Simulation.from_file("double_rod")
    >>> sim.run(until=3.0)
    >>> abs(sim.energies.residual) < 1e-11
    True
    """

    REMEDIES: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("q", "u"), _RESET),
        **dict.fromkeys(("y", "state", "steps", "time", "t"), _RESTORE),
        **dict.fromkeys(("step_size", "mechanism", "model"), _BUILD),
        "efforts": "Call set_efforts(…).",
        "inputs": "Call set_efforts(…), set_commands(…), set_wrench(…) or set_live(…).",
        "live": "Call set_live(…).",
    }

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        method: str | None = None,
        step: float | None = None,
        wrenches: Sequence[str] = (),
        live: Sequence[str] = (),
        set: Mapping[str, Value] | None = None,
        parameters: Mapping[str, Value] | None = None,
    ) -> None:
        """Compile a mechanism; `method` and `step` (s) replace those of its file.

        :param wrenches: parts on which external forces can act, see `set_wrench`.
        :param live: values of the file that can change during a run, see `set_live`: keys such as `gravity[2]`,
            `parameters.l`, `joints.elbow.damping`, or patterns such as `joints.*.damping`. A single name may be given
            by itself, here and in `wrenches`.
        :param set: values of the file to replace, by key: `{"l": 0.8, "joints.elbow.position": "30 deg"}`, numbers in
            SI units or values as in the file; a parameter may be given by its name alone.
        :param parameters: parameters of the file to replace, by name: `{"l": 0.8}`.
        :raises MechanismError: the method, a live value, a parameter or a key in `set` does not exist, a value does not
            fit there, or the equations are singular at the start.
        :raises ValueError: the step is not a positive number, or a parameter is given twice.
        :raises CommandError: a part in `wrenches` does not exist.
        """
        require_mechanism(mechanism)
        changes = changed_values(mechanism, set or {}, parameters or {})
        mechanism = with_values(mechanism, changes) if changes else mechanism
        step = step_size(step, mechanism.step)
        wrenches, live = ([names] if isinstance(names, str) else names for names in (wrenches, live))
        require_parts(wrenches, mechanism)
        values = LiveValues(mechanism, live)
        model = build_model(mechanism, method, wrenches, values.parameters, step)
        if mechanism.contacts:
            require_computable_pairs(model)
        if model.one_sided is not None:
            require_free_start(model)
        self._begin(mechanism, model, values, step)

    def _begin(self, mechanism: Mechanism, model: Model, live: LiveValues, step: float) -> None:
        """Allocate the memory, and start in the start state."""
        super()._begin(mechanism, model, live, step)
        self._reports = RunReports(self._memory)
        inputs = self._inputs = RunInputs(model, mechanism, self._memory, self.effort_map, self._reports)
        self.wrench_map, self.command_map = inputs.wrench_map, inputs.command_map
        self.efforts = read_only(inputs.efforts)
        self._use_compiled_step()
        self.reset()
        self._seal()

    def __repr__(self) -> str:
        step = f"method {self.model.method_name}, step {self.step_size:g} s"
        return f"<{type(self).__name__} {self.mechanism.name} at t = {self.time:g} s: {step}>"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Simulation cannot be pickled. Pickle its snapshot(), and restore that in a new one.")

    def copy(self) -> BaseSimulation:
        """Another simulation in the same state, which goes on by itself; both share the compiled equations."""
        return self._copied_to(BaseSimulation.__new__(BaseSimulation))

    def _copied_to(self, copied: Kind) -> Kind:
        copied._begin(self.mechanism, self.model, self._live.copy(), self.step_size)
        copied.restore(self.snapshot())
        return copied

    def __copy__(self) -> BaseSimulation:
        return self.copy()

    def __deepcopy__(self, memo: object) -> BaseSimulation:
        return self.copy()

    @classmethod
    def from_file(cls, mechanism: str | Path, **options: Unpack[SimulationOptions]) -> Self:
        """Load a mechanism file or, by name, a shipped mechanism; `options` are the keyword arguments of `Simulation`.

        :raises MechanismError: with all problems of the file.
        """
        return cls(load_mechanism(mechanism), **options)

    @classmethod
    def from_text(cls, text: str, **options: Unpack[SimulationOptions]) -> Self:
        """Load and build a mechanism from YAML text."""
        return cls(parse_mechanism(text), **options)

    def step(self, n: int = 1) -> None:
        """Advance by n steps.

        This is compiled code, at 0.05 µs a call. A subclass may override it; then `super().step(n)` costs 1 µs. A
        mechanism with sensors costs that too, and a few µs more whenever one measures.

        :raises DivergedError: the state would become infinite; it stays as it was before this call, at the last
            measurement of a sensor, or after the last multiple of 20,000 steps of this call. Ctrl-C acts there as well.
        :raises CommandError: a call of it is under way already, in another thread or as the caller of an observer.
        :raises TypeError, ValueError: n is not an integer, or negative.
        """
        n, memory = step_count(n), self._memory
        marks = memory.marks
        # Between the look and the mark there is no call, where CPython would switch threads or handle Ctrl-C.
        if marks[0] & BUSY:
            raise memory.disturbed()
        marks[0] |= STEPPING
        try:
            memory.owner = get_ident()
            for part in self._sensors.divided(self._reports.parts_of(n)):
                if not memory.advance(part):
                    raise self._divergence(part)
                self._reports.report_contacts()
        finally:
            marks[0] &= ~STEPPING

    def _divergence(self, steps: int) -> DivergedError:
        from mbd_sim.simulation.run.advice import divergence
        from mbd_sim.simulation.run.undefined_expressions import undefined_expression

        undefined = undefined_expression(self.model, self._live.mechanism, self._memory, steps)
        closed = [name for name, contact in self.contacts().items() if contact.normal > 0.0]
        speeds = self.model.drives(self.time, self.y, self.inputs)[1].tolist() if closed else ()
        moving = [name for name, speed in zip(self.model.driven_names, speeds, strict=False) if speed]
        advice = self.step_advice
        return divergence(self.model, self.time, steps, self.step_size, advice, undefined, closed, moving)

    def advance(self, n: int) -> None:
        """Take n steps; if the state becomes infinite, take as many of them as possible.

        :raises DivergedError: the next step cannot be taken.
        """
        try:
            self.step(n)
        except DivergedError:
            if n == 1:
                raise
            self.advance(n // 2)
            self.advance(n - n // 2)

    def run(self, until: float, progress: Callable[[float], None] | None = None) -> None:
        """Advance to the step nearest to time `until` in s; `progress` is called with the time every 20,000 steps.

        :raises DivergedError: see `advance`.
        :raises ValueError: the time is not finite, or is in the past.
        """
        last = step_at(until, self.step_size, self.steps)
        while self.steps < last:
            self.advance(min(last - self.steps, AT_ONCE))
            if progress is not None:
                progress(self.time)

    def listen(self, listener: RunListener | None) -> None:
        """Report steps and commands to a listener from here on; None: to nobody.

        :raises InputError: there is another listener already.
        """
        self._reports.listen(listener)
        if listener is None:
            self._use_compiled_step()
        else:
            vars(self).pop("step", None)  # the method divides the steps, which compiled code does not

    def _use_compiled_step(self) -> None:
        # A subclass with its own `step` keeps it.
        if type(self).step is BaseSimulation.step and self.sensor_model is None and not self.model.steps_in_python:
            vars(self).pop("step", None)
            vars(self)["step"] = self._memory.compiled_step(self.step)  # calls the method of this name if a step fails

    def reset(
        self, q: Coordinates | None = None, u: Coordinates | None = None, *, nearest_speeds: bool = False
    ) -> None:
        """Return to time zero and to the start state or the given one; zero the efforts, the wrenches and the audit.

        Commands of actuators become those before the first one. Live values stay as they are.

        >>> from mbd_sim import Simulation
        >>> sim = Simulation.from_file("double_rod")
        >>> sim.reset(q={"elbow": 0.3}, u={"shoulder": -1.0})

        :param q: coordinates (nq,), of which the state is the nearest one that satisfies the constraints; or some
            by the names of coordinates, in m and rad: these stay as they are given, and those of the start follow as
            far as closed loops require.
        :param u: speeds (nv,) that satisfy the constraints, but for their digits; or some by the names of coordinates,
            which the others follow.
        :param nearest_speeds: take the speeds nearest to `u` that satisfy the constraints, however far away.
        :raises ValueError: wrong length, a value that is not finite, loops that cannot be closed near this state, or
            parts inside each other or beyond a stop; nothing is changed then.
        :raises CommandError: an unknown or driven coordinate, a value by name that is not finite, loops that cannot
            be closed with these values, or speeds that violate the constraints; nothing is changed then.
        """
        memory = self._memory
        memory.require_rest()
        y, inputs = started(self.model, self._inputs.values, q, u, nearest_speeds)
        memory.restore(y, inputs, 0)
        self.start_energy = self.model.energies(0.0, y, 0.0, inputs).total
        if memory.stepper is not None:
            memory.stepper.events.clear()
        memory.find_modes()
        self._sensors.restart()
        self._report_state(EventKind.RESET, q is not None or u is not None)

    def snapshot(self) -> RunPoint:
        """Everything that the rest of the run depends on, for `restore`.

        These are the time, the state with that of actuators and contacts, efforts, commands and those that are delayed,
        wrenches, live values, the audit, and the samples of sensors. It is plain data, which can be pickled.
        """
        self._memory.require_rest()
        memory, y, inputs = self._memory, self.state, self._memory.inputs.copy()
        run = memory.steps, y, inputs, self.start_energy, self.live, self.samples, self.history
        return RunPoint(*run, memory.error_estimate, self._run_layout)

    @property
    def _run_layout(self) -> RunLayout:
        loaded = self.model.input_layout.loaded
        names = self.mechanism.name, self.coordinate_names, loaded, tuple(self._live.current)
        return RunLayout(*names, self.step_size)

    def restore(
        self,
        state: RunPoint | Sequence[float] | Array,
        steps: int | None = None,
        inputs: Sequence[float] | Array | None = None,
        start_energy: float | None = None,
        live: Mapping[str, float] | None = None,
        samples: Array | None = None,
        history: Array | None = None,
    ) -> None:
        """Continue from a snapshot or a state of a run of the same equations, bit for bit: nothing is projected.

        :param state: a `snapshot()`, which is restored as a whole and alone; or all of that run's `state`.
        :param steps: the `steps` of that run, required with a state alone: they are its time. `inputs`, `start_energy`
            and `live` are of that run too, and stay as they are if they are not given; `live` only names the values
            in `inputs`. Without `inputs`, the state of contacts is determined from the positions and speeds. `samples`
            are that run's, too; without them, measurements under way are lost unless the time goes on. Nor do runs
            with methods `adams11` and `taylor` go on bit for bit without the `history` of that run.
        :raises ValueError: a snapshot of a different run, no `steps` with a state, wrong length, or a value that is
            not finite; nothing is changed then.
        :raises TypeError: other arguments are given with a snapshot.
        """
        if isinstance(state, RunPoint):
            if any(value is not None for value in (steps, inputs, start_energy, live, samples, history)):
                raise TypeError("a snapshot is restored as a whole. Give no other argument, or give snapshot.state.")
            require_same_layout(state.layout, self._run_layout)
            self._continue_from(state, state.samples)
            return
        y, own = finite_vector(state, self.y.size, "the state"), self._memory.inputs
        given, count = own if inputs is None else self.model.input_layout.checked(inputs), checked_steps(steps)
        energy, goes_on = self.start_energy if start_energy is None else float(start_energy), count == self.steps
        point = RunPoint(count, y, given, energy, live or {}, history=np.empty(0) if history is None else history)
        self._continue_from(point, samples, keep_samples=goes_on, find_modes=inputs is None)

    def _continue_from(
        self, point: RunPoint, samples: Array | None, *, keep_samples: bool = False, find_modes: bool = False
    ) -> None:
        self._memory.require_rest()
        self._memory.restore(point.state, point.inputs, point.steps, point.error_estimate, point.history)
        if find_modes:
            self._memory.find_modes()
        self.start_energy = point.start_energy
        self._live.restore(point.live)
        self._live.limit(self.effort_map)
        self._sensors.restart(samples, keep=keep_samples)
        self._report_state()

    def set_state(
        self, positions: Mapping[str, float] | None = None, velocities: Mapping[str, float] | None = None
    ) -> None:
        """Set positions (m, rad) and velocities (m/s, rad/s) by the names of coordinates; the time goes on.

        Coordinates that are not named keep their values, except as far as closed loops require others. Efforts and
        wrenches stay. The audit does not include the resulting change of energy.

        :raises CommandError: an unknown or driven coordinate, a value that is no finite number, loops that cannot be
            closed with these values, or parts inside each other or beyond a stop; nothing is changed then.
        """
        self._memory.require_rest()
        before = self.energies.total
        given = ({} if each is None else by_name(each, "positions and velocities") for each in (positions, velocities))
        y = moved(self.model, self._memory, *given)
        after = self.model.energies(self.time, y, 0.0, self._memory.inputs).total
        self.restore(y, self.steps, start_energy=self.start_energy + after - before)

    def _report_state(self, kind: EventKind = EventKind.NEW_STATE, with_state: bool = True) -> None:
        if self._reports.listener is not None:
            self._reports.report(kind, self.snapshot() if with_state else None)

    def set_efforts(self, efforts: Efforts) -> None:
        """Set the efforts (N or N·m) from the next step on, all in order or some by name, clamped to the effort limits.

        :raises CommandError: wrong length, an unknown name, or a value that is not finite; nothing is changed then.
        """
        self._write_efforts(efforts)

    def expire_efforts(self, names: Sequence[str]) -> None:
        """Set some efforts to zero from the next step on; reported as commands that have expired.

        :raises CommandError: an unknown name; nothing is changed then.
        """
        self._inputs.expire_efforts(names)

    @cached_property
    def _write_efforts(self) -> EffortWriter:
        """Compiled code, which from its first call on also replaces the method that is called on the simulation."""
        if type(self).set_efforts is BaseSimulation.set_efforts:  # a subclass with its own `set_efforts` keeps it
            vars(self)["set_efforts"] = self._inputs.effort_writer(self.set_efforts, "set_efforts(efforts)")
        return self._inputs.effort_writer(self._inputs.set_efforts, "write(efforts)")

    def set_wrench(
        self,
        part: str,
        force: Sequence[float] | Array = (0.0, 0.0, 0.0),
        couple: Sequence[float] | Array = (0.0, 0.0, 0.0),
        *,
        at: str | Sequence[float] | Array | None = None,
        axes: str = "ground",
    ) -> None:
        """Apply a force (N) and a couple (N·m) to a part from the next step on; they replace the previous ones.

        :param at: where the force acts: the name of a point of the part, or (3,) in m in its frame; by default the
            center of mass.
        :param axes: of both vectors: "ground", or "part" for axes that turn with the part.
        :raises CommandError: the part is not among the `wrenches` of the simulation, a point or axes that do not
            exist, or a vector that is not three finite numbers; nothing is changed then.
        """
        self._inputs.set_wrench(part, self.wrench_map.numbers(part, force, couple, at, axes))

    def expire_wrench(self, part: str) -> None:
        """Set the wrench on a part to zero from the next step on; reported as a command that has expired."""
        zero = self.wrench_map.numbers(part, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), None, "ground")
        self._inputs.set_wrench(part, zero, EventKind.EXPIRED)

    def set_commands(self, commands: Mapping[str, Command]) -> None:
        """Command actuators by name from the next step on; the others keep their commands.

        A number acts on the first channel of an actuator: the position or velocity of a servo, or what commands its
        motor. `{"drive": {"position": 1.0, "velocity": 0.5}}` names channels. Units: rad or m, rad/s or m/s, N·m or N,
        V, A. Limits are kept by the actuators themselves.

        >>> sim.set_commands({"drive": 24.0, "lift": {"position": 0.1}})  # doctest: +SKIP

        :raises CommandError: an unknown actuator or channel, or a value that is not finite; nothing is changed then.
        """
        self.apply_command_values(self.command_map.merged(self._inputs.commands, commands))

    def apply_command_values(self, values: Array) -> None:
        """Command all channels (n,) in the order of `command_map.names`, with finite numbers, from the next step on."""
        self._inputs.set_commands(values)

    def set_live(self, changes: Mapping[str, float | str], *, reassemble: bool = False) -> None:
        """Change live values from the next step on. The energy audit does not include the resulting change of energy.

        Live values that have not been given themselves follow the others, as their formulas in the file say.

        :param changes: numbers in SI units, or texts with units such as `"30 deg"`, by their keys.
        :param reassemble: where a change would open loops, assemble the mechanism anew from where it is: the nearest
            configuration, with the speeds of least kinetic energy of their change.
        :raises CommandError: an unknown key, a value that does not fit, one that would open loops, with `reassemble`
            one with which they cannot be closed from here, or one that would put parts inside each other or beyond a
            stop; nothing is changed then.
        """
        self.apply_live(self.prepare_live(changes, reassemble=reassemble))

    def prepare_live(self, changes: Mapping[str, float | str], *, reassemble: bool = False) -> PreparedValues:
        """The first, slow half of `set_live`: validate changes. It changes nothing and may run in any thread.

        :raises CommandError: an unknown key, or a value that does not fit.
        """
        prepared = self._live.prepare(changes)
        if reassemble and self.model.row_names:
            _ = self.model.equations  # derived here, if the model is from the cache
        return replace(prepared, reassemble=reassemble)

    def apply_live(self, prepared: PreparedValues) -> None:
        """The second, fast half of `set_live`; no other change may have been applied since `prepare_live`.

        Efforts beyond changed limits are clamped.

        :raises CommandError: in the present state the change would open loops, or put parts inside each other or beyond
            a stop; nothing is changed then.
        """
        self._memory.require_rest()
        y, inputs, told = with_live(self.model, self._memory, self.live, prepared)
        before = self.energies.total
        self.model.keep_accounts(self.time, self.y, y, self._memory.inputs, inputs)
        self._memory.inputs[:], self._memory.y[:] = inputs, y
        self._live.apply(prepared)
        self.start_energy += self.energies.total - before
        self._memory.find_modes()
        if told:
            self._sensors.restart(keep=True)
        self._reports.report(EventKind.LIVE_VALUES, ChangedValues(prepared.changes, self.live))
        if told:
            self._reports.report(EventKind.NOTE, told)
        self._live.limit(self.effort_map)
        self.set_efforts(self._inputs.efforts.copy())

    def observe_contacts(self, observer: ContactObserver | None) -> None:
        """Let an observer see each impact and each event of contacts as it is found; None ends that.

        :raises ValueError: the mechanism has no one-sided elements, or the observer lacks a method.
        """
        if self._memory.stepper is None:
            raise ValueError(f"mechanism '{self.mechanism.name}' has no one-sided elements to observe")
        self._memory.require_rest()
        self._memory.stepper.observer = observer
