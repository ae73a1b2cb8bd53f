"""The contacts of a mechanism as compiled functions see them: numbers, and the addresses of the kernel's functions."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, External, Integers, zeros
from mbd_sim.dynamics.contact.one_sided_equations import SLIDING

ADVANCE = External("int", ("Array", "Array", "int", "float", "int", "Array"))
PART_STEP = External("int", ("Array", "Array", "float", "float"))
START = External("int", ("Array", "Array", "Array", "Array", "Array"))
READ_INPUTS = External("None", ("Array", "Array"))
READ_STATE = External("None", ("Array", "Array", "Array"))
READ = External("None", ("Array", "Array", "Array", "Array"))
PROJECT = External("int", ("Array", "Array", "float"))
READ_RESPONSE = External("None", ("Array", "Array", "Array", "Array", "Array"))
DECIDE = External("int", ("float", "Integers", "Array", "Integers", "Integers", "int", "float"))
NOTE = External("None", ())


@dataclass(frozen=True)
class Stepping:
    """What time stepping needs besides; see `emit_time_stepping` and the readers of the kernel for the addresses.

    The `joints` have their coordinates and speeds at `joint_places`: from 4 j and before 4 j + 1, from 4 j + 2 and
    before 4 j + 3. The `compliance` (rows,) is that of elastic supports.
    """

    project: int
    marked_terms: int
    displaced: int
    powers: int
    joints: int
    joint_places: Integers
    compliance: Array


@dataclass(frozen=True)
class Contacts:
    """See `mbd_sim.simulation.contact.one_sided_model.OneSidedModel` for most of the numbers.

    Where the contacts are not `simple`, all events are left to `decide`, and all steps of time stepping to others.

    Addresses: `advance` to the next event, or with `time_stepping` by free steps, `part_step`, `readings`, `poses`,
    `terms`, `response`, `restitution`, `joint_loads`, and `energies`, which is 0 where these need not be known at
    impacts: where nothing is `driven`, and nobody observes them. `start` (slopes and readings) and `project` onto the
    constraints are 0 with `time_stepping`, and `gaps_and_rates` is 0 without it where no friction has two directions.
    `decide` makes the changes of an event that is not simple, and `note` takes the events that have been recorded;
    where they are 0, such steps are left to others, and events are forgotten.

    The poses of mechanisms with slots are `places` numbers, with those of ground, and the `body_pairs` pairs of bodies
    that have slots are `bodies`, see `pairs`; a gap in m counts as zero up to the `accuracy`. Once a pool has had too
    few slots, `lacking` (1,) is not 0, and the step is left to others. Pairs have `held_slots` (1,) of pools. To tell
    soon that bodies are far from each other, memory is kept: the `latest` poses of the parts, how far the centers of
    bodies, up to `reaches` (parts,) from the origins, have `travelled` (parts,) until then at most, and in the last
    step, `stepped` (parts,). There are
    `inputs`, and behind them `history` numbers of the method, which hold the inputs that they belong to from
    `kept_inputs` on, if that is not 0. The `held_count` numbers `held` of a state change between
    steps only. Slip below the speed `slow` has the stored direction. States have `size` numbers, the speeds are those
    from `first_speed` on, and the losses follow `first_loss`. The modes are the inputs from `first_mode` on, and those
    from their number `first_feature` on are the features of slots. The gaps from `first_pooled` on are those of pools,
    and the modes from `first_holder` on the numbers of the pairs that have them. Friction element k has the rows 2 k
    and 2 k + 1 of `friction_rows`, the second of which is -1 along one direction, and the gap `friction_gaps` k or -1;
    along two directions it is number `pair_places` k of the `pairs`. If it depends on one of the `loaded` joints, that
    is number `friction_loads` k, otherwise -1. Load j belongs to the element `load_elements` j; its `load_components`
    j numbers without contact forces, and then those by each row, are in what `joint_loads` gives from `load_offsets` j
    on. The `singles` have one component and a guard each, after all others. `radau` are the nodes of collocation, after
    0, and its coefficients row by row.
    """

    simple: bool
    time_stepping: bool
    stepping: Stepping
    advance: int
    part_step: int
    start: int
    project: int
    readings: int
    gaps_and_rates: int
    poses: int
    poses_take_inputs: bool
    decide: int
    note: int
    terms: int
    response: int
    restitution: int
    joint_loads: int
    energies: int
    energies_take_inputs: bool
    driven: bool
    size: int
    gaps: int
    rows: int
    frictions: int
    guards: int
    pairs: int
    places: int
    radau: Array
    body_pairs: int
    bodies: Integers
    lacking: Integers
    held_slots: Integers
    reaches: Array
    latest: Array
    stepped: Array
    travelled: Array
    accuracy: float
    inputs: int
    history: int
    kept_inputs: int
    held_count: int
    held: Integers
    slow: float
    pair_places: Integers
    first_mode: int
    modes: int
    first_feature: int
    first_pooled: int
    first_holder: int
    first_speed: int
    speeds: int
    first_loss: int
    rest_speed: float
    tolerance: float
    unit_speed: float
    unit_rate: float
    unit_force: float
    friction_rows: Integers
    friction_gaps: Integers
    loaded: int
    loads_size: int
    friction_loads: Integers
    load_elements: Integers
    load_components: Integers
    load_offsets: Integers
    singles: int
    single_loads: Integers
    clutches: Integers
    slots: Integers
    row_speeds: Array
    row_loads: Array
    gap_units: Array


def readings_size(c: Contacts) -> int:
    """The numbers of `read`: the time, gaps, rates, forces, guards and rates of turning."""
    return 1 + c.gaps + 2 * c.rows + c.guards + c.pairs


def read(c: Contacts, t: float, y: Array, inputs: Array, out: Array) -> None:
    """All readings of a state."""
    out[0] = t
    READ(c.readings, out, y, inputs, out[1:])


def read_rates(c: Contacts, t: float, y: Array, inputs: Array, out: Array) -> None:
    """The time, gaps and rates among the readings of a state, for little of their cost."""
    out[0] = t
    READ(c.gaps_and_rates, out, y, inputs, out[1:])


def read_poses(c: Contacts, t: float, y: Array, inputs: Array, out: Array) -> None:
    """The poses of all parts and of ground, in mechanisms with slots."""
    time = zeros(1)
    if c.places == 0:
        return
    time[0] = t
    if c.poses_take_inputs:
        READ(c.poses, time, y, inputs, out)
    else:
        READ_STATE(c.poses, time, y, out)
    for i in range(12):
        out[c.places - 12 + i] = 1.0 if i in (3, 7, 11) else 0.0


def turning_at(c: Contacts, readings: Array, element: int) -> float:
    """The rate in 1/s at which friction along two directions may turn its slip."""
    return readings[1 + c.gaps + 2 * c.rows + c.guards + c.pair_places[element]]


def rate_at(c: Contacts, row: int) -> int:
    """Where the rate of a row is among the readings."""
    return 1 + c.gaps + row


def force_at(c: Contacts, row: int) -> int:
    """Where the force of a row is."""
    return 1 + c.gaps + c.rows + row


def guard_at(c: Contacts, guard: int) -> int:
    """Where a guard is."""
    return 1 + c.gaps + 2 * c.rows + guard


def slides(c: Contacts, inputs: Array, element: int) -> bool:
    """Whether a friction element slides."""
    return is_sliding(c, inputs[c.first_mode :], element)


def is_sliding(c: Contacts, modes: Array, element: int) -> bool:
    """Whether a friction element slides in some modes."""
    size = 0.0
    for direction in range(2):
        row = c.friction_rows[2 * element + direction]
        if row >= 0:
            part = modes[c.rows + row]
            size += part * part
    return size > SLIDING


def active_at(c: Contacts, row: int) -> int:
    """Where the inputs say whether a row is active."""
    return c.first_mode + c.gaps + row


def direction_at(c: Contacts, row: int) -> int:
    """Where the inputs have the direction of sliding along a row of friction."""
    return c.first_mode + c.rows + row
