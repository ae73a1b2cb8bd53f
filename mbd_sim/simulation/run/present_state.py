"""The present state of a simulation, and everything that can be read of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.commands import EffortMap, Efforts
from mbd_sim.simulation.model.live_values import LiveValues
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import DriveState, Energies, Losses, Reaction, Violation
from mbd_sim.simulation.run.arguments import ReadOnlyAttributes, read_only
from mbd_sim.simulation.run.moving_points import MovingFrame, MovingPoint, motion_of
from mbd_sim.simulation.run.readings import CompiledReadings, DynamicsReadings, Momentum, RunSensors

if TYPE_CHECKING:
    from mbd_sim.analysis.linear.linearization import Linearization
    from mbd_sim.analysis.linear.state_space import StateSpace
    from mbd_sim.simulation.contact.records import ContactEvent, ContactState
    from mbd_sim.simulation.kernel.sensors import Arrival, SensorReading
    from mbd_sim.simulation.model.actuator_states import AnyActuatorState
    from mbd_sim.simulation.model.state_records import PartMotion


class PresentState(ReadOnlyAttributes):
    """The state of a mechanism at a step boundary: what a `Simulation` is between two steps.

    `q`, `u`, `y` and `inputs` are read-only views of the kernel's own memory, see `Simulation`.
    """

    def _begin(self, mechanism: Mechanism, model: Model, live: LiveValues, step: float) -> None:
        """Allocate the memory, and what reads it."""
        self.mechanism, self.model, self.step_size, self._live = mechanism, model, step, live
        memory = self._memory = KernelMemory(model, step)
        self.effort_map = EffortMap.of(mechanism, mechanism.effort_limits())
        self._compiled = CompiledReadings(model, memory)
        self._dynamics = DynamicsReadings(model, memory, self.effort_map)
        self._sensors = RunSensors(model, mechanism, step, memory)
        self.sensor_model, self.start_energy = self._sensors.model, 0.0
        self.y, self.inputs = read_only(memory.y), read_only(memory.inputs)
        self.q, self.u = read_only(memory.y[model.q_range]), read_only(memory.y[model.u_range])

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
        """A copy of the integrated state y: q, u, the states of actuators, and the energies of the audit."""
        return self._memory.y.copy()

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each generalized speed and effort."""
        return self.model.coordinate_names

    @property
    def live(self) -> Mapping[str, float]:
        """The live values by key, in SI units."""
        return dict(self._live.current)

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

    @property
    def live_mechanism(self) -> Mechanism:
        """The mechanism with the present live values."""
        return self._live.mechanism

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
        """The largest error of a step since time zero, estimated in every eighth step.

        It is relative to s + |q| and s + |u|, with the natural sizes s of coordinates and speeds.
        """
        return self._memory.error_estimate

    @property
    def step_advice(self) -> str | None:
        """A sentence that names a better step or method if the step is too large for the mechanism, else None.

        A step is too large if its estimated error is large, if it leaves the energy account open, if it may miss a
        contact, or if contacts press too little in it.
        """
        from mbd_sim.simulation.run.advice import advice_on_energy, advice_on_step

        return (
            advice_on_step(self.model, *self._memory.now, self.step_size, self.error_estimate)
            or advice_on_energy(self.model, self.energies, self.start_energy, self.step_size)
            or self.passing_advice
            or self.pressing_advice
        )

    @property
    def pressing_advice(self) -> str | None:
        """A sentence on dampers that make contacts press too little in time stepping, else None."""
        from mbd_sim.simulation.run.advice import advice_on_pressing

        return advice_on_pressing(self.model, *self._memory.now, self.step_size)

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
        from mbd_sim.simulation.run.remarks import remarks

        return remarks(self.model, *self._memory.now, self.step_size, self.time)

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
        return self.model.contact_readings.states(*self._memory.now)

    @property
    def contact_events(self) -> tuple[ContactEvent, ...]:
        """The latest changes of contacts since the start, at most 10,000 of them."""
        stepper = self._memory.stepper
        return () if stepper is None else tuple(stepper.events)

    @property
    def contact_event_count(self) -> int:
        """The number of changes of contacts since the simulation was built."""
        return self._memory.contact_count

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
