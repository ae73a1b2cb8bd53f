"""Eigenvalues over values of the file: root loci over one of them, stability maps over two."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mbd_sim.analysis.linearization import size_of_zeros
from mbd_sim.errors import CommandError, InputError, MechanismError
from mbd_sim.geometry.pose import Array
from mbd_sim.linear_analysis.working_point import to_equilibrium
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.short_repr import short_repr
from mbd_sim.simulation.simulation import Simulation

ROUND_OFF = 1e-9  # of a real part, relative to its eigenvalue
ORDERED = 9  # decimals of imaginary parts, relative to the largest eigenvalue, by which eigenvalues are sorted
About = Literal["equilibrium", "start"]


@dataclass(frozen=True, eq=False)
class EigenvalueLocus:
    """The `eigenvalues` (…, n) in 1/s for all combinations of `values` (each (k,), in SI units) at the keys `names`.

    The first axes are those of the values, in their order; eigenvalues are sorted by their imaginary and then their
    real parts. They are nan where there is no equilibrium.
    """

    names: tuple[str, ...]
    values: tuple[Array, ...]
    eigenvalues: NDArray[np.complex128]

    __repr__ = short_repr

    @property
    def growth(self) -> Array:
        """The largest real part (…,) in 1/s: motions grow where it is positive. Round-off is zero."""
        size = np.abs(self.eigenvalues)
        neutral = (size < size_of_zeros(self.eigenvalues)[..., None]) | (
            np.abs(self.eigenvalues.real) < ROUND_OFF * size
        )
        return np.asarray(np.max(np.where(neutral, 0.0, self.eigenvalues.real), axis=-1))


def eigenvalue_locus(
    mechanism: Mechanism,
    values: Mapping[str, Sequence[float] | Array],
    about: About = "equilibrium",
    efforts: Mapping[str, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> EigenvalueLocus:
    """The eigenvalues of a mechanism for all combinations of values at some keys of its file.

    Each equilibrium is sought near the one before it, the first near the start: a stable one if there is one there.
    Values that cannot be live require a new build each, which takes longer.

    :param values: by key, such as `joints.elbow.damping` or `parameters.l`, in SI units.
    :param about: the equilibrium, or the start state with these values.
    :param efforts: constant efforts in N and N·m, by coordinate.
    :param progress: called with 1 after each combination.
    :raises MechanismError: a key does not exist, or a value does not fit there.
    :raises InputError: the mechanism cannot have equilibria, or there is none near the start with the first values.
    """
    names, axes = tuple(values), tuple(np.asarray(list(given), dtype=float) for given in values.values())
    point = _WorkingPoint(mechanism, names, about, dict(efforts or {}))
    found: list[NDArray[np.complex128]] = []
    for combination in product(*(axis.tolist() for axis in axes)):
        found.append(point.eigenvalues(dict(zip(names, combination, strict=True))))
        if progress is not None:
            progress(1.0)
    size = max(map(len, found), default=0)
    rows = [one if len(one) else np.full(size, np.nan + 0j) for one in found]
    if any(len(row) != size for row in rows):
        raise InputError("the number of eigenvalues changes with the values", "Vary them within a smaller range.")
    return EigenvalueLocus(names, axes, np.array(rows).reshape(*map(len, axes), size))


class _WorkingPoint:
    """A simulation in the state about which it is linearized, with changing values."""

    def __init__(self, mechanism: Mechanism, names: Sequence[str], about: About, efforts: Mapping[str, float]) -> None:
        self._mechanism, self._about, self._efforts = mechanism, about, efforts
        self._near: Array | None = None
        self._live: Simulation | None = None
        try:
            self._live = Simulation(mechanism, live=names)
        except MechanismError:
            Simulation(mechanism)  # raises where the mechanism itself is the reason

    def eigenvalues(self, values: Mapping[str, float]) -> NDArray[np.complex128]:
        """The eigenvalues (n,) with these values, sorted; none where there is no equilibrium."""
        simulation = self._with(values)
        simulation.set_efforts(self._efforts)
        if self._about == "equilibrium":
            try:
                self._near = to_equilibrium(simulation, self._near)
            except InputError:
                if self._near is None:
                    raise
                return np.zeros(0, dtype=complex)
        found = np.linalg.eigvals(simulation.linearize().a).astype(complex)
        size = float(np.max(np.abs(found), initial=0.0)) or 1.0
        return found[np.lexsort((found.real, np.round(found.imag / size, ORDERED)))]

    def _with(self, values: Mapping[str, float]) -> Simulation:
        if self._live is not None:
            try:
                self._live.set_live(values)
                self._live.reset()
            except (CommandError, ValueError):  # as it stands, this simulation cannot take these values
                self._live = None
            else:
                return self._live
        return Simulation(self._mechanism, set=dict(values))
