"""Why a mechanism cannot start: which loop stays open and by how much, and what contradicts what."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.dynamics.rows import Row
from mbd_sim.errors import MechanismError, Problem, listed
from mbd_sim.mechanism.model import Array, Mechanism
from mbd_sim.mechanism.source import Location

_GUESS = "Give the joints positions nearer to how it looks, with 'guess: true'."


def open_loops(mechanism: Mechanism, rows: Sequence[Row], gaps: Array, size: float, held_back: bool) -> MechanismError:
    """Loops and constraints that cannot be closed; `held_back` where they could without the given positions."""
    problems = [_open_loop(mechanism, owner, gap, held_back) for owner, gap in _by_owner(rows, gaps, size)]
    if not problems:
        problems = [mechanism.source.problem((), "the loops close only with an axis turned over", _GUESS)]
    return MechanismError(problems)


def contradiction(mechanism: Mechanism, rows: Sequence[Row], defects: Array, size: float) -> MechanismError:
    """Drives that ask for what the constraints forbid."""
    return MechanismError([_against_drives(mechanism, owner) for owner, _ in _by_owner(rows, defects, size)])


def _by_owner(rows: Sequence[Row], defects: Array, size: float) -> list[tuple[Location, float]]:
    """The joints and constraints whose rows are off, with how much, the worst first."""
    found: dict[Location, float] = {}
    for row, defect in zip(rows, defects, strict=True):
        found[row.owner] = float(np.hypot(found.get(row.owner, 0.0), defect))
    worst = max(found.values(), default=0.0)
    off = [(owner, value) for owner, value in found.items() if value > max(1e-3 * worst, 1e-10 * size)]
    return sorted(off, key=lambda pair: -pair[1])


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


def _open_loop(mechanism: Mechanism, owner: Location, gap: float, held_back: bool) -> Problem:
    loop = _loop_of(mechanism, owner)
    what = f"the loop of {loop} stays open here" if loop else "this constraint cannot be met"
    if held_back:
        given = [joint.name for joint in mechanism.joints.values() if any(joint.held)]
        remedy = f"It can be without the given positions of {listed(given)}: give fewer of them, or as 'guess: true'."
        return mechanism.source.problem(owner, f"{what} by {gap:.3g} with the given positions", remedy)
    remedy = "Check the lengths and points of its parts, and the positions from which to look ('guess: true')."
    return mechanism.source.problem(owner, f"{what}, by {gap:.3g} at best", remedy)


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
        problems.append(mechanism.source.problem(owner, f"{what} (off by {miss:.3g} per second)", remedy))
    return MechanismError(problems)
