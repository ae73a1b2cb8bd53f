"""Meshes as the parts of an assembly: the command on a folder, in several formats, and what is refused."""

import zipfile
from importlib.util import find_spec

import numpy as np
import pytest

from mbd_sim import InputError, load_mechanism
from mbd_sim.cli.main import main
from mbd_sim.imports.meshes import mesh_files, read_meshes
from test.files.text.test_mesh_files import block as inside_out
from test.files.text.test_mesh_files import write_stl

pytestmark = pytest.mark.skipif(find_spec("trimesh") is None, reason="needs trimesh")


def block(size, center=(0.0, 0.0, 0.0)):
    return inside_out(size, center)[:, ::-1]


def write_parts(folder):
    """A table, a block on it in millimeters as STL and OBJ, and a disc as 3MF in inches; all in one frame."""
    import trimesh

    folder.mkdir()
    write_stl(folder / "table.stl", 1000.0 * block([0.4, 0.4, 0.1], [0.0, 0.0, -0.05]))
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(1000.0 * block([0.1, 0.1, 0.1], [0.05, 0.0, 0.05]))).export(
        folder / "block.obj"
    )
    disc = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=64)
    disc.apply_translation([-4.0, 0.0, 1.0])
    disc.export(folder.parent / "disc.3mf")  # always in millimeters
    with zipfile.ZipFile(folder.parent / "disc.3mf") as old, zipfile.ZipFile(folder / "disc.3mf", "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b'unit="millimeter"', b'unit="inch"'))
    return folder


def test_a_folder_of_meshes_becomes_a_mechanism(tmp_path, monkeypatch, capsys):
    pytest.importorskip("networkx")
    pytest.importorskip("lxml")
    write_parts(tmp_path / "bench")
    monkeypatch.chdir(tmp_path)
    line = "import bench --unit mm --density steel --mass block=2 --joint 1 --joint 2=hinge"
    assert main(line.split()) == 0
    assert "block.obj, table.stl: lengths in units of 0.001 m" in str(capsys.readouterr())
    found = load_mechanism("bench.yaml")
    assert found.parts["table"].mass == pytest.approx(7850.0 * 0.016)
    assert found.parts["block"].mass == pytest.approx(2.0)
    area = 32.0 * np.sin(2.0 * np.pi / 64.0)  # of the polygon, in square inches
    assert found.parts["disc"].mass == pytest.approx(7850.0 * 2.0 * area * 0.0254**3, rel=1e-4)
    assert {name: joint.type for name, joint in found.all_joints.items()} == {
        "table_mount": "fixed",
        "block_table": "planar",
        "disc_table": "revolute",
    }
    text = (tmp_path / "bench.yaml").read_text()
    assert "material: steel\n    mesh: {file: bench/table.stl, scale: 0.001}" in text
    assert main(line.split()) == 1
    assert "bench.yaml exists, and may contain changes. Add --force" in capsys.readouterr().err


def test_meshes_that_give_no_mass_are_refused_with_the_reason(tmp_path):
    write_stl(tmp_path / "open.stl", block([1, 1, 1])[:-1])
    write_stl(tmp_path / "turned.stl", inside_out([1, 1, 1]))
    (tmp_path / "text.stl").write_text("no mesh")
    for name, said in (("open", "not closed"), ("turned", "inside out"), ("text", "cannot be read|no triangles")):
        with pytest.raises(InputError, match=rf"{name}\.stl: .*({said})"):
            read_meshes([tmp_path / f"{name}.stl"], 1e-3, "m")
    with pytest.raises(InputError, match=r"the unit of open\.stl is not known.* Add --unit mm"):
        read_meshes([tmp_path / "open.stl"], None, "m")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="the folder has no meshes"):
        mesh_files([tmp_path / "empty"])
    with pytest.raises(InputError, match="no such file"):
        mesh_files([tmp_path / "none.stl"])
