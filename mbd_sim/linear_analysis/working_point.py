"""The state about which a simulation is linearized."""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.analysis.equilibrium import Equilibrium, equilibria, growth_of, is_autonomous, nearest_equilibrium
from mbd_sim.analysis.rest_balance import RestBalance
from mbd_sim.errors import CommandError, DivergedError, InputError, MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.contact_start import require_outside
from mbd_sim.simulation.simulation import Simulation

BALANCED = 1e-9  # the accelerations that may remain with contacts, in units of gravity or of those at the start
_OTHERWISE = "Linearize about the start or another state instead."


def to_equilibrium(simulation: Simulation, near: Array | None = None, number: int = 1) -> Array:
    """Set a simulation to rest in an equilibrium, see `set_to_equilibrium`.

    :returns: the coordinates (nq,).
    """
    return set_to_equilibrium(simulation, near, number).q


def set_to_equilibrium(simulation: Simulation, near: Array | None = None, number: int = 1) -> Equilibrium:
    """Set a simulation to rest at time zero in an equilibrium near its present coordinates, stable or not.

    If it can stay at rest in these, they are the equilibrium, also with contacts, stops and friction that hold it.
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


def equilibria_of(simulation: Simulation) -> list[Equilibrium]:
    """The equilibria that are found near the present coordinates of a simulation, the nearest first.

    With one-sided elements, these are the ones in which nothing touches or sticks, and the present one.

    :raises InputError: the mechanism cannot have any, because it depends on time.
    """
    before = simulation.snapshot()
    try:
        return _all(simulation, simulation.q.copy())
    finally:
        simulation.restore(before)


def _found(simulation: Simulation, q: Array, number: int) -> Equilibrium:
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
    if nearest is None:
        raise InputError(f"no equilibrium of '{name}' was found near this configuration", _OTHERWISE)
    if contact and not _stays(simulation, nearest.q, nearest.states):
        message = f"'{name}' does not stay at rest in this configuration, and none was found near it without contacts"
        raise InputError(message, _OTHERWISE)
    return nearest


def _all(simulation: Simulation, q: Array) -> list[Equilibrium]:
    _require_autonomous(simulation)
    equations = simulation.model.equations
    found = equilibria(equations, _inputs(simulation), q, _states(simulation))
    if equations.one_sided is None:
        return found
    held = _held(simulation, q)
    free = [one for one in found if one.distance > 0.0 and _stays(simulation, one.q, one.states)]
    return free if held is None else [held, *free]


def _require_autonomous(simulation: Simulation) -> None:
    if not is_autonomous(simulation.model.equations):
        name = simulation.mechanism.name
        raise InputError(f"'{name}' has no equilibrium, because forces or drives depend on time", _OTHERWISE)


def _held(simulation: Simulation, q: Array) -> Equilibrium | None:
    """The configuration itself, if contacts and friction hold the mechanism there."""
    states = _states(simulation)
    if not _stays(simulation, q, states):
        return None
    try:
        growth = growth_of(simulation.linearize().a)
    except MbdSimError:  # a contact is about to change
        growth = math.nan
    return Equilibrium(q, states, np.zeros(len(simulation.u)), 0.0, growth)


def _stays(simulation: Simulation, q: Array, states: Array) -> bool:
    """Set a simulation to rest in a configuration; whether it stays there, with what touches and sticks."""
    model = simulation.model
    try:
        _rest_at(simulation, q, states)
    except (CommandError, ValueError, DivergedError):  # parts are inside each other, or contacts have no solution
        return False
    accelerations = model.accelerations(0.0, simulation.y, simulation.inputs)[: len(simulation.u)]
    balance = RestBalance(model.equations, q, states, _inputs(simulation))
    rates = np.concatenate([accelerations, np.zeros(len(states))])
    return bool(np.linalg.norm(balance.of(rates)) <= BALANCED)


def _rest_at(simulation: Simulation, q: Array, states: Array) -> None:
    model, y = simulation.model, simulation.model.start.copy()
    y[model.q_range], y[model.u_range], y[_places_of_states(simulation)] = q, 0.0, states
    require_outside(model, 0.0, y, simulation.inputs)
    simulation.restore(y, steps=0, start_energy=model.energies(0.0, y, 0.0, simulation.inputs).total)


def _states(simulation: Simulation) -> Array:
    return np.array(simulation.y[_places_of_states(simulation)])


def _places_of_states(simulation: Simulation) -> slice:
    equations = simulation.model.equations
    return slice(equations.layout.nq + equations.layout.nv, equations.core.stop)


def _inputs(simulation: Simulation) -> Array:
    """The inputs, with open contacts."""
    inputs = simulation.inputs.copy()
    inputs[simulation.model.input_layout.one_sided] = 0.0
    return inputs
