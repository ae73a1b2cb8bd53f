"""The search for a tree without ends that lack inertia: its results, compared with those of whole trees, and its effort."""

import json
from contextlib import suppress

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.builders.tree import EndSearch
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism import spanning_tree as end_inertia
from mbd_sim.mechanism.spanning_tree import inboard, loop_through, moves_no_inertia, spanning_tree
from test.generators.mechanisms import KINDS
from test.generators.overconstrained import LINKAGES, linkage_text

HINGE = {"type": "revolute", "axis": [0, 1, 0]}


def ends_without_inertia(parts, joints, tree):
    """The joints that move nothing but one part of a loop, which has no inertia in some motion of the joint.

    Such as a particle on the axis of a hinge. The coordinate of such a joint has no equation of motion of its own.
    """
    carriers = {inboard(joints[name], part) for name, part in tree.outboard.items()}
    closed = {part for name in tree.closing for part in (joints[name].parent, joints[name].child)}
    ends = [(joints[name], parts[part]) for name, part in tree.outboard.items() if part in closed - carriers]
    return [joint.name for joint, part in ends if not joint.drive and moves_no_inertia(joint, part)]


def by_whole_trees(search, tree, preferred, cut):
    """The same search; each time it starts from the beginning, and builds and examines the whole tree."""

    def ends(of):
        names = ends_without_inertia(search.parts, search.joints, of)
        return [name for name in names if name not in search.coupled and of.outboard[name] not in search.massive]

    def exchanges(of, at):
        carrier = {part: name for name, part in of.outboard.items()}
        for closing in of.closing:
            if closing not in cut and {search.joints[closing].parent, search.joints[closing].child} & at:
                loop = loop_through(carrier, search.joints, closing)
                yield from ((closing, name) for name in loop if name not in search.need_coordinates)

    def better(of):
        for closing, name in exchanges(of, {of.outboard[end] for end in ends(of)}):
            without = {*of.closing, name} - {closing}
            others = [each for each in preferred if each not in without]
            other = spanning_tree(search.parts, search.joints.values(), others, without)
            if without == {*other.closing} and len(ends(other)) < len(ends(of)):
                return other
        return None

    found = tree if tree.closing and any(part.mass for part in search.parts.values()) else None
    while found is not None and ends(found):
        found = better(found)
    return tree if found is None else found


@pytest.fixture
def compared(monkeypatch):
    """Compares each search with that of whole trees; the number of those that have found another tree."""
    improved, others = EndSearch.improved, []

    def both(search, tree, preferred, cut):
        found = improved(search, tree, preferred, cut)
        assert found == by_whole_trees(search, tree, preferred, cut)
        others.extend([found] if found is not tree else [])
        return found

    monkeypatch.setattr(EndSearch, "improved", both)
    return others


def random_graph(rng):
    """Rods and particles, connected by hinges at random, some of which are cut, guessed, driven or damped."""
    names = ["ground", *(f"p{n}" for n in range(int(rng.integers(2, 9))))]
    rod, particle = {"mass": 1, "inertia": [1, 1, 1]}, {"mass": 1}
    parts = {name: particle if rng.random() < 0.5 else rod for name in names[1:]}
    pairs = [(names[int(rng.integers(n))], name) for n, name in enumerate(names) if n]
    pairs += [tuple(rng.choice(names, 2, replace=False).tolist()) for _ in range(int(rng.integers(1, 6)))]
    extras = [{}] * 12 + [{"cut": True}, {"position": 0.3}, {"position": 0.3, "guess": True}, {"damping": 1}]
    joints = {}
    for index in rng.permutation(len(pairs)).tolist():
        joints[f"j{index}"] = HINGE | {"between": pairs[index]} | extras[int(rng.integers(len(extras)))]
    return {"mechanism": "graph", "parts": parts, "joints": joints}


def test_the_tree_of_random_hinges_is_that_of_the_search_in_whole_trees(compared):
    rng = np.random.default_rng(5)
    for _ in range(25):
        with suppress(MechanismError):  # a joint cannot be cut, which is found after the search
            parse_mechanism(json.dumps(random_graph(rng)))
    assert len(compared) > 6


@pytest.mark.parametrize("name", LINKAGES)
def test_the_tree_of_a_linkage_is_that_of_the_search_in_whole_trees(name, compared):
    parse_mechanism(linkage_text(name, 0, driven=False))


def test_the_tree_of_each_shipped_mechanism_is_that_of_the_search_in_whole_trees(compared):
    for name in KINDS:
        load_mechanism(name)


def many_loops(count):
    """Four-bar linkages, each with a particle between its coupler and its rocker."""
    rod = {"mass": 1, "inertia": [1, 1, 1]}
    parts = {f"{kind}{n}": {"mass": 1} if kind == "b" else rod for n in range(count) for kind in "abc"}
    joints = {}
    for n in range(count):
        for kind, ends in enumerate([("ground", "a"), ("a", "b"), ("b", "c"), ("c", "ground")]):
            between = [end if end == "ground" else f"{end}{n}" for end in ends]
            joints[f"j{n}_{kind}"] = HINGE | {"between": between}
    return json.dumps({"mechanism": "loops", "parts": parts, "joints": joints})


def test_the_effort_grows_linearly_with_the_number_of_loops(monkeypatch):
    examined, measure = [], end_inertia._least_inertia
    monkeypatch.setattr(end_inertia, "_least_inertia", lambda *given: (examined.append(None), measure(*given))[1])
    efforts = []
    for count in (5, 10, 20):
        examined.clear()
        found = parse_mechanism(many_loops(count))
        assert list(found.closing) == [f"j{n}_0" for n in range(count)]
        efforts.append(len(examined) / count)
    assert efforts[0] == efforts[1] == efforts[2] <= 5.0
