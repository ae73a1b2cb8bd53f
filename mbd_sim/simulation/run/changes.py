"""New states of a simulation between two steps: at time zero, with positions by name, or with other live values.

With positions and speeds given by name, the new state has them, and all loops are closed. With other lengths, the
mechanism is assembled anew from where it is. States are refused in which parts are inside each other, or beyond stops,
ropes and other one-sided constraints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from operator import index
from typing import NamedTuple

import numpy as np

from mbd_sim.base.errors import CommandError, InputError, listed, nearest
from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.dynamics.layouts.coordinate_names import names_of_q
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.natural_units import natural_units
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.commands import number_of
from mbd_sim.simulation.model.live_values import PreparedValues, opens_loops
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.penetrations import require_no_deeper, require_outside
from mbd_sim.simulation.run.run_point import recorded_state

DIGITS = 1e-3  # of all speeds, in the metric of the mass matrix, by which given ones may be rounded
ROUNDING = 1e-6  # in natural units, by how much a value may change so that loops close, as one printed with six digits


class StateValues(NamedTuple):
    """Positions (m, rad) and speeds (m/s, rad/s) by the names of coordinates; an orientation is a rotation vector."""

    positions: Mapping[str, float] = {}
    speeds: Mapping[str, float] = {}

    def __str__(self) -> str:
        positions = [f"{name} = {value:.9g}" for name, value in self.positions.items()]
        speeds = [f"{name}.velocity = {value:.9g}" for name, value in self.speeds.items()]
        return ", ".join([*positions, *speeds])


def checked_values(
    model: Model, positions: Mapping[str, float], speeds: Mapping[str, float], *, at_start: bool
) -> StateValues:
    """Positions and speeds by the names of coordinates.

    At the start, drives that follow commands can be given positions as well.

    :raises CommandError: an unknown or driven coordinate, a value that is no finite number, or nothing to set.
    """
    drives = commanded_drives(model.mechanism)
    for key, values in (("position", positions), ("velocity", speeds)):
        for name in values:
            if name in model.driven_names and not (at_start and name in drives and key == "position"):
                raise _driven_error(name, drives.get(name), at_start)
            if name not in model.coordinate_names and name not in drives:
                raise CommandError(
                    f"there is no joint '{name}'", nearest(name, (*model.coordinate_names, *model.driven_names))
                )
        if bad := [name for name, value in values.items() if not math.isfinite(number_of(f"{key} of {name}", value))]:
            raise CommandError(f"the {key} of {listed(bad)} is not finite", "Give finite numbers.")
    for name in (name for name in positions if name in drives):  # in the order in which they are given
        lower, upper = drives[name].lower, drives[name].upper
        if not lower <= positions[name] <= upper:
            text = f"{name} = {positions[name]:.6g} is beyond the range of its drive, {lower:.6g} to {upper:.6g}"
            raise CommandError(text, "Give a position within it.")
    if not positions and not speeds:
        raise CommandError("it sets nothing", "Give names, and a position or a velocity for each.")
    return StateValues(*({name: float(value) for name, value in values.items()} for values in (positions, speeds)))


def _driven_error(name: str, drive: CommandedDrive | None, at_start: bool) -> CommandError:
    text = f"joint '{name}' is driven: its drive prescribes the motion"
    if drive is None:
        return CommandError(text, "Name only other joints.")
    if at_start:
        return CommandError(f"{text}, and begins at rest", f"Give {name} a position, or command its velocity.")
    again = f"reset(q={{'{name}': …}}), or in a node ~/reset with the parameter start '{name} = …'"
    return CommandError(text, f"Command its {drive.channels[0]}, or start again from another one: {again}.")


def state_with(model: Model, time: float, y: Array, values: Array, given: StateValues) -> Array:
    """The state y with given positions and speeds, at a time in s.

    Drives with a given position are at rest there. Coordinates that are not given keep their values, except as far as
    loops and constraints require others: then they move as little as possible. In a singular configuration, speeds are
    those of one of the branches that meet there.

    :param values: (n,) the live values among the inputs of the equations.
    :raises CommandError: with these values the loops cannot be closed, or the constraints cannot be satisfied.
    """
    names = model.coordinate_names
    moved = _with_positions(model, y, given.positions)
    moved[model.u_range] = [given.speeds.get(name, old) for name, old in zip(names, y[model.u_range], strict=True)]
    if not model.row_names:
        return moved
    from mbd_sim.dynamics.constraints.assembly import close_loops, nearest_speeds, tolerated_errors
    from mbd_sim.dynamics.constraints.singular_start import speeds_of_a_branch

    constraints = model.equations.constraints.with_values(values)
    sizes = dict(zip(names, constraints.scales.tolist(), strict=True))
    fixed = np.array([name in given.positions for name in names])
    q = moved[model.q_range]
    closure = close_loops(constraints, time, q, ~fixed)
    if not closure.closed:
        free = close_loops(constraints, time, q, np.ones(len(names), dtype=bool))
        closed = moved.copy()
        closed[model.q_range] = free.q
        found = {**given.positions, **dict(zip(names, model.coordinates(closed), strict=True))}  # drives stay
        if not free.closed:
            gap = f"a gap of {np.max(np.abs(free.gaps)):.3g} remains"
            raise CommandError(f"the loops cannot be closed near these positions: {gap}", "Give others.")
        if any(abs(found[n] - value) > ROUNDING * sizes.get(n, 0.0) for n, value in given.positions.items()):
            nearby = ", ".join(f"{name} = {found[name]:.6g}" for name in given.positions)
            raise CommandError(
                "the loops cannot be closed with these positions", f"Name fewer joints, or give {nearby}."
            )
        closure = free
    moved[model.q_range] = closure.q
    fixed = np.array([name in given.speeds for name in names])
    u = nearest_speeds(constraints, time, closure.q, moved[model.u_range], fixed)
    errors = product(constraints.gradient(time, closure.q), u) + constraints.drift(time, closure.q)
    if np.any(np.abs(errors) > tolerated_errors(constraints, time, closure.q, u)):
        u = nearest_speeds(constraints, time, closure.q, moved[model.u_range])
        found = dict(zip(names, u, strict=True))
        rate = natural_units(model.mechanism, model.equations.step).rate
        allowed = {name: ROUNDING * (sizes[name] * rate + abs(value)) for name, value in given.speeds.items()}
        if any(abs(found[name] - value) > allowed[name] for name, value in given.speeds.items()):
            nearby = ", ".join(f"{name} = {found[name]:.6g}" for name in given.speeds)
            raise CommandError("the constraints do not allow these speeds", f"Name fewer joints, or give {nearby}.")
    if u.any() and constraints.rank(time, closure.q) < model.equations.start.rank:
        u = speeds_of_a_branch(constraints, time, closure.q, u, fixed)
    moved[model.u_range] = u
    return moved


def require_allowed_speeds(model: Model, y: Array, given: Array, values: Array | None, whose: str = "") -> None:
    """Refuse speeds (nv,) that were given and violate the constraints, by more than the digits of people's numbers.

    :param y: the state with the nearest speeds that satisfy the constraints.
    :param values: as for `Model.project`.
    :param whose: the beginning of the message.
    :raises CommandError: it says by how much, and gives the nearest ones.
    """
    if not model.row_names:
        return
    constraints = model.equations.constraints
    constraints = constraints if values is None else constraints.with_values(values)
    mass, u = constraints.mass_matrix(0.0, y[model.q_range]), y[model.u_range]
    change = u - given
    if product(product(change, mass), change) <= DIGITS**2 * (product(product(given, mass), given)):
        return
    largest = int(np.argmax(np.abs(change)))
    nearby = ", ".join(f"{name} = {value:.6g}" for name, value in zip(model.coordinate_names, u, strict=True))
    raise CommandError(
        (
            f"{whose}the constraints do not allow these speeds: the nearest ones that they allow are {nearby}, of "
            f"which {model.coordinate_names[largest]} differs by {change[largest]:.6g}"
        ),
        (
            "Give these; or some by name, "
            f"u={{'{model.coordinate_names[0]}': …}}, which the others follow; or take the nearest by "
            "nearest_speeds=True."
        ),
    )


def _with_positions(model: Model, y: Array, positions: Mapping[str, float]) -> Array:
    """A copy of the state with other positions; joints of which none is given keep their coordinates bit for bit."""
    names = model.coordinate_names
    all_positions = [positions.get(name, old) for name, old in zip(names, model.coordinates(y), strict=True)]
    replaced = recorded_state(model, y, np.array(all_positions), y[model.u_range])
    moved = y.copy()
    for joint, coordinates in model.layout.q.items():
        if any(name in positions for name in names[model.layout.u[joint]]):
            moved[coordinates] = replaced[coordinates]
    for name, states in model.layout.drives.items():
        if name in positions:
            moved[states] = positions[name], 0.0, 0.0
    return moved


Coordinates = Sequence[float] | Array | Mapping[str, float]  # in order, or some by name


def started(
    model: Model, values: Array, q: Coordinates | None, u: Coordinates | None, nearest_speeds: bool
) -> tuple[Array, Array]:
    """The state and the inputs at time zero, with the live values (n,) of the run: see `Simulation.reset`."""
    y, inputs = model.start.copy(), model.inputs.copy()
    positions, speeds = (value if isinstance(value, Mapping) else {} for value in (q, u))
    if q is not None and not isinstance(q, Mapping):
        y[model.q_range] = finite_vector(q, model.layout.nq, "q", lambda: names_of_q(model.mechanism, model.layout))
    if u is not None and not isinstance(u, Mapping):
        y[model.u_range] = finite_vector(u, model.layout.nv, "u", lambda: model.coordinate_names)
    inputs[model.input_layout.values] = values
    model.normalize(y)
    if q is None and u is None and np.array_equal(inputs, model.inputs):
        return y, inputs
    if positions or speeds:
        y = state_with(model, 0.0, y, values, checked_values(model, positions, speeds, at_start=True))
    else:
        given = y[model.u_range].copy()
        model.project(y, values)
        if u is not None and not nearest_speeds:
            require_allowed_speeds(model, y, given, values)
    model.hold_start(y, inputs)
    require_outside(model, 0.0, y, inputs)
    return y, inputs


def moved(model: Model, memory: KernelMemory, positions: Mapping[str, float], speeds: Mapping[str, float]) -> Array:
    """The present state with positions and speeds by name: see `Simulation.set_state`."""
    given = checked_values(model, positions, speeds, at_start=False)
    time, before, inputs = memory.now
    y = state_with(model, time, before, inputs[model.input_layout.values], given)
    require_outside(model, time, y, inputs)
    model.keep_accounts(time, before, y, inputs)
    return y


LARGEST_MOVE = 0.2  # of the natural sizes of coordinates, between two configurations on the way to other lengths
LEAST_PART = 2.0**-12  # of a change of live values, that is tried when larger parts cannot be assembled


class NotAssembledError(CommandError):
    """The loops cannot be closed with other live values; up to the `part` of their change they can."""

    def __init__(self, part: float) -> None:
        super().__init__("the loops cannot be closed with these values")
        self.part = part


def reassembled(model: Model, time: float, y: Array, inputs: Array, new: Array) -> Array:
    """The state with the live values among new inputs, assembled anew from where the mechanism is.

    Configurations follow the change of the values in parts, each the nearest one to that before, so that the mechanism
    does not pass over into another way of assembling it. The speeds are those of least kinetic energy of their change.

    :param time: in s.
    :param inputs: those at the state y.
    :raises NotAssembledError: somewhere on the way there is no near configuration that closes the loops.
    :raises CommandError: parts would be inside each other or beyond a stop.
    """
    from mbd_sim.dynamics.constraints.assembly import close_nearby, nearest_speeds
    from mbd_sim.mechanism.natural_units import coordinate_sizes

    constraints, where = model.equations.constraints, model.input_layout.values
    sizes, first, last = np.array(coordinate_sizes(model.mechanism, model.mechanism.step)), inputs[where], new[where]
    moved, done, part = y.copy(), 0.0, 1.0
    while done < 1.0:
        reached = min(done + part, 1.0)
        values = last if reached == 1.0 else first + reached * (last - first)
        closure, trial = close_nearby(constraints.with_values(values), time, moved[model.q_range]), moved.copy()
        trial[model.q_range] = closure.q
        distance = np.max(np.abs(model.coordinates(trial) - model.coordinates(moved)) / sizes, initial=0.0)
        if part > LEAST_PART and not (closure.closed and distance <= LARGEST_MOVE):
            part *= 0.5
            continue
        if not closure.closed:
            raise NotAssembledError(done)
        moved, done = trial, reached
    q = moved[model.q_range]
    moved[model.u_range] = nearest_speeds(constraints.with_values(last), time, q, y[model.u_range])
    require_outside(model, time, moved, new)
    return moved


def with_live(
    model: Model, memory: KernelMemory, live: Mapping[str, float], prepared: PreparedValues
) -> tuple[Array, Array, str]:
    """The present state and inputs with prepared live values: see `Simulation.set_live`.

    :param live: the present values.
    :returns: the state and the inputs, and what to say of a mechanism that was assembled anew.
    :raises CommandError: the values would open loops, or the mechanism cannot be assembled with them from here.
    """
    time, y, before = memory.now
    inputs = before.copy()
    inputs[model.input_layout.values] = prepared.inputs
    gap = model.violation(time, y, inputs).position
    length = natural_units(model.mechanism, model.equations.step).length
    names = ", ".join(prepared.changes)
    if not opens_loops(gap, model.violation(time, y, before).position, length):
        require_no_deeper(model, time, y, before, inputs, names)
        return y.copy(), inputs, ""
    if not prepared.reassemble:
        remedy = "Start again with the new value, or let the mechanism be assembled anew: reassemble=True."
        raise CommandError(f"{names}: this would open the loops by {gap:.3g}", remedy)
    try:
        found = reassembled(model, time, y, before, inputs)
    except NotAssembledError as error:
        reached = ", ".join(
            f"{key} = {live[key] + error.part * (value - live[key]):.6g}" for key, value in prepared.changes.items()
        )
        message = f"{names}: from this configuration the loops can be closed only up to about {reached}"
        raise CommandError(message, "Give a value before that, or move the mechanism first.") from error
    moves = model.coordinates(found) - model.coordinates(y)
    largest = int(np.argmax(np.abs(moves)))
    name = model.coordinate_names[largest]
    unit = model.mechanism.coordinate(name).unit
    return found, inputs, f"assembled anew: {name} moves by {moves[largest]:.4g} {unit}"


def checked_steps(steps: int | None) -> int:
    """The steps since time zero of a state that is restored.

    :raises ValueError: they are missing or negative.
    """
    if steps is None:
        raise InputError(
            "the time of the state is missing",
            "Also give the number of steps, restore(state, steps=…), or restore a snapshot().",
        )
    if index(steps) < 0:
        raise ValueError(f"the number of steps must be 0 or more, not {steps}.")
    return index(steps)
