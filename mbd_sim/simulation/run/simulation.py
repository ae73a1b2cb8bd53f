"""The simulation of one mechanism. It needs no ROS, no files other than the mechanism's, and no clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NoReturn, Self, TypeVar, Unpack

import numpy as np

from mbd_sim.base.collection_pause import paused_collection
from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.commands import Command, Efforts
from mbd_sim.simulation.model.contact_pairs import require_computable_pairs
from mbd_sim.simulation.model.live_values import LiveValues, PreparedValues, require_closed
from mbd_sim.simulation.model.model import Model, build_model
from mbd_sim.simulation.model.state_records import DriveState, Energies, Losses, Reaction, Violation
from mbd_sim.simulation.model.wrenches import require_parts
from mbd_sim.simulation.run.arguments import (
    ReadOnlyAttributes,
    SimulationOptions,
    Value,
    changed_values,
    read_only,
    step_at,
    step_count,
    step_size,
)
from mbd_sim.simulation.run.changes import Coordinates, checked_steps, moved, require_free_start, started
from mbd_sim.simulation.run.dynamics_readings import DynamicsReadings, Momentum
from mbd_sim.simulation.run.events import ChangedValues, EventKind
from mbd_sim.simulation.run.inputs import EffortWriter, RunInputs, RunListener, RunReports
from mbd_sim.simulation.run.moving_points import MovingFrame, MovingPoint, motion_of
from mbd_sim.simulation.run.readings import CompiledReadings, RunSensors
from mbd_sim.simulation.run.state import RunLayout, RunPoint, require_same_layout

if TYPE_CHECKING:
    from mbd_sim.analysis.linear.linearization import Linearization
    from mbd_sim.analysis.linear.state_space import StateSpace
    from mbd_sim.simulation.contact.records import ContactEvent, ContactObserver, ContactState
    from mbd_sim.simulation.kernel.sensors import Arrival, SensorReading
    from mbd_sim.simulation.model.actuator_states import AnyActuatorState
    from mbd_sim.simulation.model.state_records import PartMotion
    from mbd_sim.simulation.run.moving_points import MovingFrame, MovingPoint

Kind = TypeVar("Kind", bound="Simulation")
RUN_CHUNK = 20_000  # steps between two calls of `progress` in `run`
_RESET = "Call reset(q=…, u=…) to start from given coordinates and speeds."
_RESTORE = "Call reset() to return to time zero, or restore(…) to continue from a snapshot."
_BUILD = "Build a new Simulation with it."


class Simulation(ReadOnlyAttributes):
    """A mechanism and its state, advanced by a fixed step.

    `q` (nq,) are the generalized coordinates and `u` (nv,) the generalized speeds in the order of the file's joints,
    in m, rad, m/s and rad/s. A free joint has a position and a unit quaternion (w, x, y, z) in q; in u it has the
    velocity in the parent's axes and the angular velocity in the child's. `y` is the integrated state: q, u, and the
    energies of the audit. `q`, `u`, `y`, `efforts` and `inputs` are read-only views of the kernel's own memory and
    follow the motion; copy what you want to keep. A simulation must not be used by several threads at once.

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
        self.mechanism, self.model, self.step_size, self._live = mechanism, model, step, live
        memory = self._memory = KernelMemory(model, step)
        self._reports = RunReports(memory)
        self._inputs = RunInputs(model, mechanism, memory, self._reports)
        self._compiled = CompiledReadings(model, memory)
        self._dynamics = DynamicsReadings(model, memory, self._inputs.effort_map)
        self._sensors = RunSensors(model, mechanism, step, memory)
        self.sensor_model, self.start_energy = self._sensors.model, 0.0
        inputs = self._inputs
        self.wrench_map, self.command_map, self.effort_map = inputs.wrench_map, inputs.command_map, inputs.effort_map
        self.y, self.inputs, self.efforts = (read_only(one) for one in (memory.y, memory.inputs, inputs.efforts))
        self.q, self.u = read_only(memory.y[model.q_range]), read_only(memory.y[model.u_range])
        self._use_compiled_step()
        self.reset()
        self._seal()

    def __repr__(self) -> str:
        step = f"method {self.model.method_name}, step {self.step_size:g} s"
        return f"<{type(self).__name__} {self.mechanism.name} at t = {self.time:g} s: {step}>"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Simulation cannot be pickled. Pickle its snapshot(), and restore that in a new one.")

    def copy(self) -> Simulation:
        """Another simulation in the same state, which goes on by itself; both share the compiled equations."""
        return self._copied_to(Simulation.__new__(Simulation))

    def _copied_to(self, copied: Kind) -> Kind:
        copied._begin(self.mechanism, self.model, self._live.copy(), self.step_size)
        copied.restore(self.snapshot())
        return copied

    def __copy__(self) -> Simulation:
        return self.copy()

    def __deepcopy__(self, memo: object) -> Simulation:
        return self.copy()

    @classmethod
    def from_file(cls, mechanism: str | Path, **options: Unpack[SimulationOptions]) -> Self:
        """Load a mechanism file or, by name, a shipped mechanism; `options` are the keyword arguments of `Simulation`.

        :raises MechanismError: with all problems of the file.
        """
        with paused_collection():
            return cls(load_mechanism(mechanism), **options)

    @classmethod
    def from_text(cls, text: str, **options: Unpack[SimulationOptions]) -> Self:
        """Load and build a mechanism from YAML text."""
        with paused_collection():
            return cls(parse_mechanism(text), **options)

    @property
    def steps(self) -> int:
        """Steps since time zero."""
        return self._memory.steps

    @property
    def time(self) -> float:
        """Simulated time in s: the number of steps times the step size, so that it cannot drift."""
        return self._memory.time

    @property
    def history(self) -> Array:
        """A copy of what the method keeps of earlier steps; empty for most methods."""
        return self._memory.history.copy()

    @property
    def state(self) -> Array:
        """A copy of the integrated state: q, u, and the energies of the audit."""
        return self._memory.y.copy()

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each generalized speed and effort."""
        return self.model.coordinate_names

    def step(self, n: int = 1) -> None:
        """Advance by n steps.

        This is compiled code, at 0.05 µs a call. A subclass may override it; then `super().step(n)` costs 1 µs. So it
        does with sensors, and some µs more whenever one measures.

        :raises DivergedError: the state would become infinite; it stays as it was before this call, or at the last
            measurement of a sensor.
        :raises TypeError, ValueError: n is not an integer, or negative.
        """
        n = step_count(n)
        for part in self._sensors.divided(self._reports.parts_of(n)):
            if not self._memory.advance(part):
                from mbd_sim.simulation.run.advice import divergence
                from mbd_sim.simulation.run.undefined_expressions import undefined_expression

                undefined = undefined_expression(self.model, self._live.mechanism, self._memory, part)
                raise divergence(self.model, self.time, part, self.step_size, self.step_advice, undefined)
            self._reports.contacts()

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
            self.advance(min(last - self.steps, RUN_CHUNK))
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
        if type(self).step is Simulation.step and self.sensor_model is None:  # a subclass with its own `step` keeps it
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
        y, inputs = started(self.model, self._inputs.values, q, u, nearest_speeds)
        memory = self._memory
        memory.load(y, inputs, 0)
        self.start_energy = self.model.energies(0.0, y, 0.0, inputs).total
        if memory.contacts is not None:
            memory.contacts.events.clear()
        memory.settle()
        self._sensors.restart()
        self._report_state(EventKind.RESET, q is not None or u is not None)

    def snapshot(self) -> RunPoint:
        """Everything that the rest of the run depends on, for `restore`.

        These are the time, the state with that of actuators and contacts, efforts, commands and those that are delayed,
        wrenches, live values, the audit, and the samples of sensors. It is plain data, which can be pickled.
        """
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
            if any(value is not None for value in (steps, inputs, start_energy, live, samples)):
                raise TypeError("a snapshot is restored as a whole. Give no other argument, or give snapshot.state.")
            require_same_layout(state.layout, self._run_layout)
            self._continue_from(state, state.samples)
            return
        y, own = finite_vector(state, self.y.size, "the state"), self._memory.inputs
        given, count = own if inputs is None else finite_vector(inputs, own.size, "inputs"), checked_steps(steps)
        energy, goes_on = self.start_energy if start_energy is None else float(start_energy), count == self.steps
        point = RunPoint(count, y, given, energy, live or {}, history=np.empty(0) if history is None else history)
        self._continue_from(point, samples, keep_samples=goes_on, settle=inputs is None)

    def _continue_from(
        self, point: RunPoint, samples: Array | None, *, keep_samples: bool = False, settle: bool = False
    ) -> None:
        self._memory.load(point.state, point.inputs, point.steps, point.error_estimate, point.history)
        if settle:
            self._memory.settle()
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

        :raises CommandError: an unknown or driven coordinate, a value that is not finite, loops that cannot be closed
            with these values, or parts inside each other or beyond a stop; nothing is changed then.
        """
        before = self.energies.total
        y = moved(self.model, self._memory, positions or {}, velocities or {})
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
        if type(self).set_efforts is Simulation.set_efforts:  # a subclass with its own `set_efforts` keeps it
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

    @property
    def live(self) -> Mapping[str, float]:
        """The live values by key, in SI units."""
        return dict(self._live.current)

    def set_live(self, changes: Mapping[str, float | str]) -> None:
        """Change live values from the next step on. The energy audit does not include the resulting change of energy.

        Live values that have not been given themselves follow the others, as their formulas in the file say.

        :param changes: numbers in SI units, or texts with units such as `"30 deg"`, by their keys.

        :raises CommandError: an unknown key, a value that does not fit, or one that would open loops; nothing is
            changed then.
        """
        self.apply_live(self.prepare_live(changes))

    def prepare_live(self, changes: Mapping[str, float | str]) -> PreparedValues:
        """The first, slow half of `set_live`: validate changes. It changes nothing and may run in any thread.

        :raises CommandError: an unknown key, or a value that does not fit.
        """
        return self._live.prepare(changes)

    def apply_live(self, prepared: PreparedValues) -> None:
        """The second, fast half of `set_live`; no other change may have been applied since `prepare_live`.

        Efforts beyond changed limits are clamped.

        :raises CommandError: the change would open loops in the present state; nothing is changed then.
        """
        inputs, y = self._memory.inputs.copy(), self.y.copy()
        inputs[self.model.input_layout.values] = prepared.inputs
        gap = self.model.violation(self.time, self.y, inputs).position
        require_closed(prepared.changes, gap, self.violation.position)
        before = self.energies.total
        self.model.keep_accounts(self.time, self.y, y, self._memory.inputs, inputs)
        self._memory.inputs[:], self._memory.y[:] = inputs, y
        self._live.apply(prepared)
        self.start_energy += self.energies.total - before
        self._memory.settle()
        self._reports.report(EventKind.LIVE_VALUES, ChangedValues(prepared.changes, self.live))
        self._live.limit(self.effort_map)
        self.set_efforts(self._inputs.efforts.copy())

    @property
    def energies(self) -> Energies:
        """The energy audit, in J."""
        memory = self._memory
        return self.model.audit(memory.read("energies", 2), self.time, memory.y, self.start_energy, memory.inputs)

    def poses(self) -> Mapping[str, Pose]:
        """The pose of each part in ground's frame."""
        return self._compiled.poses()

    @property
    def u_rates(self) -> Array:
        """The accelerations u' (nv,) of the coordinates, in m/s² and rad/s², under all present forces.

        Those of contacts are included. At an impact they are those after it.
        """
        return self._memory.accelerations()

    def motion(self, frame: str) -> PartMotion:
        """The motion of a part, or of one of its points: pose, velocities and accelerations in ground's axes.

        >>> from mbd_sim import Simulation
        >>> sim = Simulation.from_file("double_rod")
        >>> sim.motion("lower").acceleration.shape
        (3,)

        :param frame: `part` or `part.point`; the place of a point in its part follows live values.
        :raises InputError: there is no such part or point.
        """
        return motion_of(self.model, self._live.mechanism, frame, *self._memory.now)

    @property
    def violation(self) -> Violation:
        """The largest violation of the constraints, in position and velocity."""
        return self.model.violation(*self._memory.now)

    @property
    def error_estimate(self) -> float:
        """The largest estimated error of every eighth step since time zero, relative to s + |q| and s + |u|."""
        return self._memory.error_estimate

    @property
    def step_advice(self) -> str | None:
        """A sentence that names a better step or method if the step is too large for the mechanism, else None.

        Too large are steps with large errors, such as leave the energy account open, and such as may miss a contact.
        """
        from mbd_sim.simulation.run.advice import advice_on_energy, advice_on_step

        return (
            advice_on_step(self.model, *self._memory.now, self.step_size, self.error_estimate)
            or advice_on_energy(self.model, self.energies, self.start_energy, self.step_size)
            or self.passing_advice
        )

    @property
    def passing_advice(self) -> str | None:
        """A sentence on contacts that a step may miss, as parts turn too far or fly too fast in it, else None."""
        from mbd_sim.simulation.run.remarks import passing_advice

        return " ".join(passing_advice(self.model, *self._memory.now, self.step_size)) or None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know: why the method was chosen, limits that do not act, drives that jump.

        Jumps of drives are sought in the time of the run, and before its first step in the first 10 s.
        """
        from mbd_sim.simulation.run.remarks import LOOK_AHEAD, remarks

        return remarks(self.model, *self._memory.now, self.step_size, self.time or LOOK_AHEAD)

    def multipliers(self) -> Mapping[str, Array]:
        """The Lagrange multipliers of each loop and constraint, one for each equation: see `Model.multipliers`."""
        if (compiled := self._compiled.multipliers) is None:
            return self.model.multipliers(*self._memory.now)
        values = compiled()
        return {name: values[rows] for name, rows in self.model.rows_of.items()}

    def drives(self) -> Mapping[str, DriveState]:
        """The position, velocity and force (N or N·m) of each driven coordinate."""
        columns = self.model.drives(*self._memory.now).T.tolist()
        return {name: DriveState(*values) for name, values in zip(self.model.driven_names, columns, strict=True)}

    def actuators(self) -> Mapping[str, AnyActuatorState]:
        """Each actuator by name: commands, effort, voltage and current or pressures, powers, losses, energies."""
        time, y, inputs = self._memory.now
        return self.model.actuators(time, y, self.model.with_contact_forces(time, y, inputs))

    def reactions(self) -> Mapping[str, Reaction]:
        """The force and the moment that each joint transmits."""
        if (compiled := self._compiled.reactions) is None:
            return self.model.reactions(*self._memory.now)
        return compiled()

    def contacts(self) -> Mapping[str, ContactState]:
        """Each one-sided element and each compliant contact by name: its gap, normal force, friction and state.

        Elements with several gaps, such as the two ends of a joint's limits, have an entry for each.
        """
        return self.model.contacts(*self._memory.now)

    @property
    def contact_events(self) -> tuple[ContactEvent, ...]:
        """The latest changes of contacts since the start, at most 10,000 of them."""
        stepper = self._memory.contacts
        return () if stepper is None else tuple(stepper.events)

    @property
    def contact_event_count(self) -> int:
        """The number of changes of contacts since the simulation was built."""
        return self._memory.contact_count

    def observe_contacts(self, observer: ContactObserver | None) -> None:
        """Let an observer see each impact and each event of contacts as it is found; None ends that.

        :raises ValueError: the mechanism has no one-sided elements.
        """
        if self._memory.contacts is None:
            raise ValueError(f"mechanism '{self.mechanism.name}' has no one-sided elements to observe")
        self._memory.contacts.observer = observer

    @property
    def losses(self) -> Losses:
        """The energies in J that impacts and dry friction of one-sided elements have dissipated."""
        return self.model.losses(self._memory.y)

    def sensors(self) -> Mapping[str, SensorReading]:
        """The last measurement of each sensor that has arrived, by name; sensors without any yet are left out.

        A sensor measures at time zero and then at its rate, with the inputs that have acted up to that moment. The same
        run gives the same noise, also after a reset, a restored snapshot, or in another process.
        """
        return self._sensors.readings()

    @property
    def arrivals(self) -> list[Arrival]:
        """The measurements that arrive at the present step."""
        return self._sensors.arrivals()

    def steps_to_arrival(self, at_most: int) -> int:
        """The number of steps to the next measurement that may arrive, or fewer."""
        return self._sensors.steps_to_arrival(at_most)

    @property
    def samples(self) -> Array:
        """The sampled states that the present and later measurements depend on: see `SensorSamples.table`."""
        return self._sensors.table()

    def point(self, name: str) -> MovingPoint:
        """A point `part.point`, or the origin of a part: position, velocity, acceleration, Jacobian and its rate.

        >>> from mbd_sim import Simulation
        >>> sim = Simulation.from_file("double_rod")
        >>> sim.point("lower").jacobian.shape
        (3, 2)

        The object follows the motion; keep it where speed matters.

        :raises InputError: there is no such part or point.
        """
        return MovingPoint(self.model, self._memory, self._live, name)

    def frame(self, name: str) -> MovingFrame:
        """A part, or a point of it with its axes: a `point` with rotation, angular motion and a Jacobian (6, nv).

        :raises InputError: there is no such part or point.
        """
        return MovingFrame(self.model, self._memory, self._live, name)

    @cached_property
    def center_of_mass(self) -> MovingPoint:
        """The center of mass of all parts; numbers are nan if they have no mass."""
        return MovingPoint(self.model, self._memory, self._live, None)

    def mass_matrix(self) -> Array:
        """M (nv, nv) of the spanning tree, with the reflected inertia of rotors; kg, kg·m and kg·m²."""
        return self._dynamics.term("mass_matrix")

    def bias_terms(self) -> Array:
        """h = c + g (nv,) in N and N·m: what inertia and gravity require at u' = 0."""
        return self._dynamics.term("bias")

    def coriolis_terms(self) -> Array:
        """c (nv,) in N and N·m: Coriolis, centrifugal and gyroscopic terms, and the inertia forces due to drives."""
        return self._dynamics.term("coriolis")

    def gravity_terms(self) -> Array:
        """g (nv,) in N and N·m: minus the generalized forces of gravity."""
        return self._dynamics.term("gravity")

    def generalized_forces(self) -> Array:
        """Q (nv,) in N and N·m: springs, dampers, friction, applied forces, wrenches, actuators and efforts.

        Rigid contacts and dry friction that sticks are not included, nor are constraints.
        """
        return self._dynamics.term("generalized_forces")

    def constraint_jacobian(self) -> Array:
        """G (m, nv) of all equations of loops and constraints, in the order of `constraint_names`: G u + b = 0."""
        return self._dynamics.term("constraint_jacobian")

    def constraint_bias(self) -> Array:
        """γ (m,) with G u' + γ = 0."""
        return self._dynamics.term("constraint_bias")

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """The loop or constraint of each row of G."""
        return self.model.row_names

    def momentum(self, about: str | Sequence[float] | Array | None = None) -> Momentum:
        """The momentum of all parts.

        Rotors of actuators are not included. A spring with mass counts as a third of it at its end.

        :param about: of the angular momentum: a point `part.point`, a part, `ground`, or (3,) in m in ground's frame;
            by default the center of mass.
        :raises InputError: there is no such part or point.
        :raises ValueError: it is not three finite numbers.
        """
        if about is None:
            place = self.center_of_mass.position
        else:
            place = self.point(about).position if isinstance(about, str) else finite_vector(about, 3, "about")
        return self._dynamics.momentum(place)

    def forward_dynamics(self, efforts: Efforts | None = None) -> Array:
        """The accelerations u' (nv,) in this state for given efforts in N and N·m, which are not applied.

        The state of contacts stays as it is. Efforts are clamped to their limits, as in `set_efforts`.

        :param efforts: all in order, or some by name; the others stay as they are. None: all as they are.
        :raises CommandError: see `set_efforts`.
        """
        return self._dynamics.forward(efforts)

    def inverse_dynamics(self, u_rates: Sequence[float] | Array) -> Array:
        """The efforts (nv,) in N and N·m that produce the accelerations `u_rates` (nv,) in this state.

        The present wrenches, live values and contacts are accounted for: closed contacts stay closed, and what sticks
        sticks. Actuators and commanded efforts must exert these efforts together.

        :raises ValueError: the constraints or contacts do not allow them; see
            `mbd_sim.analysis.mechanics.inverse_dynamics.InverseDynamics`.
        """
        return self._dynamics.inverse(u_rates)

    def linearize(self) -> Linearization:
        """x' = A x + B e + C c for small motions about this state, by exact differentiation: see `Linearization`.

        x includes the currents and integrals of actuators; e are changes of efforts, c of commands. The present
        wrenches and live values stay as they are. Closed contacts stay closed, what sticks sticks, and what slides
        slides on.

        :raises MechanismError: an actuator is sampled or delayed, or has a rate limit.
        :raises MbdSimError: a contact is about to change, so that the motion has no derivatives.
        """
        from mbd_sim.analysis.linear.linearization import linearize_at, variation_remark

        equations, now = self.model.equations, self._memory.now
        found = linearize_at(equations, *now, self._compiled.derivatives)
        return replace(found, remark=variation_remark(equations, *now, found.a))

    def state_space(self, inputs: Iterable[str] | None = None, outputs: Iterable[str] | None = None) -> StateSpace:
        """x' = A x + B i, o = C x + D i for small changes about this state, with chosen inputs and outputs.

        A name also stands for all names that begin with it and a dot: `points.rod` for `points.rod.position.x` and so
        on. Inputs and outputs are listed in docs/linear_analysis.md.

        >>> from mbd_sim import Simulation
        >>> system = Simulation.from_file("double_rod").state_space(["efforts.shoulder"], ["points.lower.acceleration"])
        >>> system.outputs
        ('points.lower.acceleration.x', 'points.lower.acceleration.y', 'points.lower.acceleration.z')

        :param inputs: by default all efforts and commands.
        :param outputs: by default the positions of all coordinates.
        :raises CommandError: there is no such input or output, or it has no derivatives in this state.
        :raises MechanismError: an actuator is sampled or delayed, or has a rate limit.
        :raises MbdSimError: a contact is about to change, so that the motion has no derivatives.
        """
        from mbd_sim.analysis.linear.state_space import state_space

        return state_space(self.model.equations, self._live.mechanism, *self._memory.now, inputs, outputs)
