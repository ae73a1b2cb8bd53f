"""Why a mechanism cannot start: which loop stays open and by how much, and what contradicts what."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.dynamics.constraint_rows import Row
from mbd_sim.errors import MechanismError, Problem, listed
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism.source import Location

_GUESS = "Give the joints positions nearer to how it looks, with 'guess: true'."


def open_loops(mechanism: Mechanism, rows: Sequence[Row], gaps: Array, size: float, held_back: bool) -> MechanismError:
    """Loops and constraints that cannot be closed; `held_back` where they could without the given positions."""
    problems = [_open_loop(mechanism, owner, gap, held_back) for owner, gap in _by_owner(rows, gaps, size)]
    if not problems:
        problems = [mechanism.source.problem((), "the loops close only with an axis turned over", _GUESS)]
    return MechanismError(problems)


def no_value(mechanism: Mechanism, rows: Sequence[Row], without: Array) -> MechanismError:
    """Constraints that `without` (m,) marks as having no finite value or derivative."""
    owners = dict.fromkeys(row.owner for row, bad in zip(rows, without, strict=True) if bad)
    message = "has no finite value, or no finite derivative, at the start"
    remedy = (
        "Move points apart that coincide, tilt an axis that is upright, or write an expression that is smooth there."
    )
    return MechanismError([mechanism.source.problem(owner, message, remedy) for owner in owners])


def contradiction(mechanism: Mechanism, rows: Sequence[Row], defects: Array) -> MechanismError:
    """Drives that ask for what the constraints forbid."""
    return MechanismError([_against_drives(mechanism, owner) for owner, _ in _by_owner(rows, defects, 0.0)])


def _by_owner(rows: Sequence[Row], defects: Array, size: float) -> list[tuple[Location, str]]:
    """The joints and constraints whose rows are off, with by how much the worst of them is, the worst first."""
    sizes: dict[tuple[Location, str], float] = {}
    for row, defect in zip(rows, np.where(np.isnan(defects), np.inf, defects), strict=True):
        sizes[row.owner, row.unit] = float(np.hypot(sizes.get((row.owner, row.unit), 0.0), defect))
    found = {owner: max((sizes[key], key[1]) for key in sizes if key[0] == owner) for owner, _ in sizes}
    worst = max((value for value, _ in found.values()), default=0.0)
    off = [(value, unit, owner) for owner, (value, unit) in found.items() if value >= max(1e-3 * worst, 1e-10 * size)]
    return [(owner, f"{value:.3g} {unit}".strip()) for value, unit, owner in sorted(off, key=lambda entry: -entry[0])]


def _loop_of(mechanism: Mechanism, owner: Location) -> str:
    """The joints of the loop that a joint closes, to name it."""
    if owner[0] != "joints":
        return ""
    joint = mechanism.closing[str(owner[1])]
    paths: list[list[str]] = []
    inward = {tree.outboard: tree for tree in mechanism.joints.values()}
    for part in (joint.parent, joint.child):
        path = []
        while part in inward:
            path.append(inward[part].name)
            part = inward[part].inboard
        paths.append(path)
    first, second = ([name for name in path if name not in other] for path, other in (paths, paths[::-1]))
    return listed([*first[::-1], joint.name, *second])


def _open_loop(mechanism: Mechanism, owner: Location, gap: str, held_back: bool) -> Problem:
    loop = _loop_of(mechanism, owner)
    what = f"the loop of {loop} stays open here" if loop else "this constraint is missed"
    if held_back:
        given = [joint.name for joint in mechanism.joints.values() if any(joint.held)]
        remedy = f"It would do without the given positions of {listed(given)}: give fewer of them, or as 'guess: true'."
        return mechanism.source.problem(owner, f"{what} by {gap} with the given positions", remedy)
    driven = [joint.name for joint in mechanism.joints.values() if joint.drive]
    also = f", what the drives of {listed(driven)} ask for at t = 0" if driven else ""
    remedy = (
        f"Check the lengths, points and axes of its parts{also}, and the positions from which to look ('guess: true')."
    )
    return mechanism.source.problem(owner, f"{what}, by {gap} at best", remedy)


def _against_drives(mechanism: Mechanism, owner: Location) -> Problem:
    driven = [joint.name for joint in mechanism.joints.values() if joint.drive]
    loop = _loop_of(mechanism, owner)
    what = f"the loop of {loop}" if loop else "this constraint"
    by = f"the drive of {listed(driven)}" if driven else "what changes with time"
    message = f"{what} leaves no freedom for {by}: the two contradict each other just after the start"
    return mechanism.source.problem(owner, message, "Remove a drive, or a constraint.")


def rigid(mechanism: Mechanism, rows: Sequence[Row], count: int) -> MechanismError:
    """A mechanism without any degree of freedom left of `count`."""
    owners = list(dict.fromkeys(row.owner for row in rows))
    names = listed([str(owner[1]) for owner in owners])
    message = f"nothing can move: the {len(rows)} equations of {names} leave none of {count} degrees of freedom"
    return MechanismError([mechanism.source.problem(owners[0], message, "Remove a joint or a constraint.")])


def unfitting(mechanism: Mechanism, rows: Sequence[Row], misses: Array, held: Array) -> MechanismError:
    """Given velocities, `held` (nv,), that miss the constraints by `misses` (m,) a second."""
    given = [name for name, kept in zip(mechanism.coordinate_names, held, strict=True) if kept]
    problems = []
    for owner, miss in _by_owner(rows, misses, 1.0):
        loop = _loop_of(mechanism, owner)
        what = f"the given velocities break {f'the loop of {loop}' if loop else 'this constraint'}"
        remedy = f"Give fewer of {listed(given)}: the others are found so that the kinetic energy is least."
        problems.append(mechanism.source.problem(owner, f"{what} (off by {miss} a second)", remedy))
    return MechanismError(problems)
