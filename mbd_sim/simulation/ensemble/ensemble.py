"""Ensembles: many simulations of one mechanism, each with its own values, start and efforts, advanced together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from threading import get_ident
from typing import ClassVar, NoReturn, Self, Unpack

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import DivergedError, InputError, counted
from mbd_sim.base.geometry.arrays import require_finite
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.operating_system import processors
from mbd_sim.compiler.ensemble_kernel import MemberGroups
from mbd_sim.files.load import load_mechanism
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.simulation.contact.records import ContactObserver
from mbd_sim.simulation.ensemble.members import (
    divergence_of_member,
    find_modes_of_members,
    member_groups,
    member_steppers,
    sampling_steps,
    time_dependence,
)
from mbd_sim.simulation.ensemble.variants import Change, Variants, member_changes
from mbd_sim.simulation.kernel.memory import steps_under_way
from mbd_sim.simulation.model.commands import Command, CommandMap, EffortMap, MemberCommand
from mbd_sim.simulation.model.model import Model, build_model
from mbd_sim.simulation.model.state_records import EnsembleDrive, EnsembleEnergies, EnsembleMotion, Losses, Reaction
from mbd_sim.simulation.run.arguments import (
    EnsembleOptions,
    ReadOnlyAttributes,
    member_numbers,
    positive_count,
    read_only,
    rows_of,
    step_at,
    step_count,
    step_size,
)
from mbd_sim.simulation.run.changes import require_allowed_speeds
from mbd_sim.simulation.run.moving_points import motion_of
from mbd_sim.simulation.run.run_point import EnsembleSnapshot, MemberFailure, RunLayout, require_same_layout

AT_ONCE = 2000  # steps between two calls of `progress` in `run`, and up to which Ctrl-C does not act


class Ensemble(ReadOnlyAttributes):
    """k members of one mechanism, advanced by the same fixed step: eight to a vector, shared among threads.

    Arrays have one row for each member: `q` (k, nq), `u` (k, nv). A member takes the same operations as a `Simulation`
    with the same values among its inputs, bit for bit. A member whose state would become infinite keeps the state that
    it had before that call of `step`, and is no longer `alive`.

    >>> rods = Ensemble.from_file("double_rod", [{"l": 0.5}, {"l": 1.0}, {"l": 2.0, "joints.elbow.damping": 0.1}])
    >>> rods.run(until=1.0)
    >>> rods.q.shape
    (3, 2)
    """

    REMEDIES: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("q", "u"), "Call reset(q=…, u=…) to start from given coordinates and speeds."),
        **dict.fromkeys(
            ("state", "alive", "steps", "time", "t"),
            "Call reset() to return to time zero, or restore(…) to continue from a snapshot.",
        ),
        **dict.fromkeys(("step_size", "mechanism", "model"), "Build a new Ensemble with it."),
    }

    def __init__(
        self,
        mechanism: Mechanism,
        members: int | Sequence[Change],
        *,
        method: str | None = None,
        step: float | None = None,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Compile a mechanism for `members`: their number, or the changes of each one from the file, by key.

        :param members: a change gives values of the file by key as for `with_values`, including initial values such
            as `joints.elbow.position`.
        :param method: and `step` (s) replace those of the file.
        :param threads: the largest number of threads; by default the number of available processors.
        :param progress: called with the fraction of the members that are built; by default it is shown on a terminal,
            if that takes long. Members that change the same numbers are built at once, others one by one.
        :raises MechanismError: a change does not fit, or concerns a value that is built into the equations, such as
            the direction of an axis; the error names the member.
        :raises ValueError: there are no members, or the step or `threads` is not a positive number.
        """
        changes = member_changes(members)
        self.mechanism = require_mechanism(mechanism)
        self.step_size = step_size(step, mechanism.step)
        variants = Variants(mechanism, changes, progress)
        self.model: Model = build_model(variants.first, method, (), variants.values, self.step_size)
        self._variants = variants
        self._effort_map = EffortMap.of(self.model.mechanism, variants.effort_limits())
        self._failures: dict[int, MemberFailure] = {}
        self._count, self._owner = [0], [0]  # of steps; the thread in a call of `step`
        self._starts, values = variants.starts(self.model)
        self._steppers = member_steppers(self.model, variants, len(changes))
        self._groups: MemberGroups = member_groups(self.model, len(changes), self._steppers)
        layout = self.model.input_layout
        self._command_map = CommandMap(mechanism.commanded, layout)
        self._effort_inputs, self._value_inputs = layout.efforts, layout.values
        self._all_inputs = slice(0, layout.size)  # without the history of the method, which follows
        inputs = np.tile(self.model.inputs, (len(changes), 1))
        inputs[:, self._value_inputs] = values
        self._put_inputs(inputs)
        self._threads = processors() if threads is None else positive_count(threads, "threads")
        self._start_energies = np.zeros(len(changes))
        self.reset()
        self._seal()

    @classmethod
    def from_file(
        cls, mechanism: str | Path, members: int | Sequence[Change], **options: Unpack[EnsembleOptions]
    ) -> Self:
        """Load a mechanism file, or a shipped mechanism by name, and compile it; `options` as in `Ensemble`.

        :raises MechanismError: with all problems of the file, or of a member.
        """
        return cls(load_mechanism(mechanism), members, **options)

    def __repr__(self) -> str:
        step = f"method {self.model.method_name}, step {self.step_size:g} s"
        return f"<{type(self).__name__} of {len(self)} × {self.mechanism.name} at t = {self.time:g} s: {step}>"

    def __len__(self) -> int:
        return self._groups.count

    @property
    def steps(self) -> int:
        """Steps since time zero."""
        return self._count[0]

    @property
    def time(self) -> float:
        """Simulated time in s."""
        return self.steps * self.step_size

    @property
    def state(self) -> Array:
        """The integrated states (k, n): q, u, and the energies of the audit."""
        return self._groups.get("y")

    @property
    def _inputs(self) -> Array:
        return self._groups.get("inputs", self._all_inputs)

    def _put_inputs(self, inputs: Array) -> None:
        """Set the inputs (k, m); a history of earlier steps becomes empty."""
        self._groups.put("inputs", np.pad(inputs, ((0, 0), (0, self.model.history_size))))

    @property
    def q(self) -> Array:
        """A copy of the generalized coordinates (k, nq), which cannot be written."""
        return read_only(self._groups.get("y", self.model.q_range))

    @property
    def u(self) -> Array:
        """A copy of the generalized speeds (k, nv), which cannot be written."""
        return read_only(self._groups.get("y", self.model.u_range))

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Whether the state of each member (k,) has stayed finite."""
        return np.asarray(self._groups.get("alive")[:, 0] != 0.0)

    @property
    def error_estimates(self) -> Array:
        """The error estimate of each member (k,): see `Simulation.error_estimate`."""
        return self._groups.get("estimates")[:, 0]

    def reset(self, q: Array | None = None, u: Array | None = None, *, nearest_speeds: bool = False) -> None:
        """Return to time zero and the start states, or to the given ones (k, nq) and (k, nv); zero the efforts.

        Given coordinates are moved to the nearest ones that satisfy the constraints. Given speeds have to satisfy them.

        :param nearest_speeds: take the speeds nearest to `u` that satisfy the constraints, however far away.
        :raises ValueError: wrong shape, a value that is not finite, or loops that cannot be closed near a state.
        :raises CommandError: a member is inside an obstacle, or its speeds violate the constraints.
        :raises DivergedError: the contacts of a member have no solution; nothing is changed in all these cases.
        """
        self._begin(np.arange(len(self)), q, u, nearest_speeds)
        self._count[0], self._failures = 0, {}

    def restart(
        self,
        members: Sequence[int] | NDArray[np.intp],
        q: Array | None = None,
        u: Array | None = None,
        *,
        nearest_speeds: bool = False,
    ) -> None:
        """Return some members to their start states, or to given ones (n, nq) and (n, nv), while the time goes on.

        That begins a new run of these members, because it requires that nothing depends on the time. See `reset`. With
        sampled servos, it is possible at the steps at which all of them sample, as at time zero.

        :param members: (n,) their indices, each once.
        :param nearest_speeds: see `reset`.
        :raises ValueError: see `reset`; or the motion depends on the time; or servos do not sample at this step; or
            `members` are a mask.
        :raises IndexError: there is no such member.
        :raises CommandError: see `reset`.
        :raises DivergedError: see `reset`.
        """
        if (reason := self._time_dependence) is not None:
            raise InputError(f"members cannot start again by themselves, because {reason}", "Use reset().")
        if self.steps % (every := self._sampling_steps):
            raise InputError(
                f"members cannot start again at step {self.steps}, because servos sample at every multiple of {every} "
                "steps",
                "Restart them at such a step, or use reset().",
            )
        some = member_numbers(members, len(self))
        if not some.size:
            return
        self._begin(some, q, u, nearest_speeds)
        for member in some.tolist():
            self._failures.pop(member, None)

    def _begin(self, members: NDArray[np.intp], q: Array | None, u: Array | None, nearest_speeds: bool) -> None:
        self._require_rest()
        states, inputs, self._start_energies[members] = self._started(members, q, u, nearest_speeds)
        self._groups.put_members("y", members, states)
        self._groups.put_members("inputs", members, np.pad(inputs, ((0, 0), (0, self.model.history_size))))
        self._groups.put_members("estimates", members, np.zeros((members.size, 1)))
        self._groups.put_members("alive", members, np.ones((members.size, 1)))

    @cached_property
    def _time_dependence(self) -> str | None:
        return time_dependence(self.model)

    @cached_property
    def _sampling_steps(self) -> int:
        return sampling_steps(self.model)

    def _started(
        self, members: NDArray[np.intp], q: Array | None, u: Array | None, nearest_speeds: bool
    ) -> tuple[Array, Array, Array]:
        """States (n, m), inputs and energies of some members at their start, see `reset`."""
        states, inputs = self._starts[members], self._inputs[members]
        inputs[:, self._effort_inputs] = 0.0
        for given, where, symbol in ((q, self.model.q_range, "q"), (u, self.model.u_range, "u")):
            if given is not None:
                states[:, where] = require_finite(rows_of(given, states[:, where].shape, symbol), symbol)
        for member, y, values in zip(members.tolist(), states, inputs[:, self._value_inputs], strict=True):
            self.model.normalize(y)
            given = y[self.model.u_range].copy()
            if q is not None or u is not None:
                self.model.project(y, values)
            if u is not None and not nearest_speeds:
                require_allowed_speeds(self.model, y, given, values, f"member {member}: ")
        if self.mechanism.commanded:
            for member, y, row in zip(members.tolist(), states, inputs, strict=True):
                self.model.hold_start(y, row, self._variants.holding(member))
        energies = [self.model.energies(0.0, y, 0.0, row).total for y, row in zip(states, inputs, strict=True)]
        find_modes_of_members(self.model, self._steppers, members, states, inputs)
        return states, inputs, np.array(energies)

    def snapshot(self) -> EnsembleSnapshot:
        """Everything that the rest of the runs depends on: states, time, efforts, values and the audit."""
        self._require_rest()
        groups, estimates = self._groups, self.error_estimates
        states, inputs, energies = groups.get("y"), groups.get("inputs"), self._start_energies.copy()
        failures = dict(self._failures)
        return EnsembleSnapshot(self._run_layout, states, self.steps, inputs, energies, estimates, self.alive, failures)

    @property
    def _run_layout(self) -> RunLayout:
        return RunLayout(self.mechanism.name, self.model.coordinate_names, (), (), self.step_size, len(self))

    def restore(self, snapshot: EnsembleSnapshot) -> None:
        """Continue from a snapshot of the same runs, bit for bit.

        :raises ValueError: it is a snapshot of other runs; nothing is changed then.
        """
        require_same_layout(snapshot.layout, self._run_layout)
        self._require_rest()
        self._groups.put("y", snapshot.state)
        self._groups.put("inputs", snapshot.inputs)
        self._groups.put("estimates", snapshot.error_estimates[:, None])
        self._groups.put("alive", snapshot.alive[:, None].astype(float))
        self._count[0], self._start_energies = snapshot.steps, snapshot.start_energies.copy()
        self._failures = dict(snapshot.failures)

    def sensors(self) -> NoReturn:
        """Refused: members have no sensors, which do not influence the motion either.

        :raises NotImplementedError: always; it says what to do instead.
        """
        raise NotImplementedError(
            "the members of an ensemble have no sensors. Use a Simulation for each, or read q, u and the state."
        )

    def set_efforts(self, efforts: Array | Mapping[str, float | Array]) -> None:
        """Set the efforts (k, nv) in N and N·m, or (nv,) for all members; or some by name, one number or (k,) each.

        They are clamped to the joints' effort limits.

        :raises CommandError: wrong shape, an unknown name, or a value that is not finite; nothing is changed then.
        """
        self._require_rest()
        new = self._effort_map.merged_rows(self._groups.get("inputs", self._effort_inputs), efforts)
        self._groups.put("inputs", self._effort_map.clamped(new), self._effort_inputs)

    @property
    def effort_limits(self) -> Array:
        """A copy of the largest absolute efforts (k, nv) in N and N·m."""
        return self._effort_map.limits.copy()

    def set_effort_limits(self, limits: Array) -> None:
        """Replace the largest absolute efforts (k, nv) in N and N·m, or (nv,) for all, from the next command on.

        :raises ValueError: wrong shape, or a limit that is negative or not a number.
        """
        new = np.broadcast_to(np.asarray(limits, dtype=float), self._effort_map.limits.shape)
        if not np.all(new >= 0.0):
            raise ValueError("a limit of an effort is negative or not a number.")
        self._effort_map.limit(new)

    @property
    def start_states(self) -> Array:
        """A copy of the states (k, n) at which the members start: see `state`."""
        return self._starts.copy()

    @property
    def command_names(self) -> tuple[str, ...]:
        """The names `actuator.channel` of all commands, in their order."""
        return self._command_map.names

    @property
    def commands(self) -> Array:
        """A copy of the commands (k, n) in the order of `command_names`, in SI units."""
        return self._groups.get("inputs", self._command_map.range)

    def set_commands(self, commands: Array | Mapping[str, MemberCommand] | Sequence[Mapping[str, Command]]) -> None:
        """Command the actuators from the next step on: see `Simulation.set_commands`.

        All commands (k, n) in the order of `command_names`, or (n,) for all members; or some by the name of an
        actuator, one number or (k,) each, or such by channel; or one mapping for each member.

        :raises CommandError: wrong shape or number, an unknown actuator or channel, or a value that is not finite;
            nothing is changed then.
        """
        self._require_rest()
        where = self._command_map.range
        present = self._groups.get("inputs", where)
        self._groups.put("inputs", self._command_map.merged_rows(present, commands), where)

    def step(self, n: int = 1) -> None:
        """Advance all members by n steps.

        If an observer of contacts raises an error, or Ctrl-C ends the steps, all members stay at the last time that all
        of them have reached: before this call, or after a multiple of 2000 of its steps.

        :raises CommandError: a call of it is under way already, in another thread or as the caller of an observer.
        :raises TypeError: n is not an integer.
        :raises ValueError: n is negative.
        """
        n = step_count(n)
        for taken in range(0, n, AT_ONCE):
            self._take(min(AT_ONCE, n - taken))

    def _take(self, n: int) -> None:
        alive, owner, count, thread, done = self.alive, self._owner, self._count, get_ident(), list[object]()
        # Between the look and the mark there is no call, where CPython would switch threads or handle Ctrl-C.
        if owner[0]:
            raise steps_under_way(owner[0])
        owner[0] = thread
        try:
            self._groups.advance(self.steps, self.step_size, n, self._threads, done)
        finally:
            # Here neither: what has been done is counted.
            count[0] += n if done else 0
            owner[0] = 0
        self._note_lost(np.flatnonzero(alive & ~self.alive).tolist(), n)

    def _note_lost(self, members: Sequence[int], steps: int) -> None:
        if members:
            inputs = self._inputs
            self._failures |= {member: MemberFailure(self.steps - steps, steps, inputs[member]) for member in members}

    def _require_rest(self) -> None:
        if self._owner[0]:
            raise steps_under_way(self._owner[0])

    def run(self, until: float, progress: Callable[[float], None] | None = None) -> None:
        """Advance to the step nearest to time `until` in s; `progress` is called with the time every 2000 steps.

        :raises ValueError: the time is not finite, or is in the past.
        """
        last = step_at(until, self.step_size, self.steps)
        while self.steps < last:
            self.step(min(last - self.steps, AT_ONCE))
            if progress is not None:
                progress(self.time)

    def require_alive(self) -> None:
        """Raise an error if a member is no longer `alive`.

        :raises DivergedError: it names the first such member, the time, and an expression without a finite value or a
            better step, as `Simulation.step` does.
        """
        lost = np.flatnonzero(~self.alive).tolist()
        if lost:
            first, estimates = lost[0], self.error_estimates
            mechanism, failure = self._variants.mechanism_of(first), self._failures[first]
            y, step = self.state[first], self.step_size
            cause = divergence_of_member(self.model, mechanism, failure, y, step, float(estimates[first]))
            raise DivergedError(
                f"{len(lost)} of {len(self)} members reached an infinite state, the first is member {first}. {cause}"
            )

    @property
    def energies(self) -> EnsembleEnergies:
        """The energy audit of each member, in J."""
        rows = [
            self.model.energies(self.time, y, start, inputs)
            for y, start, inputs in zip(self.state, self._start_energies, self._inputs, strict=True)
        ]
        return EnsembleEnergies(*np.array(rows).T)

    @property
    def losses(self) -> Losses:
        """The energies (k,) in J that impacts and dry friction have dissipated; zero without one-sided elements."""
        found = [self.model.losses(y) for y in self.state]
        return Losses(*np.array(found).T)

    def motion(self, frame: str) -> EnsembleMotion:
        """The motion of a part, or of one of its points, as `part.point`: see `Simulation.motion`.

        :raises InputError: there is no such part or point.
        """
        found = [
            motion_of(self.model, self._variants.mechanism_of(member), frame, self.time, y, inputs)
            for member, (y, inputs) in enumerate(zip(self.state, self._inputs, strict=True))
        ]
        poses, *vectors = zip(*found, strict=True)
        positions, rotations = [pose.position for pose in poses], [pose.rotation for pose in poses]
        return EnsembleMotion(*map(np.array, (positions, rotations, *vectors)))

    def drives(self) -> Mapping[str, EnsembleDrive]:
        """The position, velocity and force of each driven coordinate."""
        columns = np.array(
            [self.model.drives(self.time, y, inputs) for y, inputs in zip(self.state, self._inputs, strict=True)]
        )
        return {name: EnsembleDrive(*columns[..., index].T) for index, name in enumerate(self.model.driven_names)}

    def reactions(self) -> Mapping[str, Reaction]:
        """The force (k, 3) in N and the moment (k, 3) in N·m that each joint transmits: see `Simulation.reactions`."""
        found = [self.model.reactions(self.time, y, inputs) for y, inputs in zip(self.state, self._inputs, strict=True)]
        return {
            name: Reaction(
                np.array([member[name].force for member in found]), np.array([member[name].moment for member in found])
            )
            for name in found[0]
        }

    def observe_contacts(self, observers: Sequence[ContactObserver]) -> None:
        """Tell each member's observer of the events at its contacts from now on; without contacts there are none.

        :raises ValueError: the number of observers is not that of the members.
        """
        if len(observers) != len(self):
            counts = f"{counted(len(observers), 'observer')} for {counted(len(self), 'member')}"
            raise InputError(counts, "Give one for each.")
        self._require_rest()
        for stepper, observer in zip(self._steppers, observers, strict=False):
            stepper.observer = observer
