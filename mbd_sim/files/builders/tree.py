"""Chooses the joints of the spanning tree, and reports joints and parts that do not fit into one.

Loops are cut so that the parts at the ends of the tree have inertia in their joints.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from mbd_sim.base.errors import Problem, listed
from mbd_sim.mechanism.elements.parts import GROUND, Joint, Part
from mbd_sim.mechanism.spanning_tree import SpanningTree, inboard, loop_through, moves_no_inertia, spanning_tree
from mbd_sim.mechanism.values.source import Source


@dataclass(frozen=True, eq=False)
class EndSearch:
    """Finds a tree whose parts at the ends of branches all have inertia in their joints, if cutting others does it.

    Joints that `need_coordinates` are not cut. Those with actuators are not examined, nor the parts with `massive`
    springs: what adds inertia there belongs to no part.
    """

    parts: Mapping[str, Part]
    joints: Mapping[str, Joint]
    need_coordinates: Collection[str]
    coupled: Collection[str]
    massive: Collection[str]

    def improved(self, tree: SpanningTree, preferred: Sequence[str], cut: Collection[str]) -> SpanningTree:
        """The given tree if all is well with it, or if there is no better one; joints in `cut` stay cut."""
        if not tree.closing or not any(part.mass for part in self.parts.values()):
            return tree
        branches = _Branches(self.joints, tree, cache(self._lacks_inertia))
        if not branches.ends or not self._exchange_all(branches, cut):
            return tree
        others = [name for name in preferred if name not in branches.closing]
        return spanning_tree(self.parts, self.joints.values(), others, branches.closing)

    def _exchange_all(self, branches: _Branches, cut: Collection[str]) -> bool:
        """Exchange joints, always the first two that leave fewer ends; False if some ends remain."""
        hopeless: dict[str, set[str]] = {}  # joints that have been tried in vain, with the parts of their loops
        while branches.ends:
            for closing in [name for name in self.joints if name in branches.closing]:
                if closing in cut or closing in hopeless or not branches.ends & self._parts_of(closing):
                    continue
                loop = branches.loop(closing)
                names = [name for name in loop if name not in self.need_coordinates]
                better = next((name for name in names if branches.has_fewer_ends(closing, name)), None)
                if better is not None:
                    branches.exchange(closing, better)
                    changed = (self._parts_of(closing) | self._parts_of(better)) - {GROUND}
                    hopeless = {name: parts for name, parts in hopeless.items() if parts.isdisjoint(changed)}
                    break
                hopeless[closing] = set().union(*map(self._parts_of, [closing, *loop]))
            else:
                return False
        return True

    def _parts_of(self, name: str) -> set[str]:
        return {self.joints[name].parent, self.joints[name].child}

    def _lacks_inertia(self, name: str, part: str) -> bool:
        """Whether a joint at the end of a branch would move this part without inertia."""
        joint = self.joints[name]
        examined = not joint.drive and name not in self.coupled and part not in self.massive
        return examined and moves_no_inertia(joint, self.parts[part])


class _Branches:
    """A spanning tree in which joints take the place of `closing` ones; each time only what changes is examined.

    `ends` are the parts of loops at the ends of its branches that lack inertia in their joints.
    """

    def __init__(
        self, joints: Mapping[str, Joint], tree: SpanningTree, lacks_inertia: Callable[[str, str], bool]
    ) -> None:
        self._joints, self._lacks_inertia = joints, lacks_inertia
        self._carrier = {part: name for name, part in tree.outboard.items()}
        self.closing = set(tree.closing)
        self._inside: dict[str, set[str]] = {part: set() for part in [GROUND, *self._carrier]}
        self._closing_at: dict[str, set[str]] = {part: set() for part in self._inside}
        for names, at in ((tree.joints, self._inside), (tree.closing, self._closing_at)):
            for name in names:
                at[joints[name].parent].add(name)
                at[joints[name].child].add(name)
        self.ends = {part for part in self._carrier if self._is_end(part)}

    def loop(self, closing: str) -> list[str]:
        """The joints of the tree that form a loop with a closing joint."""
        return loop_through(self._carrier, self._joints, closing)

    def has_fewer_ends(self, closing: str, name: str) -> bool:
        """Whether fewer ends lack inertia with the closing joint in the tree in place of another one of its loop."""
        before = len(self._ends_at(closing, name))
        self._swap(closing, name)
        after = len(self._ends_at(closing, name))
        self._swap(name, closing)
        return after < before

    def exchange(self, closing: str, name: str) -> None:
        """Take the closing joint into the tree, and cut another one of its loop."""
        self.ends -= self._ends_at(closing, name)
        self._swap(closing, name)
        self.ends |= self._ends_at(closing, name)
        self.closing ^= {closing, name}
        self._carry(closing, name)

    def _carry(self, closing: str, name: str) -> None:
        """Reverse the joints between the closing one, which carries them now, and the one that has carried them."""
        first, second = self._joints[closing].parent, self._joints[closing].child
        part = first if self._is_on_way(name, first) else second
        new = closing
        while new != name:
            new, self._carrier[part] = self._carrier[part], new
            part = inboard(self._joints[new], part)

    def _is_on_way(self, name: str, part: str) -> bool:
        """Whether a joint is between a part and ground."""
        while part != GROUND and self._carrier[part] != name:
            part = inboard(self._joints[self._carrier[part]], part)
        return part != GROUND

    def _swap(self, added: str, cut: str) -> None:
        for name, to, out_of in ((added, self._inside, self._closing_at), (cut, self._closing_at, self._inside)):
            for part in (self._joints[name].parent, self._joints[name].child):
                to[part].add(name)
                out_of[part].discard(name)

    def _ends_at(self, *names: str) -> set[str]:
        parts = {part for name in names for part in (self._joints[name].parent, self._joints[name].child)}
        return {part for part in parts if part != GROUND and self._is_end(part)}

    def _is_end(self, part: str) -> bool:
        if len(self._inside[part]) > 1 or not self._closing_at[part]:
            return False
        (carrier,) = self._inside[part]
        return self._lacks_inertia(carrier, part)


def build_tree(
    parts: Mapping[str, Part],
    joints: Mapping[str, Joint],
    coupled: Collection[str],
    named: Collection[str],
    measured: Collection[str],
    massive: Collection[str],
    source: Source,
) -> tuple[SpanningTree, list[Problem]]:
    """The spanning tree of a mechanism, and the problems found.

    :param coupled: the joints whose coordinates a coupling or an actuator refers to; they need their coordinates.
    :param named: those that the expression of a force names, which need them too.
    :param measured: those whose coordinates sensors measure.
    :param massive: the parts to which springs with mass are attached.
    """
    needed = {joint.name: _needs_coordinate(joint, coupled, named) for joint in joints.values()}
    preferred, cut = _by_priority(joints.values(), needed), {joint.name for joint in joints.values() if joint.cut}
    tree = spanning_tree(parts, joints.values(), preferred, cut)
    free = {name for name, joint in joints.items() if joint.type == "free"}
    stay = free | {name for name, joint in joints.items() if needed[name] or _has_given_start(joint)}
    for kept in (stay, free) if stay != free else (free,):
        tree = EndSearch(parts, joints, kept, coupled, massive).improved(tree, preferred, cut)
    with_coordinates = {name for name in tree.closing if needed[name] or name in measured}
    problems = [_restricts_nothing(source, name) for name in tree.closing if name in free - with_coordinates]
    with_coordinates |= {name for name in tree.closing if _has_given_start(joints[name])}
    split = {name: _split_part(parts, joints[name]) for name in tree.closing if name in with_coordinates}
    problems += [_cannot_be_cut(source, joint) for joint in joints.values() if joint.cut and joint.name in tree.joints]
    problems += _unconnected(source, tree.unreached, joints.values())
    return replace(tree, split=split), problems


def _by_priority(joints: Collection[Joint], needed: Mapping[str, bool]) -> list[str]:
    """The joints that should have coordinates; those that require them come first."""
    candidates = [joint for joint in joints if not joint.cut]
    preferred = [joint.name for joint in candidates if needed[joint.name]]
    preferred += [joint.name for joint in candidates if _has_given_start(joint)]
    preferred += [joint.name for joint in candidates if joint.position.any()]
    return preferred


def _has_given_start(joint: Joint) -> bool:
    return any(joint.fixed_in_assembly + joint.fixed_speeds)


def _needs_coordinate(joint: Joint, coupled: Collection[str], named: Collection[str]) -> bool:
    """Whether something refers to the coordinates of a joint."""
    of_laws = joint.spring or joint.damper or joint.friction or joint.effort_limit is not None
    of_numbers = joint.stiffness.any() or joint.damping.any()
    return bool(joint.drive or joint.limits or of_laws or of_numbers or joint.name in coupled or joint.name in named)


def _split_part(parts: Mapping[str, Part], joint: Joint) -> str:
    """The part of a joint of which the joint carries a piece: the second one, unless only the first has inertia."""
    ends = [name for name in (joint.child, joint.parent) if name != GROUND]
    return next((name for name in ends if not moves_no_inertia(joint, parts[name])), ends[0])


def _restricts_nothing(source: Source, name: str) -> Problem:
    return source.problem(("joints", name), "a free joint restricts nothing: it cannot close a loop", "Remove it.")


def _cannot_be_cut(source: Source, joint: Joint) -> Problem:
    message = "cannot be cut: no other joint connects the parts beyond it to ground, or its loop is cut already"
    return source.problem(("joints", joint.name, "cut"), message, "Remove 'cut', or cut one joint of each loop.")


def unconnected(parts: Mapping[str, Part], joints: Mapping[str, Joint], source: Source) -> list[Problem]:
    """The problems of parts that no joints connect to ground."""
    return [*_unconnected(source, spanning_tree(parts, joints.values(), (), ()).unreached, joints.values())]


def _unconnected(source: Source, names: Iterable[str], joints: Iterable[Joint]) -> Iterator[Problem]:
    joints_of: dict[str, list[str]] = {}
    for joint in joints:
        for part in (joint.parent, joint.child):
            joints_of.setdefault(part, []).append(joint.name)
    remedy = (
        "Connect it with a joint; for a part that moves freely, add a joint of type free between ground and the part."
    )
    for name in names:
        message = "is not connected by any joint"
        if name in joints_of:
            message = f"is connected only by {listed(joints_of[name])}, which does not lead to ground"
        yield source.problem(("parts", name), message, remedy)
