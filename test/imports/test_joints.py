"""Joints from shared faces, of solids of OpenCASCADE in any orientation, and of the same solids as meshes."""

import functools
from importlib.util import find_spec

import numpy as np
import pytest

from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.imports.assembly import Body, CadAssembly, ImportedPart, PlacedBody
from mbd_sim.imports.joints import candidates_of
from mbd_sim.imports.mesh_faces import faces_of_mesh
from mbd_sim.imports.step_geometry import body_of, solids_of

pytestmark = pytest.mark.skipif(find_spec("OCP") is None, reason="needs OpenCASCADE")


@functools.cache
def cad():
    """The module, with which OpenCASCADE is imported: late, as that takes a second in each process."""
    from test.generators import step_files

    return step_files


@functools.cache
def touching():
    from test.imports import touching_solids

    return touching_solids


CASES = (
    "hinge: shoulders on both sides",
    "hinge: holes of two links without a pin",
    "cylindrical: a plain pin",
    "cylindrical: a shoulder on one side",
    "slider: a D-shaped pin",
    "slider: two rods in two holes",
    "slider: a stone in a groove",
    "ball in a socket",
    "planar: a block on a table",
    "weld: in a corner of three planes",
)
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
    assert tuple(touching().CASES) == CASES
    one, other, kind, axis = touching().CASES[case]
    turn = cad().rotation([0.3, -0.5, 0.8], 1.1)
    for pair in ((one, other), (other, one)):
        (found,) = candidates_of(assembly_of(*pair, turn=turn, as_mesh=as_mesh), 1e-4)
        assert found.type == kind, found.why
        if axis is not None:
            assert abs(found.axis @ (turn @ axis)) == pytest.approx(1.0, abs=1e-6)
        if kind in ("revolute", "cylindrical"):
            away = found.point - [0.1, 0.2, -0.3]
            assert np.linalg.norm(np.cross(away, turn @ axis)) < 1e-6


def test_parts_that_do_not_touch_share_no_joint():
    """Neither a loose pin, nor planes that meet only at an edge, nor the rounded edge of a block in a fillet."""
    assert not candidates_of(assembly_of(touching().WIDE, touching().PIN), 1e-4)
    beside = cad().box((20, 20, 0), (5, 5, 5))
    assert not candidates_of(assembly_of(touching().LYING, beside), 1e-4)
    edge = cad().box((5, -5, 10), (10, 10, 10))
    assert not candidates_of(assembly_of(touching().LYING, edge), 1e-4)


def test_a_gap_lets_a_loose_pin_touch():
    (found,) = candidates_of(assembly_of(touching().WIDE, touching().PIN), 1.1e-3)
    assert (found.type, found.why.split(";")[0]) == ("cylindrical", "share an axis of radius 6 mm")


def test_a_pin_takes_the_place_of_the_hinge_between_holes():
    found = candidates_of(
        assembly_of(touching().LINK, touching().UPPER, cad().cylinder((0, 0, 0), touching().Z, 5.0, 10.0)), 1e-4
    )
    assert [(one.parts, one.type) for one in found] == [
        (("part_0", "part_1"), "planar"),
        (("part_0", "part_2"), "cylindrical"),
        (("part_1", "part_2"), "cylindrical"),
    ]
