"""Branches of the spanning tree that have the same joints, such as four legs; a kernel computes them in vectors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from mbd_sim.dynamics.kinematics.links import Link

STATE, INPUTS = 1, 2  # the arguments of the rates
Shape: TypeAlias = tuple[object, ...]


def like_branches(links: Sequence[Link], nq: int) -> list[list[list[tuple[int, int]]]]:
    """Groups of branches that start at the same link and have joints of the same types in the same places.

    Joints without coordinates are passed over. A branch within a branch of a group belongs to that group.

    :param nq: the number of coordinates in the state.
    :return: for each group its branches, and of these the coordinates, speeds and efforts of their joints, each as the
        argument of the rates and the component, in the same order in all branches of a group.
    """
    outboard: dict[int, list[int]] = {}
    for index, link in enumerate(links):
        inboard = link.parent
        while inboard >= 0 and not _moves(links[inboard]):
            inboard = links[inboard].parent
        if _moves(link):
            outboard.setdefault(inboard, []).append(index)
    shapes: dict[int, Shape] = {}
    for index in reversed(range(len(links))):  # links are in order from ground outward
        shapes[index] = (links[index].joint.type, *(shapes[child] for child in outboard.get(index, ())))
    groups, waiting = [], [-1]
    while waiting:
        children = outboard.get(waiting.pop(), ())
        alike: dict[Shape, list[int]] = {}
        for child in children:
            alike.setdefault(shapes[child], []).append(child)
        for branches in alike.values():
            if len(branches) > 1:
                groups.append([_components(links, outboard, root, nq) for root in branches])
            else:
                waiting += branches
    return groups


def _moves(link: Link) -> bool:
    """Whether a link's joint has coordinates."""
    return link.joint.kind.nv > 0 and not link.joint.drive


def _components(links: Sequence[Link], outboard: dict[int, list[int]], root: int, nq: int) -> list[tuple[int, int]]:
    """The arguments and components that belong to the branch from a link outward: see `like_branches`."""
    found, waiting = [], [root]
    while waiting:
        index = waiting.pop()
        q, u = (range(span.start, span.stop) for span in (links[index].q, links[index].u))
        found += [*((STATE, i) for i in q), *((STATE, nq + i) for i in u), *((INPUTS, i) for i in u)]
        waiting += outboard.get(index, ())
    return found
