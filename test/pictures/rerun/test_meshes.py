"""Meshes in Rerun: their files are found, placed and scaled; missing ones are named once."""

import io

import numpy as np

from mbd_sim import Simulation, load_mechanism
from mbd_sim.files.text.mesh_files import mesh_path, resource_uri
from mbd_sim.pictures.rerun.scene import DisplayOptions, RowMaker, describe_scene
from mbd_sim.pictures.shapes.meshes import undrawn_meshes
from test.generators import mesh_files

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


def static_items(mechanism):
    from mbd_sim.pictures.rerun.stream import part_entities

    model = Simulation(mechanism).model
    scene = describe_scene(model, RowMaker(model).layout, DisplayOptions())
    return [item for entity in part_entities(scene) for item in entity.static()]


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
    from mbd_sim.pictures.rerun.stream import RERUN_READS

    mechanism = load_mechanism(folder(tmp_path) / "urdf" / "r.urdf", base="free")
    assert undrawn_meshes(mechanism, RERUN_READS) == ["package://other/meshes/b.stl (not found)"]
    items = [item for item in static_items(mechanism) if "mesh" in item[0]]
    assert [type(value).__name__ for _, value in items] == ["Asset3D", "Transform3D"]
    assert items[0][1].blob.as_arrow_array().to_pylist() == [list(OBJ.encode())]
    assert np.ravel(items[1][1].scale.as_arrow_array().to_pylist()).tolist() == [2.0, 2.0, 2.0]


def test_collada_becomes_gltf_in_meters_with_its_material_and_replaces_the_collision_shape(tmp_path):
    import trimesh

    package = folder(tmp_path)
    (package / "meshes" / "a.dae").write_text(mesh_files.collada())
    collision = '<collision><geometry><box size="1 1 1"/></geometry></collision></link>'
    text = ROBOT.replace("a.obj", "a.dae").replace("</link>", collision)
    (package / "urdf" / "r.urdf").write_text(text)
    items = static_items(load_mechanism(package / "urdf" / "r.urdf", base="free"))
    assert [path.rpartition("/")[2] for path, _ in items] == ["axes", "mesh_0", "mesh_0"]
    asset = items[1][1]
    assert asset.media_type.as_arrow_array().to_pylist() == ["model/gltf-binary"]
    (blob,) = asset.blob.as_arrow_array().to_pylist()
    scene = trimesh.load_scene(io.BytesIO(bytes(blob)), file_type="glb", process=False)
    np.testing.assert_allclose(scene.bounds, [np.zeros(3), np.max(mesh_files.CORNERS, axis=0)], atol=1e-8)
    (body,) = scene.geometry.values()
    assert body.visual.material.main_color.tolist() == [255, 0, 0, 255]


def test_other_programs_find_a_mesh_by_its_package_or_its_file(tmp_path, monkeypatch):
    mesh, uri = folder(tmp_path) / "meshes" / "a.obj", "package://my_robot/meshes/a.obj"
    source = str(tmp_path / "my_robot" / "urdf" / "r.urdf")
    assert resource_uri(uri, source) == resource_uri("../meshes/a.obj", source).replace("urdf/../", "") == mesh.as_uri()
    assert resource_uri("package://my_robot/meshes/c.obj", source) == ""
    installed = tmp_path / "prefix" / "share" / "my_robot" / "meshes"
    installed.mkdir(parents=True)
    (installed / "a.obj").write_text(OBJ)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    assert resource_uri(uri, source) == uri
