"""Cuts loops so that the parts at the ends of the spanning tree have inertia in their joints."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from mbd_sim.mechanism.end_inertia import inboard, moves_no_inertia
from mbd_sim.mechanism.records import GROUND, Joint, Part
from mbd_sim.mechanism.spanning_tree import SpanningTree, loop_through, spanning_tree


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
