"""Chooses the joints of the spanning tree, and reports joints and parts that do not fit into one."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace

from mbd_sim.errors import Problem, listed
from mbd_sim.mechanism.end_inertia import moves_no_inertia
from mbd_sim.mechanism.records import GROUND, Joint, Part
from mbd_sim.mechanism.source import Source
from mbd_sim.mechanism.spanning_tree import SpanningTree, spanning_tree
from mbd_sim.mechanism_file.builders.end_search import EndSearch


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
    preferred, cut = _by_priority(joints.values(), needed), _to_cut(joints.values())
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


def _to_cut(joints: Iterable[Joint]) -> set[str]:
    return {joint.name for joint in joints if joint.cut}


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
