"""Chooses the joints of the spanning tree, and reports joints and parts that do not fit into one."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from mbd_sim.errors import Problem, listed
from mbd_sim.mechanism.records import Joint, Part
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism.spanning_tree import SpanningTree, spanning_tree
from mbd_sim.mechanism_file.builders.end_search import EndSearch


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
    tree = EndSearch(parts, joints, stay, coupled, massive).improved(tree, preferred, cut)
    problems = [problem for name in tree.closing for problem in _cannot_close(source, joints[name], needed[name])]
    problems += [_cannot_be_cut(source, joint) for joint in joints.values() if joint.cut and joint.name in tree.joints]
    problems += _unconnected(source, tree.unreached, joints.values())
    return tree, problems


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
