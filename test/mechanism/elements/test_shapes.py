"""Every kind of shape has all that the package needs to know of it: a new one fails here until it is complete."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker

from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.schema.shapes import AnyShapeSpec
from mbd_sim.files.sdf.writer import to_sdf
from mbd_sim.files.urdf.writer import left_out, to_urdf
from mbd_sim.lab.scene.bodies import Bodies
from mbd_sim.mechanism.elements.parts import ShapeKind
from mbd_sim.pictures.drawing.outlines import shape_paths
from mbd_sim.pictures.drawing.sheet import Projection, ScaledView
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.primitives import primitives
from mbd_sim.pictures.shapes.solids import half_sizes
from mbd_sim.ros.publishing.markers import fixed_markers
from test.lab.scene.recording_scene import RecordingScene

ROOT = Path(__file__).parents[3]
KEYS = {
    "rod": "to: [0.4, 0, 0], radius: 0.05",
    "particle": "radius: 0.05",
    "disc": "radius: 0.2",
    "ring": "radius: 0.2",
    "plate": "size: [0.2, 0.3]",
    "block": "size: [0.2, 0.3, 0.4]",
    "cylinder": "radius: 0.1, length: 0.4",
    "cone": "radius: 0.1, length: 0.4",
    "capsule": "radius: 0.1, length: 0.4",
    "sphere": "radius: 0.2",
    "ellipsoid": "radii: [0.1, 0.2, 0.3]",
    "hull": "points: [[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.4], [0.1, 0.1, 0.1]]",
}
FILE = """
mechanism: shaped
parts: {{body: {{shape: {{type: {kind}, {keys}, mass: 2, name: form}}}}}}
joints: {{flight: {{type: free, between: [ground, body], position: [0, 0, 1]}}}}
contacts: {{floor: {{parts: [body.form], plane: ground}}}}
"""
EXTENT = Extent(np.zeros(3), np.ones(3), 1.0, None)


def shaped(kind):
    return parse_mechanism(FILE.format(kind=kind, keys=KEYS[kind]))


def drawn(kind):
    """The primitive of the shape, and that of the lines on it if there are any."""
    return [one for one in primitives(shaped(kind), EXTENT, lambda mesh: False) if one.kind == "parts"]


def test_the_schema_the_records_and_these_tests_have_the_same_kinds():
    in_files = [get_args(spec.model_fields["type"].annotation)[0] for spec in get_args(get_args(AnyShapeSpec)[0])]
    planar = ["outline"]  # it touches in its plane: test_prisms and test_outlines have what these tests have for others
    assert sorted(in_files) == sorted(get_args(ShapeKind)) == sorted([*KEYS, *planar])


@pytest.mark.parametrize("kind", KEYS)
def test_it_is_in_the_tables_of_the_page_and_in_contact_with_a_plane(kind):
    mechanism = shaped(kind)
    assert mechanism.parts["body"].shapes[0].kind == kind
    assert mechanism.parts["body"].mass == 2.0 and mechanism.contacts
    page = (ROOT / "docs" / "mechanism_file.md").read_text(encoding="utf-8")
    assert f"\n| `{kind}` |" in page
    assert f"`{kind}`" in page[page.index("- **With a plane**") :].partition("\n- ")[0]


@pytest.mark.parametrize("kind", KEYS)
def test_an_export_contains_it_or_says_that_it_does_not(kind):
    mechanism = shaped(kind)
    mjcf, sdf = to_mjcf(mechanism), to_sdf(mechanism)
    for text, missing, word in (
        (to_urdf(mechanism), left_out(mechanism), "<geometry>"),
        (mjcf.text, mjcf.left_out, "<geom "),
        (sdf.text, sdf.left_out, "<geometry>"),
    ):
        assert (word in text) != any(f"body: {kind}" in one for one in missing)


@pytest.mark.parametrize("kind", KEYS)
def test_viewers_draw_it_in_its_size(kind):
    from mbd_sim.pictures.rerun.stream import archetype

    solid, *marks = drawn(kind)
    assert archetype(solid) is not None
    box = half_sizes(shaped(kind).parts["body"].shapes[0])
    (marker, *_) = fixed_markers(solid, "", 1.0)
    size = np.array(marker.scale)
    if marker.type in (Marker.TRIANGLE_LIST, Marker.LINE_STRIP):
        size = np.ptp(np.array(marker.points), axis=0)
    size += [0.0, 0.0, 0.2 if kind == "capsule" else 0.0]  # the balls at its ends are markers of their own
    np.testing.assert_allclose(size, 2.0 * box, atol=0.033 if kind in ("disc", "plate") else 1e-12)
    assert all(np.all(np.abs(np.vstack(mark.form.strips)) <= 1.02 * box + 0.01) for mark in marks)


@pytest.mark.parametrize("kind", KEYS)
def test_the_lab_draws_it(kind):
    scene = RecordingScene()
    bodies = Bodies.__new__(Bodies)
    bodies._scene, bodies._extent = scene, EXTENT
    assert bodies._nodes("/form", drawn(kind)[0]) and "/form" in scene.nodes


def support(shape, direction):
    """How far in m a shape reaches along a direction (3,) in its own frame."""
    if shape.kind == "ellipsoid":
        return np.linalg.norm(shape.size * direction)
    if shape.kind == "hull":
        return np.max(np.array(shape.hull.corners) @ direction)
    half, radius, aside = 0.5 * shape.size[0], shape.size[1], np.linalg.norm(direction[:2])
    if shape.kind == "capsule":
        return half * abs(direction[2]) + radius
    return max(half * direction[2], radius * aside - half * direction[2])  # a cone


@pytest.mark.parametrize("kind", ["cone", "capsule", "ellipsoid", "hull"])
@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_pictures_show_its_outline(kind, planar, seed):
    turn = Rotation.random(rng=seed).as_matrix()
    page = ScaledView(Projection(*np.eye(3)[[0, 2]], np.array([0.0, -1.0, 0.0]), planar), 1000.0)
    shape = shaped(kind).parts["body"].shapes[0]
    paths = shape_paths(page, replace(shape, pose=identity_pose()), Pose(np.zeros(3), turn), (10, 20, 30))
    points = np.vstack([path.points for path in paths])
    for angle in np.linspace(0.0, 6.0, 7):
        along = np.array([np.cos(angle), np.sin(angle)])
        reach = 1000.0 * support(shape, turn.T @ [along[0], 0.0, along[1]])
        assert np.max(points @ along) == pytest.approx(reach, rel=1e-2)
