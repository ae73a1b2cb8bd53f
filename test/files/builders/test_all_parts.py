"""`all` in contacts: which parts it stands for, on a plane and among each other."""

import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism

TEXT = """
mechanism: chain
parts:
  base: {shape: {type: sphere, mass: 1, radius: 0.01}}
  a: {shape: {type: sphere, mass: 1, radius: 0.01}}
  b: {shape: {type: sphere, mass: 1, radius: 0.01}}
  tip: {mass: 0, collisions: [{type: sphere, radius: 0.01}]}
  c: {shape: {type: cylinder, mass: 1, radius: 0.01, length: 0.1}}
  ghost: {mass: 1, inertia: [1, 1, 1], shape: {type: sphere, radius: 0.01}, collisions: []}
joints:
  weld: {type: fixed, between: [ground, base]}
  first: {type: revolute, between: [base, a], axis: [0, 1, 0]}
  second: {type: revolute, between: [a, b], axis: [0, 1, 0]}
  nail: {type: fixed, between: [b, tip]}
  third: {type: revolute, between: [tip, c], axis: [0, 1, 0]}
  free: {type: free, between: [ground, ghost]}
contacts: {k: CONTACT}
"""


def chain(contact):
    return parse_mechanism(TEXT.replace("CONTACT", contact))


def names(contact):
    return list(dict.fromkeys(each.names[0] for each in chain(contact).contacts))


def test_all_parts_on_a_plane_are_those_that_move_and_have_shapes():
    assert names("{parts: all, plane: ground}") == ["a", "b", "tip", "c"]
    assert names("{parts: all, plane: tip}") == ["a", "c"]
    assert names("{parts: all, without: [tip, c], plane: ground}") == ["a", "b"]


def test_neighbors_do_not_touch_among_all():
    """Those that a joint connects, directly or through welded parts; base is welded to ground, which has no neighbors."""
    pairs = {contact.names for contact in chain("{among: all}").contacts}
    assert pairs == {("base", "a"), ("base", "b"), ("base", "tip"), ("base", "c"), ("a", "c")}


def test_shapes_that_cannot_touch_each_other_are_named_in_a_remark():
    text = TEXT.replace("sphere, mass: 1, radius: 0.01", "particle, mass: 1")
    mechanism = parse_mechanism(text.replace("CONTACT", "{among: all}"))
    assert ("base", "a") not in {contact.names for contact in mechanism.contacts}
    assert any("cannot touch each other: base and a, base and b" in remark for remark in mechanism.source.remarks)


@pytest.mark.parametrize(
    ("contact", "message"),
    [
        ("{parts: all, without: [tips], plane: ground}", "there is no part 'tips'"),
        ("{parts: [a], without: [b], plane: ground}", "without has no effect"),
        ("{parts: every, plane: ground}", "all"),
        ("{among: [a]}", "several parts"),
    ],
)
def test_mistakes_are_reported(contact, message):
    with pytest.raises(MechanismError, match=message):
        chain(contact)


def test_contacts_may_wait():
    assert not chain("{parts: all, plane: ground, active: false}").contacts
