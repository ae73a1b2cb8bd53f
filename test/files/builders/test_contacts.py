"""What may be wrong with the contacts of a file, and what they become."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.contents import one_sided_names
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.contacts import Ball, Barrel, Cam, ComplianceLaw, Face, Rim

TEXT = """
mechanism: bodies
ground: {points: {wall: {at: [1, 0, 0], rotate: {axis: [0, 1, 0], angle: -90 deg}}}}
parts:
  ball: {shape: {type: sphere, mass: 1, radius: 0.1, at: [0, 0, 0.2]}}
  box: {shape: {type: block, mass: 1, size: [1, 2, 3]}}
  pipe:
    shapes:
      - {type: cylinder, density: 1000, radius: 0.5, length: 1, name: outer}
      - {type: cylinder, density: 1000, radius: 0.4, length: 1, hole: true, name: bore}
  rod: {shape: {type: rod, mass: 1, to: [0, 0, 1]}, points: {tip: [0, 0, 1]}}
  drop: {shape: {type: particle, mass: 1, radius: 0.05}}
  coin: {shape: {type: disc, mass: 1, radius: 0.3, axis: [0, 1, 0]}}
  frame: {mass: 1, inertia: [1, 1, 1], points: {p: [0, 0, 0]}}
joints:
  J: {type: free, between: [ground, J]}
contacts:
  k: CONTACT
"""
PARTS = ("ball", "box", "pipe", "rod", "drop", "coin", "frame")
JOINTS = "\n".join(
    f"  {name}: {{type: free, between: [ground, {name}], position: [{5 * n}, 0, 9]}}" for n, name in enumerate(PARTS)
)
TEXT = TEXT.replace("  J: {type: free, between: [ground, J]}", JOINTS)
LINE = 1 + next(number for number, line in enumerate(TEXT.splitlines()) if "CONTACT" in line)


def contacts(contact):
    return parse_mechanism(TEXT.replace("CONTACT", contact)).contacts


MISTAKES = {
    "no partners": ("{friction: 1}", "contacts.k", "has nothing to be in contact", "'between' two parts"),
    "parts alone": ("{parts: [ball]}", "contacts.k", "has parts", "on a 'plane'"),
    "two ways": ("{between: [ball, box], among: [ball, box]}", "contacts.k", "has between and among", ""),
    "negative friction": ("{parts: [ball], plane: ground, friction: -0.1}", "contacts.k.friction", "must be at least 0", ""),
    "restitution above 1": ("{parts: [ball], plane: ground, restitution: 1.5}", "contacts.k.restitution", "must be at most 1", ""),
    "static below sliding": ("{parts: [ball], plane: ground, friction: 0.3, static_friction: 0.2}", "contacts.k", "static_friction 0.2 is less than friction 0.3", ""),
    "a part that is not there": ("{parts: [bal], plane: ground}", "contacts.k.parts[0]", "there is no part 'bal'", "'ball'"),
    "a shape that is not there": ("{between: [ball, pipe.bored]}", "contacts.k.between[1]", "'pipe' has no shape or point 'bored'", "bore"),
    "a part without shapes": ("{parts: [frame], plane: ground}", "contacts.k.parts[0]", "'frame' has no shape", "one of its points"),
    "a plane that is not there": ("{parts: [ball], plane: ground.wal}", "contacts.k.plane", "'ground' has no point 'wal'", "wall"),
    "a part with itself": ("{between: [rod, rod.tip]}", "contacts.k.between[1]", "'rod' cannot be in contact with itself", "Name different parts."),
    "a part on its own plane": ("{parts: [box, ball], plane: ball}", "contacts.k.parts[1]", "'ball' cannot be in contact with itself", ""),
    "a block inside a ball": ("{between: [box, ball], inside: true}", "contacts.k.between[1]", "a sphere cannot enclose a block", "several blocks"),
    "a thin rod and a point": ("{between: [rod, drop]}", "contacts.k.between[1]", "rod and drop have no thickness", "a radius"),
    "a compliant block": ("{between: [ball, box], stiffness: 1e5}", "contacts.k.stiffness", "only spheres, points, cylinders, discs and rings can have a 'stiffness'", "Remove 'stiffness'"),
    "a block on a cam": ("{parts: [box], cam: coin, profile: 0.1}", "contacts.k.parts[0]", "a block cannot be in contact with a cam", ""),
    "two points": ("{between: [drop, rod.tip]}", "contacts.k.between[1]", "two points cannot touch", "a shape with a radius"),
    "too large inside": ("{between: [pipe.outer, coin], inside: true}", "contacts.k.between[1]", "is not less than 0.3 m of coin", "exchange them"),
    "a pipe in a ball": ("{between: [coin, ball], inside: true}", "contacts.k.between[1]", "a sphere cannot enclose a disc", ""),
    "a cam without profile": ("{parts: [ball], cam: coin}", "contacts.k", "cam and profile belong together", ""),
    "an unknown name in a profile": ("{parts: [ball], cam: coin, profile: 0.1 + phi}", "contacts.k.profile", "unknown name 'phi'", "angle"),
    "restitution of a compliant contact": ("{parts: [ball], plane: ground, stiffness: 1e5, restitution: 0.5}", "contacts.k", "has stiffness and restitution", "remove 'restitution'"),
    "damping of a rigid contact": ("{parts: [ball], plane: ground, damping: 0.5}", "contacts.k", "damping has no effect in a rigid contact", "remove 'damping'"),
    "a normal without a plane": ("{between: [ball, coin], normal: [1, 0, 0]}", "contacts.k", "normal has no effect without a plane", ""),
    "inside among": ("{among: [ball, coin], inside: true}", "contacts.k", "inside needs two parts", ""),
}  # fmt: skip


@pytest.mark.parametrize(("contact", "key", "message", "remedy"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_reported_with_line_key_and_remedy(contact, key, message, remedy):
    with pytest.raises(MechanismError) as caught:
        contacts(contact)
    (problem,) = caught.value.problems
    assert (problem.key, problem.line) == (key, LINE)
    assert message in problem.message
    assert remedy in problem.remedy


def test_shapes_become_the_bodies_that_can_touch_a_plane():
    found = contacts("{parts: [ball, box, pipe.outer, rod, drop, coin, frame.p], plane: ground.wall, friction: 0.2}")
    kinds = [type(contact.first) for contact in found]
    assert kinds == [Ball, *[Ball] * 8, Rim, Rim, Ball, Ball, Ball, Rim, Ball]
    assert all(isinstance(contact.second, Face) and contact.names[1] == "ground.wall" for contact in found)
    assert found[0].second.normal == pytest.approx([-1, 0, 0])
    assert (found[0].first.radius, found[0].first.at.point.tolist()) == (0.1, [0, 0, 0.2])
    assert {tuple(np.abs(contact.first.at.point)) for contact in found[1:9]} == {(0.5, 1.0, 1.5)}
    assert [contact.first.at.point[2] for contact in found[9:11]] == [-0.5, 0.5]
    assert found[0].law == ContactLaw(0.0, 0.2, 0.2)
    assert len({contact.quantity for contact in found}) == len(found)


def test_a_list_of_parts_has_all_pairs():
    found = contacts("{among: [ball, pipe.outer, coin, rod.tip]}")
    assert [contact.quantity for contact in found] == [
        "ball on pipe_outer", "ball on coin", "ball on rod_tip", "pipe_outer on coin", "pipe_outer on rod_tip", "coin on rod_tip",
    ]  # fmt: skip
    assert [type(contact.second) for contact in found] == [Barrel, Barrel, Ball, Barrel, Barrel, Barrel]
    assert [type(contact.first) for contact in found] == [Ball, Ball, Ball, Barrel, Ball, Ball]


def test_blocks_rods_and_points_become_convex_bodies():
    """Vertices in the frame of the part, faces whose normals point outward, and the number of points that can touch."""
    found = contacts("{among: [box, rod, ball]}")
    assert [contact.slots for contact in found] == [2, 1, 1]
    box, rod = found[0].first, found[0].second
    assert sorted(map(tuple, np.abs(box.vertices))) == [(0.5, 1.0, 1.5)] * 8
    for face in box.faces:
        corners = box.vertices[list(face)]
        assert np.cross(corners[1] - corners[0], corners[2] - corners[1]) @ corners.mean(axis=0) > 0
    assert len(box.edges) == 12
    assert rod.vertices.tolist() == [[0, 0, 0], [0, 0, 1]]
    assert (rod.edges, rod.radius, found[1].second.radius) == (((0, 1),), 0, 0.1)
    assert [contact.slots for contact in contacts("{between: [box, frame.p]}")] == [1]
    assert found[1].second.vertices.tolist() == [[0, 0, 0.2]]


def test_a_part_inside_another_is_in_its_hole():
    (contact,) = contacts("{between: [ball, pipe], inside: true}")
    assert (contact.second.radius, contact.inside) == (0.4, True)
    (outside,) = contacts("{between: [ball, pipe]}")
    assert (outside.second.radius, outside.inside) == (0.5, False)


def test_cams_and_compliant_contacts():
    (roller,) = contacts("{parts: [coin], cam: frame.p, profile: 0.1 + 0.01*cos(angle)}")
    assert isinstance(roller.second, Cam)
    assert roller.first.radius == 0.3
    (follower,) = contacts("{plane: box, cam: frame.p, profile: 0.1, stiffness: 1e5, damping: 2, friction: 0.1}")
    assert (type(follower.first), type(follower.second)) == (Cam, Face)
    assert follower.law == ComplianceLaw(1e5, 1.5, 2.0, 0.1, 1e-2)


def test_only_rigid_contacts_are_one_sided():
    text = TEXT.replace("CONTACT", "{parts: [ball, box], plane: ground}")
    assert one_sided_names(parse_mechanism(text)) == ("contacts.k",)
    assert one_sided_names(parse_mechanism(text.replace("ground}\n", "ground, stiffness: 1}\n"))) == ()


def test_shapes_without_a_name_are_named_by_their_places():
    """As in the names of their pairs; a point of this name goes first. Finds parts of URDFs of which no shape can be named."""
    text = """mechanism: m
parts:
  hand: {shapes: [{type: sphere, radius: 0.1, mass: 1}, {type: block, size: [0.1, 0.2, 0.3], at: [0, 0, 1], mass: 1}]POINTS}
joints: {base: {type: free, between: [ground, hand], position: [0, 0, 3]}}
contacts: {floor: {parts: [hand.shape2], plane: ground}}
"""
    pairs = parse_mechanism(text.replace("POINTS", "")).contacts
    assert sum(pair.slots or 1 for pair in pairs) > 1 and {pair.names[0] for pair in pairs} == {"hand.shape2"}
    (pair,) = parse_mechanism(text.replace("POINTS", ", points: {shape2: [0, 0, 0]}")).contacts
    assert isinstance(pair.first, Ball) and not pair.slots
    with pytest.raises(MechanismError, match="'hand' has no shape or point 'shape3'"):
        parse_mechanism(text.replace("POINTS", "").replace("hand.shape2", "hand.shape3"))
