"""Eigenvalues over values of the file: root loci over one of them, stability maps over two.

The state about which a simulation is linearized, such as the nearest equilibrium, is found here too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mbd_sim.analysis.equilibria.equilibrium import (
    SAME,
    Equilibrium,
    equilibria,
    growth_of,
    is_autonomous,
    nearest_equilibrium,
)
from mbd_sim.analysis.equilibria.rest_balance import Rest, RestBalance, displacement_between
from mbd_sim.analysis.linear.linearization import size_of_zeros
from mbd_sim.base.errors import CommandError, DivergedError, InputError, MbdSimError, MechanismError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import natural_units
from mbd_sim.simulation.model.penetrations import require_outside
from mbd_sim.simulation.run.simulation import BaseSimulation

BALANCED = 1e-9  # the accelerations that may remain with contacts, in units of gravity or of those at the start
PAUSES, FALLING = 500, 30_000  # how often a mechanism that sinks is stopped, and its steps altogether
_OTHERWISE = "Linearize about the start or another state instead."


def to_equilibrium(simulation: BaseSimulation, near: Array | None = None, number: int = 1) -> Array:
    """Set a simulation to rest in an equilibrium, see `set_to_equilibrium`.

    :returns: the coordinates (nq,).
    """
    return set_to_equilibrium(simulation, near, number).q


def set_to_equilibrium(simulation: BaseSimulation, near: Array | None = None, number: int = 1) -> Equilibrium:
    """Set a simulation to rest at time zero in an equilibrium near its present coordinates, stable or not.

    If it can stay at rest in these, they are the equilibrium, also with contacts, stops and friction that hold it.
    With one-sided elements, the equilibrium in which it comes to rest if it sinks from there counts as well.
    Efforts, wrenches, commands and live values stay as they are.

    :param near: coordinates (nq,) to replace those of the simulation.
    :param number: 1 takes the nearest equilibrium, see `nearest_equilibrium`; 2 the second of those in `equilibria_of`.
    :raises InputError: there is none, or the mechanism cannot have one, because it depends on time; nothing is changed
        then.
    """
    before = simulation.snapshot()
    try:
        found = _found(simulation, simulation.q.copy() if near is None else near, number)
    except BaseException:
        simulation.restore(before)
        raise
    _rest_at(simulation, found.q, found.states)
    return found


def equilibria_of(simulation: BaseSimulation) -> list[Equilibrium]:
    """The equilibria that are found near the present coordinates of a simulation, the nearest first.

    With one-sided elements, these are the present one, the one in which the mechanism comes to rest if it sinks from
    there, and those in which nothing touches or sticks.

    :raises InputError: the mechanism cannot have any, because it depends on time.
    """
    before = simulation.snapshot()
    try:
        return _all(simulation, simulation.q.copy())
    finally:
        simulation.restore(before)


def _found(simulation: BaseSimulation, q: Array, number: int) -> Equilibrium:
    name = simulation.mechanism.name
    if number != 1:
        found = _all(simulation, q)
        if not 1 <= number <= len(found):
            raise InputError(
                f"{number}: {len(found)} equilibria of '{name}' were found near this configuration", _OTHERWISE
            )
        return found[number - 1]
    _require_autonomous(simulation)
    contact = simulation.model.equations.one_sided is not None
    if contact and (held := _held(simulation, q)) is not None:
        return held
    nearest = nearest_equilibrium(simulation.model.equations, _inputs(simulation), q, _states(simulation))
    found = [] if nearest is None else [nearest]
    if contact:
        balance = _balance(simulation, q)
        found = [one for one in found if _stays(simulation, balance, one.q, one.states)]
        found += [one for one in _sunk(simulation, q) if all(_apart(one, other) for other in found)]
    if not found:
        raise InputError(f"no equilibrium of '{name}' was found near this configuration", _OTHERWISE)
    return min(found, key=lambda one: one.distance)


def _all(simulation: BaseSimulation, q: Array) -> list[Equilibrium]:
    _require_autonomous(simulation)
    equations = simulation.model.equations
    found = equilibria(equations, _inputs(simulation), q, _states(simulation))
    if equations.one_sided is None:
        return found
    held, balance = _held(simulation, q), _balance(simulation, q)
    free = [one for one in found if one.distance > 0.0 and _stays(simulation, balance, one.q, one.states)]
    if held is not None:
        return [held, *free]
    touching = [one for one in _sunk(simulation, q) if all(_apart(one, other) for other in free)]
    return sorted([*free, *touching], key=lambda one: one.distance)


def _apart(one: Equilibrium, other: Equilibrium) -> bool:
    return abs(one.distance - other.distance) > SAME * one.distance or not np.allclose(
        one.displacement, other.displacement, rtol=SAME, atol=SAME * float(np.max(np.abs(one.displacement)))
    )


def _require_autonomous(simulation: BaseSimulation) -> None:
    if not is_autonomous(simulation.model.equations):
        name = simulation.mechanism.name
        raise InputError(f"'{name}' has no equilibrium, because forces or drives depend on time", _OTHERWISE)


def _held(simulation: BaseSimulation, q: Array) -> Equilibrium | None:
    """The configuration itself, if contacts and friction hold the mechanism there."""
    balance = _balance(simulation, q)
    return _described(simulation, balance) if _stays(simulation, balance, q, _states(simulation)) else None


def _sunk(simulation: BaseSimulation, q: Array) -> list[Equilibrium]:
    """The equilibrium in which the mechanism comes to rest, on what it then touches, if it sinks from a configuration.

    It falls, and is stopped whenever its kinetic energy has begun to decrease: so it loses energy until it stays.
    """
    sinking, balance, left = simulation.copy(), _balance(simulation, q), FALLING
    try:
        for _ in range(PAUSES):
            if _stays(sinking, balance, q, _states(sinking)):
                return [_described(sinking, balance)]
            before, energy = -1.0, 0.0
            while energy > before and left:
                sinking.step()
                before, energy, left = energy, sinking.energies.kinetic, left - 1
            q = sinking.q.copy()
    except DivergedError:
        pass
    return []


def _described(simulation: BaseSimulation, balance: RestBalance) -> Equilibrium:
    """The configuration of a simulation at rest as an equilibrium, with its distance from that of a balance."""
    rest = Rest(simulation.q.copy(), _states(simulation), 0.0, balance.start.holding)
    try:
        growth = growth_of((linear := simulation.linearize()).a, linear.rate)
    except MbdSimError:  # a contact is about to change
        growth = math.nan
    displacement = displacement_between(simulation.model.equations, balance.start.q, rest.q)
    return Equilibrium(rest.q, rest.states, displacement, balance.distance(rest), growth)


def _balance(simulation: BaseSimulation, q: Array) -> RestBalance:
    return RestBalance(simulation.model.equations, q, _states(simulation), _inputs(simulation))


def _stays(simulation: BaseSimulation, balance: RestBalance, q: Array, states: Array) -> bool:
    """Set a simulation to rest in a configuration; whether it stays there, with what touches and sticks."""
    model = simulation.model
    try:
        _rest_at(simulation, q, states)
    except (CommandError, ValueError, DivergedError):  # parts are inside each other, or contacts have no solution
        return False
    accelerations = model.accelerations(0.0, simulation.y, simulation.inputs)[: len(simulation.u)]
    rates = np.concatenate([accelerations, np.zeros(len(states))])
    return bool(np.linalg.norm(balance.of(rates)) <= BALANCED)


def _rest_at(simulation: BaseSimulation, q: Array, states: Array) -> None:
    model, y = simulation.model, simulation.model.start.copy()
    y[model.q_range], y[model.u_range], y[_places_of_states(simulation)] = q, 0.0, states
    require_outside(model, 0.0, y, simulation.inputs)
    simulation.restore(y, steps=0, start_energy=model.energies(0.0, y, 0.0, simulation.inputs).total)


def _states(simulation: BaseSimulation) -> Array:
    return np.array(simulation.y[_places_of_states(simulation)])


def _places_of_states(simulation: BaseSimulation) -> slice:
    equations = simulation.model.equations
    return slice(equations.layout.nq + equations.layout.nv, equations.core.stop)


def _inputs(simulation: BaseSimulation) -> Array:
    """The inputs, with open contacts."""
    inputs = simulation.inputs.copy()
    inputs[simulation.model.input_layout.one_sided] = 0.0
    return inputs


NEUTRAL_SHARE = 1e-9  # of a real part, relative to its eigenvalue
ORDERED = 9  # decimals of imaginary parts, relative to the largest eigenvalue, by which eigenvalues are sorted
About = Literal["equilibrium", "start"]


@record
class EigenvalueLocus:
    """The `eigenvalues` (…, n) in 1/s for all combinations of `values` (each (k,), in SI units) at the keys `names`.

    The first axes are those of the values, in their order; eigenvalues are sorted by their imaginary and then their
    real parts. They are nan where there is no equilibrium. Those that are tiny beside the natural `rate` in 1/s are
    zeros.
    """

    names: tuple[str, ...]
    values: tuple[Array, ...]
    eigenvalues: NDArray[np.complex128]
    rate: float = 1.0

    @property
    def growth(self) -> Array:
        """The largest real part (…,) in 1/s: motions grow where it is positive. Round-off is zero."""
        size = np.abs(self.eigenvalues)
        neutral = (size < size_of_zeros(self.eigenvalues, self.rate)[..., None]) | (
            np.abs(self.eigenvalues.real) < NEUTRAL_SHARE * size
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
    rate = natural_units(mechanism, mechanism.step).rate
    return EigenvalueLocus(names, axes, np.array(rows).reshape(*map(len, axes), size), rate)


class _WorkingPoint:
    """A simulation in the state about which it is linearized, with changing values."""

    def __init__(self, mechanism: Mechanism, names: Sequence[str], about: About, efforts: Mapping[str, float]) -> None:
        self._mechanism, self._about, self._efforts = mechanism, about, efforts
        self._near: Array | None = None
        self._live: BaseSimulation | None = None
        try:
            self._live = BaseSimulation(mechanism, live=names)
        except MechanismError:
            BaseSimulation(mechanism)  # raises where the mechanism itself is the reason

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

    def _with(self, values: Mapping[str, float]) -> BaseSimulation:
        if self._live is not None:
            try:
                self._live.set_live(values)
                self._live.reset()
            except (CommandError, ValueError):  # as it stands, this simulation cannot take these values
                self._live = None
            else:
                return self._live
        return BaseSimulation(self._mechanism, set=dict(values))
