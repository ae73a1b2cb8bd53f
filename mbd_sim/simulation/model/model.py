"""A compiled mechanism: everything that can be computed from a state. It holds no state itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base import disk_cache
from mbd_sim.base.disk_cache import cached
from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array, Pose, unpack_poses
from mbd_sim.base.geometry.rotation import rotation_vector, unit
from mbd_sim.base.interrupts import interruptible
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.dynamics.layouts.vectors import AUDIT_STATES, LOSS_STATES
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.live_values import LiveParameters
from mbd_sim.simulation.model.prepared import PreparedModel, load_prepared, model_key, require_method, store_prepared
from mbd_sim.simulation.model.state_records import Energies, Losses, PartMotion, Reaction, Violation

if TYPE_CHECKING:
    from mbd_sim.analysis.mechanics.load_sharing import LoadSharing
    from mbd_sim.compiler.python.bound_call import Call, Clock, CompiledFunction
    from mbd_sim.dynamics.contact.passing import PassingFunctions
    from mbd_sim.dynamics.equations import Equations
    from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters
    from mbd_sim.integrators.between_steps import BetweenSteps
    from mbd_sim.integrators.method import Method
    from mbd_sim.mechanism.elements.contacts import Contact
    from mbd_sim.simulation.contact.one_sided_model import OneSidedModel
    from mbd_sim.simulation.contact.readings import ContactReadings
    from mbd_sim.simulation.model.actuator_states import AnyActuatorState
    from mbd_sim.simulation.model.functions import RequestedFunctions

# Instructions up to which multipliers and paths of loads are compiled, within about 0.3 s, which pays after some 3000
# calls. The time of compilation and the calls grow in proportion.
COMPILED = 5_000
UNKNOWN_ENERGY = (
    "the energy balance is unknown: at this elongation the potential of a spring with 'force' is not computed "
    "(docs/mechanism_file.md); the motion is not affected"
)


class Model:
    """The compiled equations of a mechanism, for one method of integration. Safe to use from several threads.

    The integrated state y consists of q (nq,), u (nv,), the states of actuators and the energies of the audit. `inputs`
    are the external inputs at the start, see `InputLayout`; they are used where a method is called without inputs.
    `method_remark` says why the method was chosen, or that it is unstable; it is empty in ordinary cases. Without
    one-sided elements `one_sided` is None; `loss_range` is that of `Losses` in a state with them. `key` is that of the
    model in the cache.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        prepared: PreparedModel,
        kernel: Kernel,
        trace: Callable[[], Equations],
        one_sided: OneSidedModel | None = None,
        key: str | None = None,
    ) -> None:
        """`trace` derives the equations, or returns those that are known; `key` is that of the model in the cache."""
        self.mechanism, self.kernel, self.one_sided, self._trace, self.key = mechanism, kernel, one_sided, trace, key
        self.method_name, self.method_remark = prepared.method, prepared.method_remark
        self.layout, self.input_layout = prepared.layout, prepared.input_layout
        self.start, self.inputs, self.history_size = prepared.start, prepared.inputs, prepared.history_size
        self.part_names, self.row_names, self.rank = prepared.part_names, prepared.row_names, prepared.rank
        self.coordinate_names, self.driven_names = mechanism.coordinate_names, mechanism.driven_names
        self.q_range = slice(0, self.layout.nq)
        self.u_range = slice(self.layout.nq, self.layout.nq + self.layout.nv)
        first_loss = len(self.start) - len(AUDIT_STATES) - len(LOSS_STATES)
        self.loss_range = slice(first_loss, first_loss + len(LOSS_STATES))  # with contacts
        self.quaternions = {
            name: self.layout.q[name].start + offset
            for name, joint in mechanism.joints.items()
            if (offset := joint.kind.quaternion) is not None and not joint.drive
        }

    def __repr__(self) -> str:
        return f"<Model {self.mechanism.name}: method {self.method_name}>"

    @cached_property
    def equations(self) -> Equations:
        """The equations of motion; those of a model from the cache are traced when they are first read."""
        return self._trace()

    @cached_property
    def method(self) -> Method:
        """The method of integration."""
        from mbd_sim.integrators.methods import METHODS

        return METHODS[self.method_name]

    @property
    def between_steps(self) -> BetweenSteps | None:
        """What changes in the state between steps."""
        if not self.mechanism.actuators or (actuators := self.equations.actuators) is None:
            return None
        return actuators.between_steps

    def kernel_inputs(self) -> Array:
        """A copy of the inputs, with memory behind them for what the method keeps of earlier steps: none as yet."""
        return np.concatenate([self.inputs, np.zeros(self.history_size)])

    @property
    def degrees_of_freedom(self) -> int:
        """The number of independent speeds."""
        return self.layout.nv - self.rank

    def _read(self, name: str, time: float, y: Array, out: Array, inputs: Array | None) -> Array:
        moment, given = np.array([time]), self.inputs if inputs is None else inputs
        arrays = [moment, y, given, out] if self.kernel.reads_inputs[name] else [moment, y, out]
        self.kernel.readers[name](*(array.ctypes.data for array in arrays))
        return out

    def energies(self, time: float, y: Array, start_total: float = 0.0, inputs: Array | None = None) -> Energies:
        """The energy audit at a state; `start_total` is T + V at the start, in J."""
        return self.audit(self._read("energies", time, y, np.empty(2), inputs), time, y, start_total, inputs)

    def audit(
        self, energies: Array, time: float, y: Array, start_total: float = 0.0, inputs: Array | None = None
    ) -> Energies:
        """The energy audit at a state; `energies` (2,) are what the kernel reads there, and the rest as above."""
        kinetic, potential = energies.tolist()
        if "elongations" in self.kernel.readers:
            springs = self.equations.distant_springs
            assert springs is not None
            potential += springs.potential(self._read("elongations", time, y, np.empty(len(springs)), inputs))
        work_applied, work_drives, dissipated = y[-len(AUDIT_STATES) :].tolist()
        total = kinetic + potential
        residual = total - start_total - work_applied - work_drives + dissipated
        return Energies(kinetic, potential, dissipated, work_applied, work_drives, total, residual)

    def pose_array(self, time: float, y: Array, inputs: Array | None = None) -> Array:
        """Pose rows (parts, 12) of `part_names` in ground's frame: see `mbd_sim.base.geometry.pose.unpack_poses`."""
        return self._read("poses", time, y, np.empty((len(self.part_names), 12)), inputs)

    def poses(self, time: float, y: Array, inputs: Array | None = None) -> Mapping[str, Pose]:
        """The pose of each part in ground's frame."""
        positions, rotations = unpack_poses(self.pose_array(time, y, inputs))
        return {
            name: Pose(position.copy(), rotation.copy())
            for name, position, rotation in zip(self.part_names, positions, rotations, strict=True)
        }

    @cached_property
    def on_request(self) -> RequestedFunctions:
        """Kinematics of points and terms of the equations of motion, each compiled when it is first read."""
        from mbd_sim.simulation.model.functions import RequestedFunctions

        return RequestedFunctions(lambda: self.equations, self.key)

    def accelerations(self, time: float, y: Array, inputs: Array) -> Array:
        """u' (nv,), then the accelerations of `driven_names`, under all forces, those of contacts included."""
        return self.on_request.named("accelerations").read(time, y, self.with_contact_forces(time, y, inputs))

    def bound_accelerations(self, clock: Clock, y: Array, inputs: Array) -> Call:
        """u' (nv,) of arrays that stay where they are, as a fast callable; only without contacts."""
        function = self.on_request.named("accelerations")
        return function.bound(clock, (y, inputs), (function.size,), slice(self.layout.nv))

    def part_motions(self, time: float, y: Array, inputs: Array) -> Mapping[str, PartMotion]:
        """The motion of each part in ground's frame and axes."""
        poses, rows = self.poses(time, y, inputs), self.motion_rows(time, y, inputs)
        return {
            name: PartMotion(poses[name], *(vector.copy() for vector in row))
            for name, row in zip(self.part_names, rows, strict=True)
        }

    def motion_rows(self, time: float, y: Array, inputs: Array) -> Array:
        """(parts, 4, 3): velocity, angular velocity and their rates, of each part in ground's frame and axes."""
        given = self.with_contact_forces(time, y, inputs)
        return self.on_request.named("part_motions").read(time, y, given).reshape(-1, 4, 3)

    def drives(self, time: float, y: Array, inputs: Array) -> Array:
        """(3, n): the coordinates of `driven_names`, their speeds, and the forces of the drives, in SI units."""
        given = self.with_contact_forces(time, y, inputs)
        return self._read("drives", time, y, np.empty((3, len(self.driven_names))), given)

    def violation(self, time: float, y: Array, inputs: Array | None = None) -> Violation:
        """The largest violation of the constraints."""
        out = self._read("violation", time, y, np.zeros((2, len(self.row_names))), inputs)
        return Violation(*np.max(np.abs(out), axis=1, initial=0.0).tolist())

    def consistent(self, q: Array, u: Array, values: Array | None = None) -> tuple[Array, Array]:
        """The state (q, u) at t = 0 nearest to a given one that satisfies the constraints.

        :param values: (n,) the live values or ensemble values among the inputs; by default those of the file.
        :raises ValueError: no position near it closes the loops.
        """
        from mbd_sim.dynamics.constraints.assembly import close_loops, nearest_speeds

        if not self.row_names:
            return q, u
        constraints = self.equations.constraints
        if values is not None:
            constraints = constraints.with_values(values)
        closing = close_loops(constraints, 0.0, q, np.ones(self.layout.nv, dtype=bool))
        if not closing.closed:
            raise InputError(
                f"no position near these coordinates closes the loops: a gap of {np.max(np.abs(closing.gaps)):.3g} "
                "remains",
                "Give coordinates closer to a closed configuration.",
            )
        return closing.q, nearest_speeds(constraints, 0.0, closing.q, u)

    def project(self, y: Array, values: Array | None = None) -> None:
        """Move a state y in place to the nearest one at t = 0 that satisfies the constraints: see `consistent`."""
        y[self.q_range], y[self.u_range] = self.consistent(y[self.q_range], y[self.u_range], values)

    def normalize(self, y: Array) -> None:
        """Scale the quaternions of a state y to unit length, in place.

        :raises ValueError: one of them is zero.
        """
        for joint, start in self.quaternions.items():
            if not np.any(y[start : start + 4]):
                raise InputError(f"the quaternion of joint '{joint}' is zero", "Give a nonzero one.")
            y[start : start + 4] = unit(y[start : start + 4])

    def coordinates(self, y: Array) -> Array:
        """(nv,): a position for each of `coordinate_names`; a free joint has x, y, z and its rotation vector in rad."""
        if not self.quaternions:
            return y[: self.layout.nv]
        values = np.empty(self.layout.nv)
        for name, into in self.layout.u.items():
            source = y[self.layout.q[name]]
            if name in self.quaternions:
                offset = self.quaternions[name] - self.layout.q[name].start
                source = np.concatenate([source[:offset], rotation_vector(source[offset:])])
            values[into] = source
        return values

    def multipliers(self, time: float, y: Array, inputs: Array) -> Mapping[str, Array]:
        """The Lagrange multipliers λ of each loop and constraint by name, one for each equation: M u' + h = Q + Gᵀ λ.

        The multiplier of a distance constraint is the force in N that pushes its ends apart. Those of a rolling
        constraint are the normal force and the two components of friction. Redundant equations share the load as
        described in `LoadSharing`.
        """
        given = self.with_contact_forces(time, y, inputs)
        if self.compiles_multipliers:
            values = self.on_request.named("multipliers").read(time, y, given)
        else:
            values = self.load_sharing.multipliers(time, y, given)
        return {name: values[rows] for name, rows in self.rows_of.items()}

    @cached_property
    def rows_of(self) -> Mapping[str, NDArray[np.intp]]:
        """The places of the equations of each loop and constraint by name."""
        names = np.array(self.row_names, dtype=str)
        return {name: np.flatnonzero(names == name) for name in dict.fromkeys(self.row_names)}

    @cached_property
    def shares_load(self) -> bool:
        """Whether redundant joints or constraints share the load: see `LoadSharing`."""
        return self.rank < len(self.row_names) and self._known("shares load", lambda: self.load_sharing.can_share)

    @cached_property
    def compiles_multipliers(self) -> bool:
        """Whether multipliers are read by a compiled function: no load is shared, and the function is not long."""
        return not self.shares_load and self._known(
            "compiles multipliers", lambda: self.equations.multipliers.n_instructions() <= COMPILED
        )

    def _known(self, question: str, answer: Callable[[], bool]) -> bool:
        """The answer, which needs the equations, or the same from the cache."""
        return answer() if self.key is None else cached(answer, question, self.key)

    def reactions(self, time: float, y: Array, inputs: Array) -> Mapping[str, Reaction]:
        """The load that each joint transmits: the joints of the spanning tree first, then those that close loops."""
        given = self.with_contact_forces(time, y, inputs)
        if self.shares_load:
            found = self.load_sharing.reactions(time, y, given)
        else:
            found = self.on_request.named("reactions").read(time, y, given).reshape(-1, 6)
        names = [*self.mechanism.joints, *self.mechanism.closing]
        return {name: Reaction(row[:3], row[3:]) for name, row in zip(names, found, strict=True)}

    @cached_property
    def load_sharing(self) -> LoadSharing:
        """How redundant joints and constraints share the load."""
        from mbd_sim.analysis.mechanics.load_sharing import LoadSharing

        return LoadSharing(self.mechanism, self.equations, None if self.load_paths is None else self.load_paths.read)

    @cached_property
    def load_paths(self) -> CompiledFunction | None:
        """The function of `Equations.load_paths`; None where it is too long to be compiled."""
        short = self.equations.load_paths.function.n_instructions() <= COMPILED
        return self.on_request.named("load_paths") if short else None

    @cached_property
    def passing(self) -> PassingFunctions | None:
        """What steps may miss of contacts; None without any."""
        if not self.mechanism.contacts and not self.mechanism.constraints:
            return None
        from mbd_sim.dynamics.contact.passing import passing_functions

        return passing_functions(self.mechanism, self.input_layout.loaded)

    @property
    def steps_in_python(self) -> bool:
        """Whether each call needs Python: bodies touch with features that change, or contacts act once in each step."""
        if self.one_sided is None:
            return False
        return self.one_sided.features is not None or self.method.time_stepping

    def with_contact_forces(self, time: float, y: Array, inputs: Array) -> Array:
        """The inputs with the forces of contacts, which functions that read forces take from there."""
        if self.one_sided is None:
            return inputs
        return self.one_sided.with_forces(time, y, inputs)

    def losses(self, y: Array) -> Losses:
        """The energies that one-sided elements have dissipated."""
        if self.one_sided is None:
            return Losses(0.0, 0.0)
        return Losses(*y[self.loss_range].tolist())

    @property
    def compliant_contacts(self) -> tuple[Contact, ...]:
        """Those contacts between shapes that are not rigid."""
        return tuple(contact for contact in self.mechanism.contacts if not contact.rigid)

    @cached_property
    def contact_readings(self) -> ContactReadings:
        """What can be read at each contact: states, places, and the numbers of a message.

        What compiles places comes before the first step of a program that reads them in each.
        """
        from mbd_sim.simulation.contact.readings import ContactReadings

        has_places = self.one_sided is not None and len(self.one_sided.placed) > self.one_sided.layout.pooled
        function = self.on_request.named("contact_places") if has_places else None

        def places(time: float, y: Array, inputs: Array, out: Array) -> Array:
            assert function is not None
            out[:] = function.read(time, y, self.with_contact_forces(time, y, inputs)).reshape(out.shape)
            return out

        compliant = self.compliant_contacts
        return ContactReadings(self.one_sided, compliant, self.equations.compliances if compliant else None, places)

    def hold_start(self, y: Array, inputs: Array, mechanism: Mechanism | None = None) -> None:
        """Set states and commands of actuators in place to those before the first command at the positions in y.

        :param mechanism: a variant of that of the model with other start commands.
        """
        if self.mechanism.commanded:
            self.equations.hold(mechanism or self.mechanism, y, inputs)

    def actuators(self, time: float, y: Array, inputs: Array) -> dict[str, AnyActuatorState]:
        """Each actuator by name; see `ActuatorState` and `CylinderState`."""
        if not self.mechanism.actuators or (functions := self.equations.actuators) is None:
            return {}
        from mbd_sim.simulation.model.actuator_states import states_of_actuators

        columns = self._actuator_readings(time, y, inputs)
        return states_of_actuators(self.mechanism.actuators, functions.layout, columns, y, inputs)

    def actuator_efforts(self, time: float, y: Array, inputs: Array) -> Array:
        """The efforts (nv,) of actuators on the coordinates, in N and N·m."""
        from mbd_sim.simulation.model.actuator_states import efforts_on

        return efforts_on(self.mechanism.actuators, self._actuator_readings(time, y, inputs), self.coordinate_names)

    def keep_accounts(
        self, time: float, before: Array, y: Array, inputs: Array, new_inputs: Array | None = None
    ) -> None:
        """Leave the energy that chambers gain from a change of the state or of live values out of their accounts.

        :param before: the state before, y that after the change, which is corrected in place.
        :param new_inputs: those after the change, by default the same `inputs`.
        """
        if self.mechanism.actuators and (functions := self.equations.actuators) is not None:
            old = functions.stored(time, before, inputs)
            new = functions.stored(time, y, inputs if new_inputs is None else new_inputs)
            for index, stored in new.items():
                y[index] += stored - old[index]

    def _actuator_readings(self, time: float, y: Array, inputs: Array) -> Array:
        assert self.equations.actuators is not None
        rows = self.equations.actuators.readings.size1_out(0)
        return self._read("actuators", time, y, np.empty((len(self.mechanism.actuators), rows)), inputs)


def build_model(
    mechanism: Mechanism,
    method: str | None = None,
    loaded: Sequence[str] = (),
    values: SymbolicParameters | LiveParameters | None = None,
    step: float | None = None,
) -> Model:
    """Compile a mechanism, with the method of its file or the one named; `auto` chooses one, see `choose_method`.

    :param loaded: parts on which external wrenches can act.
    :param values: numbers of the mechanism that become inputs instead of constants: see `derive`. Only models without
        such numbers, and those with live ones, come from the cache.
    :param step: in s; by default that of the file.
    :raises MechanismError: the method is unknown, or the equations are singular at the start.
    """
    name, given_step = require_method(mechanism, method), step or mechanism.step

    def trace() -> Equations:
        from mbd_sim.dynamics.equations import derive

        symbols = values.symbolic if isinstance(values, LiveParameters) else values
        return derive(mechanism, loaded, symbols, given_step)

    live = values.digest if isinstance(values, LiveParameters) else ""
    key = None
    if disk_cache.folder() is not None and (
        values is None or isinstance(values, LiveParameters) or not len(values.base)
    ):
        key = model_key(mechanism, name, loaded, given_step, live)
        if (found := load_prepared(key)) is not None:
            return Model(mechanism, *found, trace, key=key)
    # All that traces and compiles: a start with a stored model needs none of it.
    from mbd_sim.simulation.model.builder import build, can_be_stored, one_sided_model

    with interruptible():
        built = build(mechanism, name, trace, given_step)
    if key is not None and can_be_stored(built.equations):
        store_prepared(key, built.prepared, built.kernel)
    one_sided = one_sided_model(built.equations, built.kernel)
    return Model(mechanism, built.prepared, built.kernel, lambda: built.equations, one_sided, key)
