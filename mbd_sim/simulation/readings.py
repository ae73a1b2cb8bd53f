"""What can be read from a simulation at its present state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from mbd_sim import simulation
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.simulation.run_state import RunState
from mbd_sim.simulation.state_records import DriveState, Energies, Losses, Reaction, Violation

if TYPE_CHECKING:
    from mbd_sim.analysis.linearization import Linearization
    from mbd_sim.analysis.state_space import StateSpace
    from mbd_sim.simulation.actuator_states import AnyActuatorState
    from mbd_sim.simulation.contact_records import ContactEvent, ContactObserver, ContactState
    from mbd_sim.simulation.motions import PartMotion

# Instructions of derivatives up to which they are compiled, within about a second. Larger ones would take some seconds,
# which pay off after ten thousand calls; to compile them then would change the bits of results from call to call.
COMPILED = 15_000


class Readings(RunState):
    """The readings of a `Simulation`; they change nothing."""

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each generalized speed and effort."""
        return self.model.coordinate_names

    @property
    def energies(self) -> Energies:
        """The energy audit, in J."""
        memory = self._memory
        return self.model.audit(memory.read("energies", 2), self.time, memory.y, self.start_energy, memory.inputs)

    def poses(self) -> Mapping[str, Pose]:
        """The pose of each part in ground's frame."""
        return self._read_poses()

    @cached_property
    def _read_poses(self) -> Callable[[], dict[str, Pose]]:
        memory, names = self._memory, self.model.part_names
        reader = memory.reader("poses", len(names) * 12)
        return reader.bound_records(memory.clock, memory.arguments("poses"), names, Pose, ((3,), (3, 3)))

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
        mechanism = self._live.mechanism
        return simulation.motion_of(self.model, mechanism, frame, self.time, self._memory.y, self._memory.inputs)

    @property
    def violation(self) -> Violation:
        """The largest violation of the constraints, in position and velocity."""
        return self.model.violation(self.time, self._memory.y, self._memory.inputs)

    @property
    def error_estimate(self) -> float:
        """The largest estimated error of every eighth step since time zero, relative to s + |q| and s + |u|."""
        return self._memory.error_estimate

    @property
    def step_advice(self) -> str | None:
        """A sentence that names a better step or method if the step is too large for the mechanism, else None.

        Too large are steps with large errors, and such as leave the energy account open.
        """
        return simulation.advice_on_step(
            self.model, self.time, self._memory.y, self._memory.inputs, self.step_size, self.error_estimate
        ) or simulation.advice_on_energy(self.model, self.energies, self.start_energy, self.step_size)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know: why the method was chosen, limits that do not act, drives that jump.

        Jumps of drives are sought in the time of the run, and before its first step in the first 10 s.
        """
        from mbd_sim.simulation.remarks import LOOK_AHEAD, remarks

        state = self.time, self._memory.y, self._memory.inputs
        return remarks(self.model, *state, self.step_size, self.time or LOOK_AHEAD)

    def multipliers(self) -> Mapping[str, Array]:
        """The Lagrange multipliers of each loop and constraint, one for each equation: see `Model.multipliers`."""
        if (compiled := self._compiled_multipliers) is None:
            return self.model.multipliers(self.time, self._memory.y, self._memory.inputs)
        values = compiled()
        return {name: values[rows] for name, rows in self.model.rows_of.items()}

    def drives(self) -> Mapping[str, DriveState]:
        """The position, velocity and force (N or N·m) of each driven coordinate."""
        columns = self.model.drives(self.time, self._memory.y, self._memory.inputs).T.tolist()
        return {name: DriveState(*values) for name, values in zip(self.model.driven_names, columns, strict=True)}

    def actuators(self) -> Mapping[str, AnyActuatorState]:
        """Each actuator by name: commands, effort, voltage and current or pressures, powers, losses, energies."""
        memory = self._memory
        inputs = self.model.with_contact_forces(self.time, memory.y, memory.inputs)
        return self.model.actuators(self.time, memory.y, inputs)

    def reactions(self) -> Mapping[str, Reaction]:
        """The force and the moment that each joint transmits."""
        if (compiled := self._compiled_reactions) is None:
            return self.model.reactions(self.time, self._memory.y, self._memory.inputs)
        return compiled()

    def contacts(self) -> Mapping[str, ContactState]:
        """Each one-sided element and each compliant contact by name: its gap, normal force, friction and state.

        Elements with several gaps, such as the two ends of a joint's limits, have an entry for each.
        """
        return self.model.contacts(self.time, self._memory.y, self._memory.inputs)

    @property
    def contact_events(self) -> tuple[ContactEvent, ...]:
        """The latest changes of contacts since the start, at most 10,000 of them."""
        stepper = self._memory.contacts
        return () if stepper is None else tuple(stepper.events)

    def observe_contacts(self, observer: ContactObserver | None) -> None:
        """Let an observer see each impact and each event of contacts as it is found; None ends that.

        :raises ValueError: the mechanism has no one-sided elements.
        """
        if self._memory.contacts is None:
            raise ValueError(f"mechanism '{self.mechanism.name}' has no one-sided elements to observe")
        self._memory.contacts.observer = observer

    @property
    def contact_event_count(self) -> int:
        """The number of changes of contacts since the simulation was built."""
        stepper = self._memory.contacts
        return 0 if stepper is None else stepper.count

    @property
    def losses(self) -> Losses:
        """The energies in J that impacts and dry friction of one-sided elements have dissipated."""
        return self.model.losses(self._memory.y)

    def linearize(self) -> Linearization:
        """x' = A x + B e + C c for small motions about this state, by exact differentiation: see `Linearization`.

        x includes the currents and integrals of actuators; e are changes of efforts, c of commands. The present
        wrenches and live values stay as they are. Closed contacts stay closed, what sticks sticks, and what slides
        slides on.

        :raises MechanismError: an actuator is sampled or delayed, or has a rate limit.
        :raises MbdSimError: a contact is about to change, so that the motion has no derivatives.
        """
        from mbd_sim.analysis.linearization import linearize_at, variation_remark

        equations, memory = self.model.equations, self._memory
        found = linearize_at(equations, self.time, memory.y, memory.inputs, self._derivatives)
        return replace(found, remark=variation_remark(equations, self.time, memory.y, memory.inputs, found.a))

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
        from mbd_sim.analysis.state_space import state_space

        memory, mechanism = self._memory, self._live.mechanism
        return state_space(self.model.equations, mechanism, self.time, memory.y, memory.inputs, inputs, outputs)

    @cached_property
    def _derivatives(self) -> Callable[[], Array] | None:
        """The compiled derivatives of the equations in this state; None if compiling them would take too long."""
        function = self.model.equations.derivatives
        if function.n_instructions() > COMPILED:
            return None
        arrays, columns = (self._memory.y, self._memory.inputs), function.size1_out(0)
        return self.model.on_request.derivatives().bound(self._memory.clock, arrays, (-1, columns))

    @cached_property
    def _compiled_multipliers(self) -> Callable[[], Array] | None:
        """The multipliers of all rows; None with contacts, or if they are not read by a compiled function."""
        if self.model.contact is not None or not self.model.compiles_multipliers:
            return None
        arrays = self._memory.y, self._memory.inputs
        return self.model.on_request.multipliers().bound(self._memory.clock, arrays, (len(self.model.row_names),))

    @cached_property
    def _compiled_reactions(self) -> Callable[[], dict[str, Reaction]] | None:
        """The loads of the joints; None with contacts, or if they are not compiled."""
        model, clock, arrays = self.model, self._memory.clock, (self._memory.y, self._memory.inputs)
        names = (*self.mechanism.joints, *self.mechanism.closing)
        if model.contact is not None:
            return None
        if not model.shares_load:
            return model.on_request.reactions().bound_records(clock, arrays, names, Reaction, ((3,), (3,)))
        sharing = model.load_sharing
        if (read := model.load_paths.bound(clock, arrays)) is None:
            return None
        return lambda: {
            name: Reaction(row[:3], row[3:]) for name, row in zip(names, sharing.shared_reactions(read()), strict=True)
        }
