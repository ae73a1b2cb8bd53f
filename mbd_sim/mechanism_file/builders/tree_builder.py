"""Chooses the joints of the spanning tree, and reports joints and parts that do not fit into one."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from mbd_sim.errors import Problem, listed
from mbd_sim.mechanism.end_inertia import ends_without_inertia
from mbd_sim.mechanism.records import Joint, Part
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism.spanning_tree import SpanningTree, loop_of, spanning_tree


def build_tree(
    parts: Mapping[str, Part],
    joints: Mapping[str, Joint],
    coupled: Collection[str],
    named: Collection[str],
    massive: Collection[str],
    source: Source,
) -> tuple[SpanningTree, list[Problem]]:
    """The spanning tree of a mechanism, and the problems found.

    :param coupled: the joints whose coordinates a coupling or an actuator refers to; they need their coordinates.
    :param named: those that the expression of a force names, which need them too.
    :param massive: the parts to which springs with mass are attached.
    """
    needed = {joint.name: _needs_coordinate(joint, coupled, named) for joint in joints.values()}
    preferred, cut = _by_priority(joints.values(), needed), _to_cut(joints.values())
    tree = spanning_tree(parts, joints.values(), preferred, cut)
    stay = {name for name, joint in joints.items() if needed[name] or _has_given_start(joint) or joint.type == "free"}
    tree = _EndSearch(parts, joints, stay, coupled, massive).improved(tree, preferred, cut)
    problems = [problem for name in tree.closing for problem in _cannot_close(source, joints[name], needed[name])]
    problems += [_cannot_be_cut(source, joint) for joint in joints.values() if joint.cut and joint.name in tree.joints]
    problems += _unconnected(source, tree.unreached, joints.values())
    return tree, problems


@dataclass(frozen=True, eq=False)
class _EndSearch:
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
        found, ends = tree, self._ends(tree) if tree.closing and any(part.mass for part in self.parts.values()) else []
        while ends:
            for closing, name in self._exchanges(found, ends):
                without = {*found.closing, name} - {closing}
                others = [each for each in preferred if each not in without]
                other = spanning_tree(self.parts, self.joints.values(), others, without)
                remaining = self._ends(other)
                if closing not in cut and without == {*other.closing} and len(remaining) < len(ends):
                    found, ends = other, remaining
                    break
            else:
                return tree
        return found

    def _exchanges(self, tree: SpanningTree, ends: Collection[str]) -> Iterator[tuple[str, str]]:
        """The joints that close loops at these ends, each with those of its loop that can be cut in its place."""
        at = {tree.outboard[name] for name in ends}
        for closing in tree.closing:
            if self.joints[closing].parent in at or self.joints[closing].child in at:
                for name in loop_of(tree, self.joints, closing):
                    if name not in self.need_coordinates:
                        yield closing, name

    def _ends(self, tree: SpanningTree) -> list[str]:
        names = ends_without_inertia(self.parts, self.joints, tree)
        return [name for name in names if name not in self.coupled and tree.outboard[name] not in self.massive]


def _by_priority(joints: Collection[Joint], needed: Mapping[str, str]) -> list[str]:
    """The joints that should have coordinates; those that require them come first."""
    candidates = [joint for joint in joints if not joint.cut]
    preferred = [joint.name for joint in candidates if needed[joint.name]]
    preferred += [joint.name for joint in candidates if _has_given_start(joint)]
    preferred += [joint.name for joint in candidates if joint.position.any()]
    return preferred


def _has_given_start(joint: Joint) -> bool:
    return any(joint.fixed_in_assembly + joint.fixed_speeds)


def _to_cut(joints: Iterable[Joint]) -> set[str]:
    return {joint.name for joint in joints if joint.cut}


def _needs_coordinate(joint: Joint, coupled: Collection[str], named: Collection[str]) -> str:
    """The keys of a joint that refer to its coordinate, as a list in words; empty if there are none."""
    has = {
        "a drive": bool(joint.drive),
        "stiffness": bool(joint.stiffness.any()),
        "damping": bool(joint.damping.any()),
        "a spring": joint.spring is not None,
        "a damper": joint.damper is not None,
        "friction": joint.friction is not None,
        "limits": bool(joint.limits),
        "an effort_limit": joint.effort_limit is not None,
        "a coupling or an actuator": joint.name in coupled,
        "a force that depends on it": joint.name in named,
    }
    return listed([what for what, true in has.items() if true])


def _cannot_close(source: Source, joint: Joint, keys: str) -> Iterator[Problem]:
    """Why a joint cannot close a loop, if it cannot; `keys` are those that refer to its coordinate."""
    where: Location = ("joints", joint.name)
    if keys:
        remedy = "Cut another joint of its loop, one that needs no coordinate, with 'cut: true'."
        yield source.problem(where, f"closes a loop, and so has no coordinate, but has {keys}", remedy)
    elif _has_given_start(joint):
        message = "closes a loop, and so has no coordinate whose start value could be given"
        remedy = "Give start values for other joints of the loop, or write 'guess: true'."
        yield source.problem(where, message, remedy)
    elif joint.type == "free":
        yield source.problem(where, "a free joint restricts nothing: it cannot close a loop", "Remove it.")


def _cannot_be_cut(source: Source, joint: Joint) -> Problem:
    message = "cannot be cut: no other joint connects the parts beyond it to ground, or its loop is cut already"
    return source.problem(("joints", joint.name, "cut"), message, "Remove 'cut', or cut one joint of each loop.")


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
