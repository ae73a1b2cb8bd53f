"""Changes of the state of a simulation between two steps: resets, snapshots, and positions by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import index

import numpy as np

from mbd_sim import simulation
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.shaped_arrays import finite_vector
from mbd_sim.simulation.actuator_commands import CommandMap
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.readings import Readings
from mbd_sim.simulation.run_reports import RunReports
from mbd_sim.simulation.snapshot import RunLayout, SimulationSnapshot, require_same_layout

Coordinates = Sequence[float] | Array | Mapping[str, float]  # in order, or some by name


class StateChanges(Readings, RunReports):
    """The part of a `Simulation` that replaces its state."""

    command_map: CommandMap
    effort_map: EffortMap
    _live_inputs: Array

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
        model, y, inputs = self.model, self.model.start.copy(), self.model.inputs.copy()
        positions, speeds = (value if isinstance(value, Mapping) else {} for value in (q, u))
        if q is not None and not isinstance(q, Mapping):
            y[model.q_range] = finite_vector(q, self.q.size, "q")
        if u is not None and not isinstance(u, Mapping):
            y[model.u_range] = finite_vector(u, self.u.size, "u")
        inputs[model.input_layout.values] = self._live_inputs
        model.normalize(y)
        if q is not None or u is not None or not np.array_equal(inputs, model.inputs):
            if positions or speeds:
                y = simulation.state_with(
                    model, 0.0, y, self._live_inputs, simulation.checked_values(model, positions, speeds)
                )
            else:
                given = y[model.u_range].copy()
                model.project(y, self._live_inputs)
                if u is not None and not nearest_speeds:
                    simulation.require_allowed_speeds(model, y, given, self._live_inputs)
            model.hold_start(y, inputs)
            simulation.require_outside(model, 0.0, y, inputs)
        self._memory.load(y, inputs, 0)
        self.start_energy = model.energies(0.0, y, 0.0, inputs).total
        if self._memory.contacts is not None:
            self._memory.contacts.events.clear()
        self._memory.settle()
        self._restart_samples()
        self._report_reset(to_start=q is None and u is None)

    def snapshot(self) -> SimulationSnapshot:
        """Everything that the rest of the run depends on, for `restore`.

        These are the time, the state with that of actuators and contacts, efforts, commands and those that are delayed,
        wrenches, live values, the audit, and the samples of sensors. It is plain data, which can be pickled.
        """
        memory = self._memory
        y, inputs, live = memory.y.copy(), memory.inputs.copy(), dict(self._live.current)
        rest = self.start_energy, memory.error_estimate, self.samples, self.history
        return SimulationSnapshot(self._run_layout, y, memory.steps, inputs, live, *rest)

    @property
    def _run_layout(self) -> RunLayout:
        loaded = self.model.input_layout.loaded
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
        history: Array | None = None,
    ) -> None:
        """Continue from a snapshot or a state of a run of the same equations, bit for bit: nothing is projected.

        :param state: a `snapshot()`, which is restored as a whole and alone; or all of that run's `state`.
        :param steps: the `steps` of that run, required with a state alone: they are its time. `inputs`, `start_energy`
            and `live` are of that run too, and stay as they are if they are not given; `live` only names the values
            in `inputs`. Without `inputs`, the state of contacts is found anew from the positions and speeds. `samples`
            are that run's, too; without them, measurements under way are lost unless the time goes on. Nor do runs
            with methods `adams11` and `taylor` go on bit for bit without the `history` of that run.
        :raises ValueError: a snapshot of a different run, no `steps` with a state, wrong length, or a value that is
            not finite; nothing is changed then.
        :raises TypeError: other arguments are given with a snapshot.
        """
        if isinstance(state, SimulationSnapshot):
            if any(value is not None for value in (steps, inputs, start_energy, live, samples)):
                raise TypeError("a snapshot is restored as a whole. Give no other argument, or give snapshot.state.")
            require_same_layout(state.layout, self._run_layout)
            self._memory.load(state.state, state.inputs, state.steps, state.error_estimate, state.history)
            self.start_energy = state.start_energy
            self._live.restore(state.live)
            self._live.limit(self.effort_map)
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
        self._memory.load(y, new_inputs, index(steps), history=history)
        if inputs is None:
            self._memory.settle()
        if start_energy is not None:
            self.start_energy = float(start_energy)
        self._live.restore(live or {})
        self._live.limit(self.effort_map)
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
        given = simulation.checked_values(self.model, positions or {}, velocities or {})
        inputs, before = self._memory.inputs, self.energies.total
        y = simulation.state_with(self.model, self.time, self.y, inputs[self.model.input_layout.values], given)
        simulation.require_outside(self.model, self.time, y, inputs)
        self.model.keep_accounts(self.time, self.y, y, inputs)
        after = self.model.energies(self.time, y, 0.0, inputs).total
        self.restore(y, self.steps, start_energy=self.start_energy + after - before)

    def begin_at(self, positions: Mapping[str, float], velocities: Mapping[str, float]) -> None:
        """Set positions and velocities by name as `set_state` does, and let actuators begin anew, as after a reset.

        :raises CommandError: see `set_state`.
        """
        self.set_state(positions, velocities)
        if self.command_map.names:
            y, inputs = self._memory.y.copy(), self._memory.inputs.copy()
            self.model.hold_start(y, inputs)
            self._memory.load(y, inputs, self._memory.steps, self._memory.error_estimate)
            self._report_new_state()
