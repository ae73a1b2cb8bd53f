"""Errors of mechanisms that cannot be assembled: open loops with their gaps, and contradictions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.base.errors import MechanismError, Problem, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.constraints.rows import ConstraintRow
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.source import Location

NEARLY_REDUNDANT = 1e-2  # in natural units: what prevents a motion by less may be due to rounded digits,
NEARLY_CLOSED = 3e-3  # and so may a gap that is less
_BETTER_GUESS = "Give joint positions closer to the intended configuration, with 'guess: true'."


def open_loops(
    mechanism: Mechanism,
    rows: Sequence[ConstraintRow],
    gaps: Array,
    row_sizes: Array,
    size: float,
    given_positions_at_fault: bool,
) -> MechanismError:
    """Loops and constraints that cannot be closed.

    :param gaps: (m,) the remaining gap of each row, in the row's unit.
    :param row_sizes: (m,) the natural size of each row, and `size` that of the mechanism in m.
    :param given_positions_at_fault: whether they could be closed without the given positions.
    """
    nearly = bool(np.all(np.abs(gaps) <= NEARLY_CLOSED * row_sizes)) and not given_positions_at_fault
    problems = [
        _nearly_closed(mechanism, owner, gap) if nearly else _open_loop(mechanism, owner, gap, given_positions_at_fault)
        for owner, gap in _by_owner(rows, gaps, size)
    ]
    if not problems:
        message = "the loop closes only in the wrong assembly mode (a joint axis is flipped)"
        problems = [mechanism.source.problem((), message, _BETTER_GUESS)]
    return MechanismError(problems)


def undefined_constraints(mechanism: Mechanism, rows: Sequence[ConstraintRow], undefined: Array) -> MechanismError:
    """Constraints that have no finite value or derivative, marked in `undefined` (m,)."""
    owners = dict.fromkeys(row.owner for row, bad in zip(rows, undefined, strict=True) if bad)
    message = "has no finite value, or no finite derivative, at the start"
    remedy = (
        "Separate points that coincide, tilt an axis that is perpendicular to its plane, or write an expression that "
        "is smooth at the start."
    )
    return MechanismError([mechanism.source.problem(owner, message, remedy) for owner in owners])


def conflict_with_drives(mechanism: Mechanism, rows: Sequence[ConstraintRow], errors: Array) -> MechanismError:
    """Drives that demand a motion that the constraints forbid; nonzero `errors` (m,) mark these constraints."""
    return MechanismError([_against_drives(mechanism, owner) for owner, _ in _by_owner(rows, errors, 0.0)])


def no_mobility(
    mechanism: Mechanism, rows: Sequence[ConstraintRow], count: int, least: float, shares: Array
) -> MechanismError:
    """A mechanism that has none of its `count` degrees of freedom left.

    :param least: how much the rows prevent the motion that they prevent least, in rad or of the size of the mechanism.
    :param shares: (m,) of the rows in that.
    """
    owners = list(dict.fromkeys(row.owner for row in rows))
    names = listed([str(owner[1]) for owner in owners])
    equations = f"the {len(rows)} equations of {names} leave" if len(rows) > 1 else f"the equation of {names} leaves"
    freedoms = f"none of the {count} degrees of freedom" if count > 1 else "no degree of freedom"
    message, remedy = f"nothing can move: {equations} {freedoms}", "Remove a joint or a constraint."
    if least >= NEARLY_REDUNDANT:
        return MechanismError([mechanism.source.problem(owners[0], message, remedy)])
    chief = rows[int(np.argmax(shares))]
    message += f", but only just: deviations of {least:.1g} rad, or of {least:.1g} of its size, prevent a motion"
    axes = f"axes at '{chief.name}'"
    remedy = f"{_more_digits(axes)} Otherwise remove a joint or a constraint."
    return MechanismError([mechanism.source.problem(chief.owner, message, remedy)])


def _more_digits(axes: str) -> str:
    return (
        f"If {axes} are meant to be parallel, points to coincide, or lengths to be equal, give them with more digits, "
        "or leave out 'tolerance: 0' where it is given."
    )


def isolated_position(mechanism: Mechanism, rows: Sequence[ConstraintRow]) -> MechanismError:
    """A mechanism whose loops close in this position alone."""
    owners = list(dict.fromkeys(row.owner for row in rows))
    message = (
        f"nothing can move: {listed([str(owner[1]) for owner in owners])} can be satisfied in this position alone, "
        "as a chain that is stretched between its ends"
    )
    remedy = "Change a length, or remove a joint or a constraint."
    return MechanismError([mechanism.source.problem(owners[0], message, remedy)])


def inconsistent_speeds(
    mechanism: Mechanism, rows: Sequence[ConstraintRow], errors: Array, fixed: Array
) -> MechanismError:
    """Given velocities, marked in `fixed` (nv,), that violate the constraints by `errors` (m,) per second."""
    given = [name for name, is_fixed in zip(mechanism.coordinate_names, fixed, strict=True) if is_fixed]
    problems = []
    for owner, error in _by_owner(rows, errors, 0.0):
        loop = _loop_of(mechanism, owner)
        violation = f"the given velocities violate {f'the loop of {loop}' if loop else 'this constraint'}"
        remedy = f"Give fewer of {listed(given)}: the others are computed for the least kinetic energy."
        problems.append(mechanism.source.problem(owner, f"{violation} (off by {error} per second)", remedy))
    return MechanismError(problems)


def _by_owner(rows: Sequence[ConstraintRow], errors: Array, size: float) -> list[tuple[Location, str]]:
    """The joints and constraints with the largest errors, and the size of the worst of each; the worst first.

    Errors below 1/1000 of the worst one, or below round-off of a mechanism of this size, are left out.
    """
    sizes: dict[tuple[Location, str], float] = {}
    for row, error in zip(rows, np.where(np.isnan(errors), np.inf, errors), strict=True):
        sizes[row.owner, row.unit] = float(np.hypot(sizes.get((row.owner, row.unit), 0.0), error))
    worst_of = {owner: max((sizes[key], key[1]) for key in sizes if key[0] == owner) for owner, _ in sizes}
    worst = max((value for value, _ in worst_of.values()), default=0.0)
    threshold = max(1e-3 * worst, 1e-10 * size)
    large = [(value, unit, owner) for owner, (value, unit) in worst_of.items() if value >= threshold]
    large.sort(key=lambda entry: -entry[0])
    return [(owner, f"{value:.3g} {unit}".strip()) for value, unit, owner in large]


def _loop_of(mechanism: Mechanism, owner: Location) -> str:
    """The names of the joints in the loop that a joint closes, or "" for a constraint."""
    if owner[0] != "joints":
        return ""
    joint = mechanism.closures[str(owner[1])]
    paths: list[list[str]] = []
    inward = {tree_joint.outboard: tree_joint for tree_joint in mechanism.joints.values()}
    for part in (joint.parent, joint.child):
        path = []
        while part in inward:
            path.append(inward[part].name)
            part = inward[part].inboard
        paths.append(path)
    first, second = ([name for name in path if name not in other] for path, other in (paths, paths[::-1]))
    return listed([*first[::-1], joint.name, *second])


def _nearly_closed(mechanism: Mechanism, owner: Location, gap: str) -> Problem:
    loop = _loop_of(mechanism, owner)
    violation = f"the loop of {loop} remains open here" if loop else "this constraint is violated"
    message = (
        f"{violation} by at least {gap}, but only just: its axes may be nearly parallel, or its points nearly match"
    )
    remedy = f"{_more_digits('axes')} Otherwise check the lengths, points and axes of its parts."
    return mechanism.source.problem(owner, message, remedy)


def _open_loop(mechanism: Mechanism, owner: Location, gap: str, given_positions_at_fault: bool) -> Problem:
    loop = _loop_of(mechanism, owner)
    violation = f"the loop of {loop} remains open here" if loop else "this constraint is violated"
    if given_positions_at_fault:
        given = [joint.name for joint in mechanism.joints.values() if any(joint.fixed_in_assembly)]
        remedy = (
            f"It closes without the given positions of {listed(given)}: give fewer of them, or mark them as "
            "'guess: true'."
        )
        return mechanism.source.problem(owner, f"{violation} by {gap} with the given positions", remedy)
    driven = [joint.name for joint in mechanism.joints.values() if joint.drive]
    drives = f", the drives of {listed(driven)} at t = 0" if driven else ""
    remedy = f"Check the lengths, points and axes of its parts{drives}, and the initial guesses ('guess: true')."
    return mechanism.source.problem(owner, f"{violation} by at least {gap}", remedy)


def _against_drives(mechanism: Mechanism, owner: Location) -> Problem:
    driven = [joint.name for joint in mechanism.joints.values() if joint.drive]
    loop = _loop_of(mechanism, owner)
    constraint = f"the loop of {loop}" if loop else "this constraint"
    cause = f"the drive of {listed(driven)}" if driven else "an expression of time"
    message = f"{constraint} leaves no freedom for {cause}: the two contradict each other just after the start"
    return mechanism.source.problem(owner, message, "Remove a drive or a constraint.")
