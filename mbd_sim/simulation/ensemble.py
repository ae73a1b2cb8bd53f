"""Many copies of a mechanism in motion, each with its own values, start and efforts, advanced together."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from operator import index
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbd_sim.compiler.ensemble_kernel import (
    Groups,
    compile_members,
    in_lanes,
    one_by_one,
)
from mbd_sim.compiler.fastcall import LARGEST
from mbd_sim.errors import CommandError, DivergedError, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.integrators.tableau import Tableau
from mbd_sim.load import load_mechanism
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.compiled_model import Model, build_model
from mbd_sim.simulation.ensemble_variants import Change, Variants

PIECE = 2000  # steps after which the others are looked at, and progress is told


class EnsembleEnergies(NamedTuple):
    """The energy audit with an array (k,) for each entry, in J: see `Energies`."""

    kinetic: Array
    potential: Array
    dissipated: Array
    work_applied: Array
    work_drives: Array
    total: Array
    residual: Array


class Ensemble:
    """k members of one mechanism, advanced by the same fixed step: eight to a vector, split over threads.

    Arrays have one row a member: `q` (k, nq), `u` (k, nv). A member goes through the same operations as a `Simulation`
    with the same values among its inputs, bit for bit. One whose state would become infinite stays where it was when
    `step` was last called, and is no longer `alive`.

    >>> rods = Ensemble.from_file("double_rod", [{"l": 0.5}, {"l": 1.0}, {"l": 2.0, "joints.elbow.damping": 0.1}])
    >>> rods.run(until=1.0)
    >>> rods.q.shape
    (3, 2)
    """

    def __init__(
        self,
        mechanism: Mechanism,
        members: int | Sequence[Change],
        *,
        method: str | None = None,
        step: float | None = None,
        threads: int | None = None,
    ) -> None:
        """Compile a mechanism for `members`: how many, or for each one what differs from the file, by key.

        :param members: a change names values of the file as `with_values` does, starts such as
            `joints.elbow.position` among them.
        :param method: and `step` (s) replace those of the file.
        :param threads: at most so many at once; all processors, if not given.
        :raises MechanismError: a change does not fit, or acts on what is built into the equations, such as the
            direction of an axis; the member is named.
        """
        changes: Sequence[Change] = [{}] * index(members) if isinstance(members, int) else list(members)
        if not changes:
            raise ValueError("an ensemble has at least one member")
        self.mechanism = mechanism
        self.step_size = mechanism.step if step is None else float(step)
        if not (math.isfinite(self.step_size) and self.step_size > 0.0):
            raise ValueError(f"the step must be a positive number of seconds, not {step!r}")
        variants = Variants(mechanism, changes)
        self.model: Model = build_model(variants.first, method, (), variants.values)
        self._limits = variants.effort_limits()
        self._starts, values = variants.starts(self.model)
        self._groups: Groups = _groups(self.model, len(changes))
        self._of_values = self.model.equations.inputs.of_values
        inputs = np.tile(self.model.inputs, (len(changes), 1))
        inputs[:, self._of_values] = values
        self._groups.put("inputs", inputs)
        self._threads = threads or len(os.sched_getaffinity(0))
        self.steps = 0
        self.reset()

    @classmethod
    def from_file(
        cls,
        mechanism: str | Path,
        members: int | Sequence[Change],
        *,
        method: str | None = None,
        step: float | None = None,
        threads: int | None = None,
    ) -> Ensemble:
        """Load a mechanism file, or a shipped mechanism by name, and compile it.

        :raises MechanismError: with all problems of the file, or what a member has that does not fit.
        """
        return cls(load_mechanism(mechanism), members, method=method, step=step, threads=threads)

    def __len__(self) -> int:
        return self._groups.count

    @property
    def time(self) -> float:
        """Simulated time in s."""
        return self.steps * self.step_size

    @property
    def state(self) -> Array:
        """The integrated states (k, n): q, u, and the audit's energies."""
        return self._groups.get("y")

    @property
    def q(self) -> Array:
        """The generalized coordinates (k, nq)."""
        return self.state[:, self.model.q_range]

    @property
    def u(self) -> Array:
        """The generalized speeds (k, nv)."""
        return self.state[:, self.model.u_range]

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Which members (k,) have a finite state still."""
        return np.asarray(self._groups.get("alive")[:, 0] != 0.0)

    @property
    def error_estimates(self) -> Array:
        """Of each member (k,), see `Simulation.error_estimate`."""
        return self._groups.get("estimates")[:, 0]

    @property
    def energies(self) -> EnsembleEnergies:
        """The energy audit of each member, in J."""
        found = [
            self.model.energies(self.time, y, start, inputs)
            for y, start, inputs in zip(self.state, self._start_energies, self._groups.get("inputs"), strict=True)
        ]
        return EnsembleEnergies(*np.array(found).T)

    def reset(self, q: Array | None = None, u: Array | None = None) -> None:
        """Back to time zero and the start states, or to the given ones (k, nq) and (k, nv); efforts become zero.

        Given states are led to the nearest ones that the constraints allow.

        :raises ValueError: wrong shape, a value that is not finite, or loops that cannot be closed near a state.
        """
        states = self._starts.copy()
        inputs = self._groups.get("inputs")
        inputs[:, self.model.equations.inputs.efforts] = 0.0
        for given, where, symbol in ((q, self.model.q_range, "q"), (u, self.model.u_range, "u")):
            if given is not None:
                states[:, where] = _checked(given, states[:, where].shape, symbol)
        if q is not None or u is not None:
            for row, values in zip(states, inputs[:, self._of_values], strict=True):
                self._lead_back(row, values)
        self._groups.put("y", states)
        self._groups.put("inputs", inputs)
        self._groups.put("estimates", np.zeros((len(self), 1)))
        self._groups.put("alive", np.ones((len(self), 1)))
        self.steps = 0
        self._start_energies = np.zeros(len(self))
        self._start_energies = np.asarray(self.energies.total)

    def set_efforts(self, efforts: Array | Mapping[str, float | Array]) -> None:
        """Set the efforts (k, nv), or (nv,) for all; or some by name, each one number or (k,). They are clamped.

        :raises CommandError: wrong shape, an unknown name, or a value that is not finite; nothing is changed then.
        """
        inputs = self._groups.get("inputs")
        where = self.model.equations.inputs.efforts
        new = inputs[:, where].copy()
        try:
            if isinstance(efforts, Mapping):
                names = list(self.model.coordinate_names)
                for name, value in efforts.items():
                    if name not in names:
                        raise CommandError(f"there is no joint '{name}'. {nearest(name, names)}")
                    new[:, names.index(name)] = value
            else:
                new[:] = efforts
        except (TypeError, ValueError) as error:
            if isinstance(error, CommandError):
                raise
            raise CommandError(
                f"efforts for {len(self)} members of {new.shape[1]} joints do not fit: {error}"
            ) from error
        if not np.all(np.isfinite(new)):
            raise CommandError("an effort is not finite.")
        inputs[:, where] = np.clip(new, -self._limits, self._limits)
        self._groups.put("inputs", inputs)

    def step(self, n: int = 1) -> None:
        """Advance all members by n steps.

        :raises TypeError, ValueError: n is not a whole number from 0 on.
        """
        n = index(n)
        if not 0 <= n <= LARGEST:
            raise ValueError(f"cannot take {n} steps")
        shares = self._groups.shares(self._threads)
        if len(shares) == 1:
            self._groups.advance(self.steps, self.step_size, n, shares[0])
        else:
            with ThreadPoolExecutor(len(shares)) as pool:
                tasks = [pool.submit(self._groups.advance, self.steps, self.step_size, n, share) for share in shares]
                for task in tasks:
                    task.result()
        self.steps += n

    def run(self, until: float, progress: Callable[[float], None] | None = None) -> None:
        """Advance to the step nearest to time `until` in s; `progress` hears the time now and then."""
        if not math.isfinite(until):
            raise ValueError(f"cannot run until t = {until} s")
        last = round(until / self.step_size)
        while self.steps < last:
            self.step(min(last - self.steps, PIECE))
            if progress is not None:
                progress(self.time)

    def require_alive(self) -> None:
        """Refuse to go on where members are lost.

        :raises DivergedError: members became infinite; the first one is named.
        """
        lost = np.flatnonzero(~self.alive)
        if len(lost):
            raise DivergedError(f"{self.mechanism.name}: {len(lost)} members became infinite, first member {lost[0]}")

    def _lead_back(self, y: Array, values: Array) -> None:
        where_q, where_u = self.model.q_range, self.model.u_range
        self.model.normalize(y)
        y[where_q], y[where_u] = self.model.consistent(y[where_q], y[where_u], values)


def _groups(model: Model, count: int) -> Groups:
    sizes = {"y": len(model.start), "inputs": len(model.inputs), "estimates": 1, "alive": 1}
    if not isinstance(model.method, Tableau):  # implicit methods go their own way for each member
        return Groups(count, 1, sizes, one_by_one(model.kernel))
    equations = model.equations
    kernel = compile_members(equations.rates, equations.settle, model.method, model.u_range.stop)
    return Groups(count, kernel.lanes, sizes, in_lanes(kernel))


def _checked(values: Array, shape: tuple[int, ...], symbol: str) -> Array:
    array = np.broadcast_to(np.asarray(values, dtype=float), shape)
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{symbol} holds a value that is not finite")
    return array
