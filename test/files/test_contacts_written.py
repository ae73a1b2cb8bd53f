"""Contacts in exported MJCF, SDF and URDF: read again, the same shapes touch the same planes with the same law."""

import numpy as np
import pytest

from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.on_floor import on_floor
from mbd_sim.files.sdf.writer import to_sdf
from mbd_sim.files.urdf.writer import to_urdf
from mbd_sim.mechanism.elements.contacts import Face

TEXT = """
mechanism: pair
parts:
  box: {mass: 2, inertia: [0.02, 0.03, 0.04], shape: {type: sphere, radius: 9},
    collisions: [{type: block, size: [0.4, 0.3, 0.2], name: foot}]}
  ball: {shape: {type: sphere, mass: 1, radius: 0.1}}
joints:
  box: {type: free, between: [ground, box], position: [0, 0, 0.5], orientation: {axis: [1, 0, 0], angle: 20 deg}}
  ball: {type: free, between: [ground, ball], position: [0.6, 0, 0.6]}
ground: {points: {slope: [0, 0, 0.1]}}
contacts:
  floor: {parts: [box, ball], plane: ground.slope, normal: [0.1, 0, 1], friction: 0.4}
"""
HIT = "  hit: {between: [box, ball], friction: 0.2}\n"


def laws(mechanism):
    """Of each gap: what touches, where on its part, and the law."""
    found = []
    for contact in mechanism.contacts:
        law = contact.law
        for body in getattr(contact.first, "bodies", [contact.first]):
            place = body.at.part.split("::")[-1], np.round(body.at.point, 12).tolist()
            found.append((*place, law.friction, law.restitution))
    return sorted(found)


def planes(mechanism):
    """The unit normals and the distances from the origin of the planes of ground that are touched."""
    faces = [contact.second for contact in mechanism.contacts if isinstance(contact.second, Face)]
    assert all(face.at.part == "ground" for face in faces)
    return [[*face.normal, face.normal @ np.asarray(face.at.point)] for face in faces]


@pytest.mark.parametrize("write", [to_mjcf, to_sdf])
def test_planes_return(write):
    mechanism = parse_mechanism(TEXT)
    again = parse_mechanism(write(mechanism).text)
    again = again if again.contacts else on_floor(again)
    assert laws(again) == laws(mechanism)
    assert [part.touching[0].size for part in again.parts.values() if part.touching] == [(0.4, 0.3, 0.2), (0.1,)]
    normal = np.array([0.1, 0.0, 1.0]) / np.sqrt(1.01)
    for found in (mechanism, again):
        assert planes(found) == pytest.approx(np.tile([*normal, 0.1 * normal[2]], (len(planes(found)), 1)), abs=1e-12)


def test_pairs_of_bodies_return_from_mjcf():
    mechanism = parse_mechanism(TEXT + HIT)
    written = to_mjcf(mechanism)
    again = parse_mechanism(written.text)
    (hit,) = [contact for contact in again.contacts if contact.slots and contact.law.friction == 0.2]
    assert hit.slots == mechanism.contacts[-1].slots
    assert not [note for note in written.left_out if "contacts" in note]
    assert any("contacts of bodies with each other" in note for note in to_sdf(mechanism).left_out)


def test_what_cannot_be_written_is_listed():
    text = TEXT.replace("friction: 0.4}", "friction: 0.4, static_friction: 0.5, restitution: 0.3}")
    left_out = to_mjcf(parse_mechanism(text)).left_out
    assert {note.split(":")[0] for note in left_out} >= {"restitution of contacts", "static friction of contacts"}
    soft = parse_mechanism(TEXT.replace("friction: 0.4}", "stiffness: 1e4}"))
    assert any(note.startswith("compliant contacts") for note in to_mjcf(soft).left_out)


def test_shapes_that_touch_are_collision_elements_of_urdf():
    again = parse_mechanism(to_urdf(parse_mechanism(TEXT)))
    assert [shape.kind for shape in again.parts["box"].shapes] == ["sphere"]
    assert [(shape.kind, shape.size) for shape in again.parts["box"].touching] == [("block", (0.4, 0.3, 0.2))]
    assert [shape.kind for shape in again.parts["ball"].touching] == ["sphere"]
