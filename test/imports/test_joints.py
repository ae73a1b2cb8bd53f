"""Joints from shared faces, of solids of OpenCASCADE in any orientation, and of the same solids as meshes."""

import numpy as np
import pytest

pytest.importorskip("OCP")

from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.imports.assembly import Body, CadAssembly, ImportedPart, PlacedBody
from mbd_sim.imports.joints import candidates_of
from mbd_sim.imports.mesh_faces import faces_of_mesh
from mbd_sim.imports.step_geometry import body_of, solids_of
from test.generators import step_files as cad

Z = (0, 0, 1)
PLATE = cad.cut(cad.box((-20, -20, 0), (40, 40, 10)), cad.cylinder((0, 0, -5), Z, 5.0, 20.0))
PIN = cad.cylinder((0, 0, -10), Z, 5.0, 30.0)
RIVET = cad.fused(PIN, cad.cylinder((0, 0, -4), Z, 8.0, 4.0), cad.cylinder((0, 0, 10), Z, 8.0, 4.0))
BOLT = cad.fused(PIN, cad.cylinder((0, 0, 10), Z, 8.0, 4.0))
FLAT = (cad.box((2, -9, -15), (9, 18, 40)),)  # what makes a pin a D
SOCKET = cad.cut(cad.box((-20, -20, -20), (40, 40, 20)), cad.sphere((0, 0, 0), 12.0))
BALL = cad.sphere((0, 0, 0), 12.0)
GROOVE = cad.cut(cad.box((-20, -20, -10), (40, 40, 10)), cad.box((-30, -5, -5), (60, 10, 6)))
STONE = cad.box((-8, -5, -5), (16, 10, 12))
TWO_HOLES = cad.cut(cad.box((-20, -20, 0), (40, 40, 10)), *(cad.cylinder((x, 0, -5), Z, 4.0, 20.0) for x in (-9, 9)))
TWO_RODS = cad.fused(cad.box((-20, -20, 14), (40, 40, 6)), *(cad.cylinder((x, 0, -5), Z, 4.0, 22.0) for x in (-9, 9)))
FITTED = cad.fused(cad.box((-20, -20, 10), (40, 40, 6)), *(cad.cylinder((x, 0, 2), Z, 4.0, 10.0) for x in (-9, 9)))
LINK = cad.cut(cad.box((-8, -8, 0), (60, 16, 5)), cad.cylinder((0, 0, -5), Z, 5.0, 20.0))
UPPER = cad.cut(cad.box((-8, -60, 5), (16, 68, 5)), cad.cylinder((0, 0, -5), Z, 5.0, 20.0))
LYING = cad.box((-5, -5, 0), (10, 10, 10))
TABLE = cad.box((-20, -20, -5), (40, 40, 5))
WIDE = cad.cut(cad.box((-20, -20, 0), (40, 40, 10)), cad.cylinder((0, 0, -5), Z, 6.0, 20.0))
CORNER = cad.cut(cad.box((0, 0, 0), (30, 30, 10)), cad.box((-1, -1, 5), (21, 21, 6)))

CASES = {
    "hinge: shoulders on both sides": (PLATE, RIVET, "revolute", Z),
    "hinge: holes of two links without a pin": (LINK, UPPER, "revolute", Z),
    "cylindrical: a plain pin": (PLATE, PIN, "cylindrical", Z),
    "cylindrical: a shoulder on one side": (PLATE, BOLT, "cylindrical", Z),
    "slider: a D-shaped pin": (cad.fused(PLATE, cad.cut(cad.cylinder((0, 0, 0), Z, 5.0, 10.0), cad.box((-9, -9, -5), (11, 18, 20)))), cad.cut(PIN, *FLAT), "prismatic", Z),
    "slider: two rods in two holes": (TWO_HOLES, TWO_RODS, "prismatic", Z),
    "slider: a stone in a groove": (GROOVE, STONE, "prismatic", (1, 0, 0)),
    "ball in a socket": (SOCKET, BALL, "spherical", None),
    "planar: a block on a table": (TABLE, LYING, "planar", Z),
    "weld: in a corner of three planes": (CORNER, cad.box((0, 0, 5), (20, 20, 5)), "fixed", None),
}  # fmt: skip


UPRIGHT = np.eye(3)


def assembly_of(*solids, turn=UPRIGHT, as_mesh=False):
    parts = []
    for number, solid in enumerate(solids):
        body = body_of(next(solids_of(solid)), "solid")
        if as_mesh:
            body = Body(body.volume, body.triangles, faces_of_mesh(body.triangles))
        placed = PlacedBody(body, identity_pose(), ("solid",))
        parts.append(ImportedPart(f"part_{number}", Pose(np.array([0.1, 0.2, -0.3]), turn), (placed,)))
    return CadAssembly("test", tuple(parts))


@pytest.mark.parametrize("as_mesh", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_the_joint_that_shared_faces_leave(case, as_mesh):
    one, other, kind, axis = CASES[case]
    turn = cad.rotation([0.3, -0.5, 0.8], 1.1)
    for solids in ((one, other), (other, one)):
        (found,) = candidates_of(assembly_of(*solids, turn=turn, as_mesh=as_mesh), 1e-4)
        assert found.type == kind, found.why
        if axis is not None:
            assert abs(found.axis @ (turn @ axis)) == pytest.approx(1.0, abs=1e-6)
        if kind in ("revolute", "cylindrical"):
            away = found.point - [0.1, 0.2, -0.3]
            assert np.linalg.norm(np.cross(away, turn @ axis)) < 1e-6


def test_parts_that_do_not_touch_share_no_joint():
    """Neither a loose pin, nor planes that meet only at an edge, nor the rounded edge of a block in a fillet."""
    assert not candidates_of(assembly_of(WIDE, PIN), 1e-4)
    beside = cad.box((20, 20, 0), (5, 5, 5))
    assert not candidates_of(assembly_of(LYING, beside), 1e-4)
    edge = cad.box((5, -5, 10), (10, 10, 10))
    assert not candidates_of(assembly_of(LYING, edge), 1e-4)


def test_a_gap_lets_a_loose_pin_touch():
    (found,) = candidates_of(assembly_of(WIDE, PIN), 1.1e-3)
    assert (found.type, found.why.split(";")[0]) == ("cylindrical", "share an axis of radius 6 mm")


def test_a_pin_takes_the_place_of_the_hinge_between_holes():
    found = candidates_of(assembly_of(LINK, UPPER, cad.cylinder((0, 0, 0), Z, 5.0, 10.0)), 1e-4)
    assert [(one.parts, one.type) for one in found] == [
        (("part_0", "part_1"), "planar"),
        (("part_0", "part_2"), "cylindrical"),
        (("part_1", "part_2"), "cylindrical"),
    ]
