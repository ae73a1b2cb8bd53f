"""The simulation of one mechanism. It needs no ROS, no files other than the mechanism's, and no clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, NoReturn, Self, Unpack

from mbd_sim import simulation
from mbd_sim.collection_pause import paused_collection
from mbd_sim.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism.records import Mechanism, require_mechanism
from mbd_sim.mechanism_file.override import with_values
from mbd_sim.simulation.actuator_commands import CommandMap
from mbd_sim.simulation.argument_checks import step_size
from mbd_sim.simulation.compiled_model import Model, build_model
from mbd_sim.simulation.dynamics_readings import DynamicsReadings
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.inline_views import InlineViews
from mbd_sim.simulation.kernel_memory import KernelMemory
from mbd_sim.simulation.live_values import LiveValues
from mbd_sim.simulation.options import SimulationOptions, Value, changed_values
from mbd_sim.simulation.read_only import ReadOnlyAttributes, read_only
from mbd_sim.simulation.run_inputs import RunInputs
from mbd_sim.simulation.state_changes import StateChanges
from mbd_sim.simulation.wrenches import WrenchMap, require_parts

_RESET = "Call reset(q=…, u=…) to start from given coordinates and speeds."
_RESTORE = "Call reset() to return to time zero, or restore(…) to continue from a snapshot."
_BUILD = "Build a new Simulation with it."


class Simulation(InlineViews, StateChanges, RunInputs, DynamicsReadings, ReadOnlyAttributes):
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
            simulation.require_computable_pairs(model)
        if model.contact is not None:
            simulation.require_free_start(model)
        self._begin(mechanism, model, values, step)

    def _begin(self, mechanism: Mechanism, model: Model, live: LiveValues, step: float) -> None:
        """Allocate the memory, and start in the start state."""
        self.mechanism, self.step_size, self._live = mechanism, step, live
        self.model: Model = model
        memory = self._memory = KernelMemory(self.model, self.step_size)
        layout = self.model.input_layout
        self._efforts, self._live_inputs = memory.inputs[layout.efforts], memory.inputs[layout.values]
        self.wrench_map = WrenchMap(mechanism, layout)
        self.command_map = CommandMap(mechanism.commanded, layout)
        self.effort_map = EffortMap(self.model.coordinate_names, mechanism.effort_limits(), self.model.driven_names)
        self.y, self.inputs, self.efforts = (read_only(array) for array in (memory.y, memory.inputs, self._efforts))
        self.q, self.u = read_only(memory.y[self.model.q_range]), read_only(memory.y[self.model.u_range])
        self._prepare_sensors()
        self._use_compiled_step()
        self.reset()
        self._seal()

    def __repr__(self) -> str:
        step = f"method {self.model.method_name}, step {self.step_size:g} s"
        return f"<{type(self).__name__} {self.mechanism.name} at t = {self.time:g} s: {step}>"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Simulation cannot be pickled. Pickle its snapshot(), and restore that in a new one.")

    def copy(self) -> Simulation:
        """Another simulation in the same state, which goes on by itself; both share the compiled equations.

        Recordings and the history of contact events stay with the original. `copy.copy` and `copy.deepcopy` do the
        same; copies of a subclass are a plain `Simulation`.
        """
        copied = Simulation.__new__(Simulation)
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
        """The same from YAML text."""
        with paused_collection():
            return cls(parse_mechanism(text), **options)
