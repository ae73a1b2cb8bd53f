"""What the members of an ensemble have in common with a single simulation: their state, and snapshots of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbd_sim.compiler.ensemble_kernel import MemberGroups
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.short_repr import short_repr
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.read_only import ReadOnlyAttributes, read_only
from mbd_sim.simulation.snapshot import EnsembleSnapshot, MemberFailure, RunLayout, require_same_layout


class EnsembleEnergies(NamedTuple):
    """The energy audit with an array (k,) for each entry, in J: see `Energies`."""

    kinetic: Array
    potential: Array
    dissipated: Array
    work_applied: Array
    work_drives: Array
    total: Array
    residual: Array

    def __repr__(self) -> str:
        return short_repr(self)


class EnsembleState(ReadOnlyAttributes):
    """The part of an `Ensemble` that holds the states of its members."""

    REMEDIES: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("q", "u"), "Call reset(q=…, u=…) to start from given coordinates and speeds."),
        **dict.fromkeys(
            ("state", "alive", "steps", "time", "t"),
            "Call reset() to return to time zero, or restore(…) to continue from a snapshot.",
        ),
        **dict.fromkeys(("step_size", "mechanism", "model"), "Build a new Ensemble with it."),
    }

    mechanism: Mechanism
    model: Model
    step_size: float
    _groups: MemberGroups
    _all_inputs: slice
    _steps: int
    _failures: dict[int, MemberFailure]
    _start_energies: Array

    def __repr__(self) -> str:
        step = f"method {self.model.method_name}, step {self.step_size:g} s"
        return f"<{type(self).__name__} of {len(self)} × {self.mechanism.name} at t = {self.time:g} s: {step}>"

    def __len__(self) -> int:
        return self._groups.count

    @property
    def steps(self) -> int:
        """Steps since time zero."""
        return self._steps

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

    @property
    def energies(self) -> EnsembleEnergies:
        """The energy audit of each member, in J."""
        rows = [
            self.model.energies(self.time, y, start, inputs)
            for y, start, inputs in zip(self.state, self._start_energies, self._inputs, strict=True)
        ]
        return EnsembleEnergies(*np.array(rows).T)

    def snapshot(self) -> EnsembleSnapshot:
        """Everything that the rest of the runs depends on: states, time, efforts, values and the audit."""
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
        self._groups.put("y", snapshot.state)
        self._groups.put("inputs", snapshot.inputs)
        self._groups.put("estimates", snapshot.error_estimates[:, None])
        self._groups.put("alive", snapshot.alive[:, None].astype(float))
        self._steps, self._start_energies = snapshot.steps, snapshot.start_energies.copy()
        self._failures = dict(snapshot.failures)
