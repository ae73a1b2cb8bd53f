"""Whole drawings: every kind of joint, force and shape, at any size, with legible names."""

import numpy as np
import pytest

from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.pictures.drawing.picture import compose
from mbd_sim.pictures.drawing.sheet import plane_normal, view_of
from mbd_sim.pictures.shapes.solids import is_invisible
from test.pictures.start import AtStart

EVERYTHING = """
mechanism: everything
gravity: [0, 0, -9.81]
parts:
  a: {mass: 1, shape: {type: block, size: [0.2, 0.2, 0.1]}, points: {out: [0.3, 0, 0]}}
  b: {mass: 1, shape: {type: rod, to: [0, 0, -0.5]}, points: {tip: [0, 0, -0.5]}}
  c: {shapes: [{type: sphere, radius: 0.1, mass: 1}, {type: plate, size: [0.3, 0.2], at: [0, 0, -0.2], mass: 0.2}]}
  d: {mass: 1, center: [0, 0, 0.1], inertia: [0.1, 0.1, 0.1], points: {e: [0.2, 0, 0.2]}}
  e: {mass: 1, shapes: [{type: cylinder, radius: 0.1, length: 0.2}, {type: cylinder, radius: 0.05, length: 0.2, hole: true}]}
  f: {mass: 1, shape: {type: ring, radius: 0.2}}
  g: {mass: 1, shape: {type: disc, radius: 0.2, color: '#336699'}}
  h: {mass: 1}
  i: {mass: 1, inertia: [0.1, 0.1, 0.1], shape: {type: particle}}
joints:
  ja: {type: prismatic, between: [ground, a], axis: [1, 0, 0], stiffness: 5, damping: 1}
  jb: {type: revolute, between: [a, b], axis: [0, 1, 0], stiffness: 2, position: 0.4}
  jc: {type: spherical, between: [b.tip, c]}
  jd: {type: universal, between: [ground, d], axes: [[1, 0, 0], [0, 1, 0]]}
  je: {type: screw, between: [ground, e], axis: [0, 0, 1], lead: 0.1}
  jf: {type: cylindrical, between: [f, ground], axis: [0, 1, 0], damping: [2, 0]}
  jg: {type: planar, between: [ground, g], axis: [0, 0, 1], stiffness: [1, 1, 0]}
  jh: {type: fixed, between: [a.out, h]}
  ji: {type: free, between: [ground, i], position: [1, 1, 1]}
forces:
  coil: {type: spring, between: [b.tip, ground], stiffness: 10, length: 0.2, damping: 1}
  push: {type: force, at: i, vector: [0, 0, sin(t)]}
  twist: {type: couple, on: c, vector: [0, 1, 0], axes: part}
"""


def drawn(text):
    mechanism = parse_mechanism(text)
    return compose(mechanism, AtStart(mechanism).poses())


def overlaps(first, second):
    (a, b), (c, d) = first.box, second.box
    return bool(np.all(np.minimum(b, d) - np.maximum(a, c) > 0.5))


def test_every_kind_of_joint_shape_and_force_is_drawn_with_its_name():
    picture = drawn(EVERYTHING)
    words = {text.text for text in picture.sheet.texts}
    assert set("abcdefghi") <= words and {"x", "y", "z", "g"} <= words
    for path in picture.sheet.paths:
        assert path.points.ndim == 2 and path.points.shape[1] == 2 and np.all(np.isfinite(path.points))


# One of each kind of element, and crowded ones: each fault of the layout that any shipped mechanism finds, these find too.
DRAWN = (
    "a04_bricard", "arm", "atwood", "follower_force", "gas_engine", "insect_on_sphere", "pencil", "scissor_lift", "screw_press",
    "slider_crank", "spring_chain", "upright_wheel", "arch", "hydraulic_scissor_lift", "motor_drive", "newtons_cradle",
    "triple_rod_torsion",
)  # fmt: skip


@pytest.mark.parametrize("name", DRAWN)
def test_mechanisms_fit_their_sheets_and_names_do_not_cover_each_other(name):
    mechanism = load_mechanism(name)
    picture = compose(mechanism, AtStart(mechanism).poses())
    low, high = picture.sheet.bounds()
    assert np.all(low >= -0.5) and np.all(high <= picture.size + 0.5)
    assert picture.size[0] <= 680.0
    parts = [text for text in picture.sheet.texts if text.text.replace(" ", "_") in mechanism.parts]
    assert len(parts) >= sum(not is_invisible(part) for part in mechanism.parts.values())
    named = [text.text.replace(" ", "_") for text in parts]
    for joint in mechanism.joints.values():  # one that is called as its part is not named again
        assert named.count(joint.name) <= 1 or joint.outboard_part != joint.name
    for index, first in enumerate(parts):
        assert not any(overlaps(first, other) for other in parts[index + 1 :])


@pytest.mark.parametrize(("length", "scale"), [(0.01, "mm"), (1.0, "cm"), (100.0, "m")])
def test_a_pendulum_looks_the_same_at_any_size(length, scale):
    text = """
mechanism: pendulum
parts: {rod: {mass: 1, shape: {type: rod, to: [0, 0, -LENGTH]}}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, -1, 0], position: 0.7}}
"""
    picture, plain = (drawn(text.replace("LENGTH", str(value))) for value in (length, 1.0))
    np.testing.assert_allclose(picture.size, plain.size, atol=1.0)
    assert [len(path.points) for path in picture.sheet.paths] == [len(path.points) for path in plain.sheet.paths]
    assert any(text.text.endswith(f" {scale}") for text in picture.sheet.texts)


def test_a_single_particle_can_be_drawn():
    assert np.all(
        np.isfinite(
            drawn(
                "{mechanism: m, parts: {p: {mass: 1, inertia: [1, 1, 1]}}, joints: {f: {type: free, between: [ground, p]}}}"
            ).size
        )
    )


@pytest.mark.parametrize(
    ("name", "normal"),
    [
        ("double_rod", [0, 1, 0]),
        ("cart_pendulum_spring", [0, 1, 0]),
        ("planar_puck", [0, 0, 1]),
        ("rotating_frame_mass", [0, 0, 1]),
        ("universal_pendulum", None),
        ("box_bryan", None),
        ("screw_press", None),
    ],
)
def test_planar_mechanisms_are_viewed_along_their_axis_with_x_to_the_right(name, normal):
    mechanism = load_mechanism(name)
    poses = AtStart(mechanism).poses()
    found, view = plane_normal(mechanism, poses), view_of(mechanism, poses)
    assert view.planar == (normal is not None)
    np.testing.assert_allclose(np.cross(view.right, view.up), view.toward, atol=1e-12)
    assert view.right[0] > 0.8 or normal is None
    if normal is not None:
        np.testing.assert_allclose(np.abs(found), normal, atol=1e-12)


def test_a_single_slide_is_drawn_in_a_plane_that_contains_it():
    for axis in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 2, 3]):
        text = f"{{mechanism: m, parts: {{p: {{mass: 1}}}}, joints: {{s: {{type: prismatic, between: [ground, p], axis: {axis}}}}}}}"
        mechanism = parse_mechanism(text)
        normal = plane_normal(mechanism, AtStart(mechanism).poses())
        assert abs(normal @ np.array(axis)) < 1e-9


def test_gravity_along_the_direction_of_view_is_drawn_end_on():
    flat = load_mechanism("planar_puck")
    assert flat.gravity[2] < 0.0
    texts = [text.text for text in compose(flat, AtStart(flat).poses()).sheet.texts]
    assert "g" in texts
    text = "{mechanism: m, gravity: [0, 0, 0], parts: {p: {mass: 1, inertia: [1, 1, 1]}}, joints: {f: {type: free, between: [ground, p]}}}"
    assert "g" not in [text.text for text in drawn(text).sheet.texts]
