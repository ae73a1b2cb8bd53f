"""Which of the joints that are offered a mechanism gets, and what holds the parts that have none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mbd_sim.base.errors import InputError, listed, nearest, quoted
from mbd_sim.imports.assembly import CadAssembly, ImportedPart
from mbd_sim.imports.joints import NEED_AXIS, OFFERED, WORDS, Candidate
from mbd_sim.mechanism.elements.joint_types import JointType
from mbd_sim.mechanism.values.names import split_assignment

NONE = "none"


@dataclass(frozen=True)
class Choice:
    """The type of joint of each candidate that was chosen, by its number, and the parts that are held by ground.

    `held` has one part for each group of connected parts: the first one is that which the user, or its size, made
    ground; the others are held only because no joint connects them to it. `is_free` if no part is ground.
    """

    types: Mapping[int, JointType]
    held: tuple[str, ...]
    is_free: bool = False


def choose(
    assembly: CadAssembly, candidates: Sequence[Candidate], every: bool, picks: Sequence[str], ground: str | None
) -> Choice:
    """The choice of a user.

    :param every: all candidates become the joint that their faces leave, unless `picks` say otherwise.
    :param picks: each a number or a name of a candidate, perhaps with `=` and the type of its joint, or `none`.
    :param ground: the part that does not move, by default the one with the largest box; `none`: no part.
    :raises InputError: a candidate, a type or a part does not exist, or the two do not fit.
    """
    types: dict[int, JointType | None] = {one.number: one.type for one in candidates if every}
    for pick in picks:
        candidate, kind = _picked(pick, candidates)
        types[candidate.number] = kind
    chosen = {number: kind for number, kind in types.items() if kind is not None}
    names = [part.name for part in assembly.parts]
    if ground not in (None, NONE, *names):
        raise InputError(f"--ground {ground}: no part is called so", nearest(str(ground), [*names, NONE]))
    first = _largest(assembly.parts) if ground in (None, NONE) else str(ground)
    groups = _connected(names, [one.parts for one in candidates if one.number in chosen])
    own = next(group for group in groups if first in group)
    by_name = {part.name: part for part in assembly.parts}
    others = [_largest([by_name[name] for name in group]) for group in groups if group is not own]
    return Choice(chosen, (first, *others), ground == NONE)


def _picked(pick: str, candidates: Sequence[Candidate]) -> tuple[Candidate, JointType | None]:
    name, word = split_assignment(pick)
    numbers = {str(one.number): one for one in candidates} | {one.name: one for one in candidates}
    candidate = numbers.get(name)
    if candidate is None:
        known = f"They are numbered 1 to {len(candidates)}." if candidates else "None were found."
        remedy = known if name.isdecimal() else nearest(name, [one.name for one in candidates]) or known
        raise InputError(f"--joint {pick}: no joint {quoted(name)} is offered", remedy)
    if word == NONE:
        return candidate, None
    if not word:
        if candidate.type is None:
            message = f"--joint {pick}: no joint has the freedom that the faces of {listed(candidate.parts)} leave"
            raise InputError(message, f"Choose one: --joint {name}=hinge.")
        return candidate, candidate.type
    kind = WORDS.get(word, word)
    if kind not in OFFERED:
        raise InputError(f"--joint {pick}: unknown joint {quoted(word)}", nearest(word, [*WORDS, *OFFERED, NONE]))
    if kind in NEED_AXIS and candidate.axis is None:
        message = f"--joint {pick}: {listed(candidate.parts)} share no axis"
        raise InputError(message, f"Choose ball, fixed or none for joint {candidate.number}.")
    return candidate, kind


def _largest(parts: Sequence[ImportedPart]) -> str:
    """The part with the largest box; the first of several."""
    sizes = {}
    for part in parts:
        corners = part.triangles().reshape(-1, 3)
        sizes[part.name] = float((corners.max(axis=0) - corners.min(axis=0)).prod())
    return max(sizes, key=lambda name: sizes[name])


def _connected(names: Sequence[str], pairs: Sequence[tuple[str, str]]) -> list[set[str]]:
    """The parts in groups that pairs connect."""
    group_of = {name: {name} for name in names}
    for one, other in pairs:
        if group_of[one] is not group_of[other]:
            joined = group_of[one] | group_of[other]
            for name in joined:
                group_of[name] = joined
    return list({id(group): group for group in group_of.values()}.values())
