"""Meshes in Rerun: their files are found, placed and scaled; missing ones are named once."""

import numpy as np

from mbd_sim import Simulation, load_mechanism
from mbd_sim.appearance.mesh_files import mesh_path
from mbd_sim.viewer.part_entities import part_entities, undrawn_meshes
from mbd_sim.viewer.sample_rows import RowWriter
from mbd_sim.viewer.scene_description import DisplayOptions, describe_scene

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
ROBOT = """<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
  <visual><origin xyz="0 0 2"/><geometry><mesh filename="package://my_robot/meshes/a.obj" scale="2 2 2"/></geometry></visual>
    <visual><geometry><mesh filename="package://other/meshes/b.stl"/></geometry></visual></link></robot>"""


def folder(tmp_path):
    package = tmp_path / "my_robot"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    (package / "meshes" / "a.obj").write_text(OBJ)
    (package / "urdf" / "r.urdf").write_text(ROBOT)
    return package


def test_packages_are_found_around_the_file_and_in_the_environment(tmp_path, monkeypatch):
    package = folder(tmp_path)
    source, mesh = str(package / "urdf" / "r.urdf"), package / "meshes" / "a.obj"
    assert mesh_path("package://my_robot/meshes/a.obj", source) == mesh
    assert mesh_path("../meshes/a.obj", source).samefile(mesh)
    assert mesh_path(f"file://{mesh}", "elsewhere.urdf") == mesh
    assert mesh_path("package://my_robot/meshes/a.obj", "/nowhere/r.urdf") is None
    assert mesh_path("x" * 5000, source) is None
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    assert mesh_path("package://my_robot/meshes/a.obj", "/nowhere/r.urdf") == mesh


def test_meshes_are_drawn_and_missing_ones_named(tmp_path):
    mechanism = load_mechanism(folder(tmp_path) / "urdf" / "r.urdf", base="free")
    assert undrawn_meshes(mechanism) == ["package://other/meshes/b.stl (not found)"]
    model = Simulation(mechanism).model
    scene = describe_scene(model, RowWriter(model).layout, DisplayOptions())
    items = [item for entity in part_entities(scene) for item in entity.static() if "mesh" in item[0]]
    assert [type(value).__name__ for _, value in items] == ["Asset3D", "Transform3D"]
    assert items[0][1].blob.as_arrow_array().to_pylist() == [list(OBJ.encode())]
    assert np.ravel(items[1][1].scale.as_arrow_array().to_pylist()).tolist() == [2.0, 2.0, 2.0]
