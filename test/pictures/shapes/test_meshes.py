"""Meshes as triangles: units, placement, coarsening, and the reasons why one is not drawn."""

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.base import packages
from mbd_sim.pictures.shapes.meshes import MeshError, as_glb, coarsened, part_triangles, triangles, undrawn_meshes
from test.generators import mesh_files

EXPECTED = np.array(mesh_files.CORNERS)[np.array(mesh_files.FACES)]
ROBOT = """<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
  <visual><origin xyz="0 0 2" rpy="0 0 1.5707963267948966"/><geometry><mesh filename="{}" scale="2 2 2"/></geometry></visual>
    <collision><geometry><box size="1 1 1"/></geometry></collision></link></robot>"""


def sample(folder, suffix):
    path = folder / f"sample{suffix}"
    match suffix:
        case ".dae":
            path.write_text(mesh_files.collada())
        case ".obj":
            path.write_text(mesh_files.wavefront())
        case ".stl":
            path.write_bytes(mesh_files.binary_stl())
        case ".glb":
            path.write_bytes(as_glb(sample(folder, ".dae")))
    return path


def robot(folder, uri):
    (folder / "r.urdf").write_text(ROBOT.format(uri))
    return load_mechanism(folder / "r.urdf", base="free")


@pytest.mark.parametrize("suffix", [".dae", ".obj", ".stl", ".glb"])
def test_all_formats_give_the_same_triangles_in_meters(tmp_path, suffix):
    np.testing.assert_allclose(
        triangles(sample(tmp_path, suffix)), EXPECTED, atol=1e-8
    )  # STL and glTF: single precision


def test_a_mesh_is_scaled_and_then_placed(tmp_path):
    sample(tmp_path, ".obj")
    part = robot(tmp_path, "sample.obj").parts["a"]
    ((_, found),) = part_triangles(part, str(tmp_path / "r.urdf"))
    x, y, z = np.moveaxis(2.0 * EXPECTED, -1, 0)
    np.testing.assert_allclose(found, np.stack([-y, x, z + 2.0], axis=-1), atol=1e-12)


def test_a_file_that_is_written_again_is_read_again(tmp_path):
    path = sample(tmp_path, ".obj")
    assert len(triangles(path)) == 4
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(triangles(path)) == 1


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.step", b"", "(its format is none of .3mf, .dae, .glb, .gltf, .obj, .ply, .stl)"),
        ("a.dae", b"<COLLADA", "(it cannot be read as DAE: "),
        ("a.stl", b"solid x", "(it "),
        ("a.obj", b"v 0 0 0\n", "(it "),
        ("a.glb", b"glTF", "(it cannot be read as GLB: "),
    ],
)
def test_a_mesh_that_cannot_be_read_is_named_with_the_reason(tmp_path, name, content, reason):
    (tmp_path / name).write_bytes(content)
    mechanism = robot(tmp_path, name)
    (said,) = undrawn_meshes(mechanism)
    assert said.startswith(f"{name} {reason}") and "\n" not in said
    assert part_triangles(mechanism.parts["a"], mechanism.source.file) == []
    if name != "a.step":
        with pytest.raises(MeshError):
            triangles(tmp_path / name)


@pytest.mark.parametrize(("missing", "suffix"), [("trimesh", ".obj"), ("collada", ".dae")])
def test_a_missing_package_is_named_with_the_line_that_installs_it(tmp_path, monkeypatch, missing, suffix):
    installed = packages._is_installed
    monkeypatch.setattr(packages, "_is_installed", lambda module: module != missing and installed(module))
    sample(tmp_path, ".obj"), (tmp_path / "sample.dae").write_text(mesh_files.collada())
    (said,) = undrawn_meshes(robot(tmp_path, f"sample{suffix}"))
    line = {"trimesh": "trimesh pycollada", "collada": "pycollada"}[missing]
    assert said == (
        f"sample{suffix} (Reading this mesh needs {missing}, which is not installed. Install it with: pip install {line})"
    )


def test_a_fine_mesh_is_coarsened_and_keeps_its_form():
    angles = np.linspace(0.0, np.pi, 201)
    x, y = np.meshgrid(angles, 2.0 * angles, indexing="ij")
    points = np.stack([np.sin(x) * np.cos(y), np.sin(x) * np.sin(y), np.cos(x)], axis=-1)
    quads = np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    fine = np.vstack([quads[:, :3], quads[:, [0, 2, 3]]])
    coarse = coarsened(fine, 5_000)
    assert len(fine) == 80_000 and 1_000 < len(coarse) <= 5_000
    radii = np.linalg.norm(coarse, axis=-1)
    assert radii.min() > 0.995 and radii.max() < 1.0 + 1e-12
    assert coarsened(coarse, 5_000) is coarse
