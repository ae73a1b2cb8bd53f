"""The simulation of one mechanism. It needs no ROS, no files other than the mechanism's, and no clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import index
from pathlib import Path
from typing import ClassVar, NoReturn, Self, Unpack

import numpy as np

from mbd_sim.errors import DivergedError
from mbd_sim.geometry.pose import Array
from mbd_sim.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.override import with_values
from mbd_sim.simulation.actuation import Actuation
from mbd_sim.simulation.actuator_commands import CommandMap
from mbd_sim.simulation.argument_checks import finite_vector, step_at, step_count, step_size
from mbd_sim.simulation.compiled_model import Model, build_model
from mbd_sim.simulation.contact_start import require_free_start, require_outside
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.kernel_memory import KernelMemory
from mbd_sim.simulation.live_values import LiveValues, PreparedValues, require_closed
from mbd_sim.simulation.options import SimulationOptions, Value
from mbd_sim.simulation.read_only import ReadOnlyAttributes, read_only
from mbd_sim.simulation.readings import Readings
from mbd_sim.simulation.run_reports import RunReports
from mbd_sim.simulation.sensor_readings import SensorReadings
from mbd_sim.simulation.snapshot import RunLayout, SimulationSnapshot, require_same_layout
from mbd_sim.simulation.state_values import checked_values, state_with
from mbd_sim.simulation.step_advice import divergence
from mbd_sim.simulation.wrenches import WrenchMap, require_parts

RUN_CHUNK = 20_000  # steps between two calls of `progress` in `run`

_RESET = "Call reset(q=…, u=…) to start from given coordinates and speeds."
_RESTORE = "Call reset() to return to time zero, or restore(…) to continue from a snapshot."
_BUILD = "Build a new Simulation with it."


class Simulation(Readings, SensorReadings, RunReports, Actuation, ReadOnlyAttributes):
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
    ) -> None:
        """Compile a mechanism; `method` and `step` (s) replace those of its file.

        :param wrenches: parts on which external forces can act, see `set_wrench`.
        :param live: values of the file that can change during a run, see `set_live`: keys such as `gravity[2]`,
            `parameters.l`, `joints.elbow.damping`, or patterns such as `joints.*.damping`.
        :param set: values of the file to replace, by key: `{"l": 0.8, "joints.elbow.position": "30 deg"}`, numbers in
            SI units or values as in the file; a parameter may be given by its name alone.
        :raises MechanismError: the method, a live value or a key in `set` does not exist, a value does not fit there,
            or the equations are singular at the start.
        :raises ValueError: the step is not a positive number.
        :raises CommandError: a part in `wrenches` does not exist.
        """
        mechanism = with_values(mechanism, set) if set else mechanism
        self.mechanism = mechanism
        self.step_size = step_size(step, mechanism.step)
        require_parts(wrenches, mechanism)
        self._live = LiveValues(mechanism, live)
        self.model: Model = build_model(mechanism, method, wrenches, self._live.values, self.step_size)
        require_free_start(self.model)
        memory = self._memory = KernelMemory(self.model, self.step_size)
        layout = self.model.equations.inputs
        self._efforts, self._live_inputs = memory.inputs[layout.efforts], memory.inputs[layout.values]
        self.wrench_map = WrenchMap(mechanism, layout)
        self.command_map = CommandMap(mechanism.actuators, layout)
        self.effort_map = EffortMap(self.model.coordinate_names, mechanism.effort_limits(), self.model.driven_names)
        self.y, self.inputs, self.efforts = (read_only(array) for array in (memory.y, memory.inputs, self._efforts))
        self.q, self.u = read_only(memory.y[self.model.q_range]), read_only(memory.y[self.model.u_range])
        self._prepare_sensors()
        self._use_compiled_step()
        self.reset()
        self._seal()

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Simulation cannot be copied or pickled: build a new one from its mechanism.")

    @classmethod
    def from_file(cls, mechanism: str | Path, **options: Unpack[SimulationOptions]) -> Self:
        """Load a mechanism file or, by name, a shipped mechanism; `options` are the keyword arguments of `Simulation`.

        :raises MechanismError: with all problems of the file.
        """
        return cls(load_mechanism(mechanism), **options)

    @classmethod
    def from_text(cls, text: str, **options: Unpack[SimulationOptions]) -> Self:
        """The same from YAML text."""
        return cls(parse_mechanism(text), **options)

    def step(self, n: int = 1) -> None:
        """Advance by n steps.

        This is compiled code, at 0.05 µs a call. A subclass may override it; then `super().step(n)` costs 1 µs. So it
        does with sensors, and some µs more whenever one measures.

        :raises DivergedError: the state would become infinite; it stays as it was before this call, or at the last
            measurement of a sensor.
        :raises TypeError, ValueError: n is not an integer, or negative.
        """
        n = step_count(n)
        for part in self._sampled((n,) if self._listener is None else self._listener.parts_of(n)):
            if not self._memory.advance(part):
                from mbd_sim.simulation.undefined_expressions import undefined_expression

                mechanism = with_values(self.mechanism, self._live.current) if self._live.current else self.mechanism
                undefined = undefined_expression(self.model, mechanism, self._memory, part)
                raise divergence(self.model, self.time, part, self.step_size, self.step_advice, undefined)
            self._report_contacts()

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

    def reset(self, q: Sequence[float] | Array | None = None, u: Sequence[float] | Array | None = None) -> None:
        """Return to time zero and to the start state or the given one; zero the efforts, the wrenches and the audit.

        Commands of actuators become those before the first one. Live values stay as they are. A given state is
        projected to the nearest one that satisfies the constraints.

        :raises ValueError: wrong length, a value that is not finite, loops that cannot be closed near this state, or
            parts inside each other or beyond a stop; nothing is changed then.
        """
        model, y, inputs = self.model, self.model.start.copy(), self.model.inputs.copy()
        if q is not None:
            y[model.q_range] = finite_vector(q, self.q.size, "q")
        if u is not None:
            y[model.u_range] = finite_vector(u, self.u.size, "u")
        inputs[model.equations.inputs.values] = self._live_inputs
        model.normalize(y)
        if q is not None or u is not None or not np.array_equal(inputs, model.inputs):
            model.project(y, self._live_inputs)
            model.hold_start(y, inputs)
            require_outside(model, 0.0, y, inputs)
        self._memory.load(y, inputs, 0)
        self.start_energy = model.energies(0.0, y, 0.0, inputs).total
        if self._memory.contacts is not None:
            self._memory.contacts.events.clear()
        self._memory.settle()
        self._restart_samples()
        self._report_reset(to_start=q is None and u is None)

    def snapshot(self) -> SimulationSnapshot:
        """Everything that the rest of the run depends on: state, time, efforts, wrenches, live values and the audit."""
        memory = self._memory
        y, inputs, live = memory.y.copy(), memory.inputs.copy(), dict(self._live.current)
        return SimulationSnapshot(
            self._run_layout, y, memory.steps, inputs, live, self.start_energy, memory.error_estimate, self.samples
        )

    @property
    def _run_layout(self) -> RunLayout:
        loaded = self.model.equations.inputs.loaded
        names = self.mechanism.name, self.coordinate_names, loaded, tuple(self._live.current)
        return RunLayout(*names, self.step_size)

    def restore(
        self,
        state: SimulationSnapshot | Sequence[float] | Array,
        steps: int | None = None,
        inputs: Sequence[float] | Array | None = None,
        start_energy: float | None = None,
        live: Mapping[str, float] | None = None,
        samples: Array | None = None,
    ) -> None:
        """Continue from a snapshot or a state of a run of the same equations, bit for bit: nothing is projected.

        :param state: a `snapshot()`, which is restored as a whole and alone; or all of that run's `state`.
        :param steps: the `steps` of that run, required with a state alone: they are its time. `inputs`, `start_energy`
            and `live` are of that run too, and stay as they are if they are not given; `live` only names the values
            in `inputs`. Without `inputs`, the state of contacts is found anew from the positions and speeds. `samples`
            are that run's, too; without them, measurements under way are lost unless the time goes on.
        :raises ValueError: a snapshot of a different run, no `steps` with a state, wrong length, or a value that is
            not finite; nothing is changed then.
        :raises TypeError: other arguments are given with a snapshot.
        """
        if isinstance(state, SimulationSnapshot):
            if not (steps is None and inputs is None and start_energy is None and live is None):
                raise TypeError("a snapshot is restored as a whole. Give no other argument, or give snapshot.state.")
            require_same_layout(state.layout, self._run_layout)
            self._memory.load(state.state, state.inputs, state.steps, state.error_estimate)
            self.start_energy, self._live.current = state.start_energy, dict(state.live)
            self._restart_samples(state.samples)
            self._report_new_state()
            return
        if steps is None:
            raise ValueError(
                "the time of the state is missing: also give the number of steps, restore(state, steps=…), or restore "
                "a snapshot()."
            )
        y = finite_vector(state, self.y.size, "the state")
        new_inputs = self._memory.inputs if inputs is None else finite_vector(inputs, self.inputs.size, "inputs")
        if index(steps) < 0:
            raise ValueError(f"the number of steps must be 0 or more, not {steps}.")
        goes_on = index(steps) == self.steps
        self._memory.load(y, new_inputs, index(steps))
        if inputs is None:
            self._memory.settle()
        if start_energy is not None:
            self.start_energy = float(start_energy)
        self._live.current = {**self._live.current, **(live or {})}
        self._restart_samples(samples, keep=goes_on)
        self._report_new_state()

    def set_state(
        self, positions: Mapping[str, float] | None = None, velocities: Mapping[str, float] | None = None
    ) -> None:
        """Set positions (m, rad) and velocities (m/s, rad/s) by the names of coordinates; the time goes on.

        Coordinates that are not named keep their values, except as far as closed loops require others. Efforts and
        wrenches stay. The audit does not include the resulting change of energy.

        :raises CommandError: an unknown or driven coordinate, a value that is not finite, loops that cannot be closed
            with these values, or parts inside each other or beyond a stop; nothing is changed then.
        """
        given = checked_values(self.model, positions or {}, velocities or {})
        inputs, before = self._memory.inputs, self.energies.total
        y = state_with(self.model, self.time, self.y, inputs[self.model.equations.inputs.values], given)
        require_outside(self.model, self.time, y, inputs)
        after = self.model.energies(self.time, y, 0.0, inputs).total
        self.restore(y, self.steps, start_energy=self.start_energy + after - before)

    def set_efforts(self, efforts: Mapping[str, float] | Sequence[float] | Array) -> None:
        """Set the efforts (N or N·m) from the next step on, all in order or some by name, clamped to the effort limits.

        :raises CommandError: wrong length, an unknown name, or a value that is not finite; nothing is changed then.
        """
        new = self.effort_map.clamped(self.effort_map.merged(self._efforts, efforts))
        repeated = self._is_repeated(self._efforts, new)
        self._efforts[:] = new
        if not repeated:
            self._report_efforts(new)

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
        numbers = self.wrench_map.numbers(part, force, couple, at, axes)
        inputs = self._memory.inputs[self.wrench_map.slices[part]]
        repeated = self._is_repeated(inputs, numbers)
        inputs[:] = numbers
        if not repeated:
            self._report_wrench(part, numbers)

    @property
    def live(self) -> Mapping[str, float]:
        """The live values by key, in SI units."""
        return dict(self._live.current)

    def set_live(self, changes: Mapping[str, float]) -> None:
        """Change live values from the next step on. The energy audit does not include the resulting change of energy.

        :raises CommandError: an unknown key, a value that does not fit, or one that would open loops; nothing is
            changed then.
        """
        self.apply_live(self.prepare_live(changes))

    def prepare_live(self, changes: Mapping[str, float]) -> PreparedValues:
        """The first, slow half of `set_live`: validate changes. It changes nothing and may run in any thread.

        :raises CommandError: an unknown key, or a value that does not fit.
        """
        return self._live.prepare(changes)

    def apply_live(self, prepared: PreparedValues) -> None:
        """The second, fast half of `set_live`; no other change may have been applied since `prepare_live`.

        :raises CommandError: the change would open loops in the present state; nothing is changed then.
        """
        inputs = self._memory.inputs.copy()
        inputs[self.model.equations.inputs.values] = prepared.inputs
        gap = self.model.violation(self.time, self.y, inputs).position
        require_closed(prepared.changes, gap, self.violation.position)
        before = self.energies.total
        self._memory.inputs[:], self._live.current = inputs, dict(prepared.current)
        self.start_energy += self.energies.total - before
        self._memory.settle()
        self._report_live_values(prepared.changes)

    def _use_compiled_step(self) -> None:
        if type(self).step is Simulation.step and self._samples is None:  # a subclass with its own `step` keeps it
            vars(self).pop("step", None)
            vars(self)["step"] = self._memory.compiled_step(self.step)  # calls the method of this name if a step fails
