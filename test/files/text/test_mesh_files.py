"""Parts with a mass whose meshes say how it is distributed: closed forms, scaled, turned, several, and without a solid."""

import shutil
import struct

import numpy as np
import pytest

from mbd_sim import MechanismError, Simulation, load_mechanism, parse_mechanism
from mbd_sim.base.geometry.rotation import about
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.text.mesh_files import MeshError, solid
from mbd_sim.files.text.yaml_text import mechanism_text
from test.generators import mesh_files

FACES = np.array([(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6),
                  (0, 6, 2), (1, 3, 7), (1, 7, 5)])  # fmt: skip


def block(size, center=(0.0, 0.0, 0.0), turn=None):
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size + center
    return (corners if turn is None else corners @ turn.T)[FACES]


def block_inertia(mass, size):
    x, y, z = np.square(size)
    return mass / 12.0 * np.diag([y + z, z + x, x + y])


def write_stl(path, triangles):
    rows = [struct.pack("<12fH", *(0.0,) * 3, *one.ravel(), 0) for one in np.asarray(triangles)]
    path.write_bytes(bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows))


def part_of(tmp_path, meshes, keys="mass: 2 kg"):
    text = f"mechanism: m\nparts: {{arm: {{meshes: {meshes}, {keys}}}}}\n"
    text += "joints: {pin: {type: revolute, between: [ground, arm], axis: [0, 1, 0]}}\n"
    return parse_mechanism(text, str(tmp_path / "m.yaml"))


@pytest.mark.parametrize("seed", range(6))
def test_a_turned_block_anywhere_has_the_inertia_of_a_block(seed):
    numbers = np.random.default_rng(seed)
    size, center = 10.0 ** numbers.uniform(-6, 3) * numbers.uniform(0.2, 2.0, 3), numbers.normal(size=3)
    center *= np.max(size)
    axis = numbers.normal(size=3)
    turn = about(axis / np.linalg.norm(axis), numbers.uniform(0.0, 3.0))
    found = solid(block(size, center, turn))
    assert found["volume"] == pytest.approx(np.prod(size), rel=1e-12)
    assert found["center"] == pytest.approx(turn @ center, abs=1e-12 * np.max(size))
    second = turn @ np.diag(np.square(size) / 12.0) @ turn.T * np.prod(size)
    expected = [second[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    assert found["moments"] == pytest.approx(expected, abs=1e-12 * np.max(second))


def test_trimesh_agrees_on_an_irregular_solid_with_a_hole():
    import trimesh

    outer = trimesh.creation.icosphere(subdivisions=2, radius=0.3).apply_scale([1.0, 2.0, 0.7])
    hole = trimesh.creation.icosphere(subdivisions=1, radius=0.1).apply_translation([0.05, 0.02, 0.0])
    hole.invert()
    both = trimesh.util.concatenate([outer, hole])
    found = solid(np.asarray(both.triangles))
    assert found["volume"] == pytest.approx(both.volume, rel=1e-12)
    assert found["center"] == pytest.approx(both.center_mass, abs=1e-14)
    second = 0.5 * np.trace(both.moment_inertia) * np.eye(3) - both.moment_inertia
    assert found["moments"] == pytest.approx([*np.diag(second), *second[[0, 0, 1], [1, 2, 2]]], abs=1e-14)


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae"])
def test_a_tetrahedron_in_each_format(tmp_path, suffix):
    """Its center is the mean of its corners; I_xx about the corner is m (b² + c²)/10 (the part was a point mass)."""
    content = {"stl": mesh_files.binary_stl(), "obj": mesh_files.wavefront(), "dae": mesh_files.collada()}[suffix]
    path = tmp_path / f"t.{suffix}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    part = part_of(tmp_path, f"[{{file: {path.name}}}]").parts["arm"]
    assert part.center == pytest.approx([0.025, 0.05, 0.075], abs=1e-7)
    about_corner = 2.0 / 10.0 * np.array([0.2**2 + 0.3**2, 0.3**2 + 0.1**2, 0.1**2 + 0.2**2])
    offset = np.array([0.025, 0.05, 0.075])
    expected = about_corner - 2.0 * (offset @ offset - offset**2)
    assert np.diag(part.inertia) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("scale", [(0.001, 0.001, 0.001), (0.5, -2.0, 3.0)])
def test_scale_and_pose_of_a_mesh(tmp_path, scale):
    size, center = np.array([0.25, 0.5, 1.0]), np.array([1.0, -0.5, 0.25])
    write_stl(tmp_path / "b.stl", block(size, center))
    entry = f"[{{file: b.stl, scale: {list(scale)}, at: [1, 2, 3], rotate: {{axis: [0, 0, 1], angle: 90 deg}}}}]"
    part = part_of(tmp_path, entry).parts["arm"]
    turn = about(np.array([0.0, 0.0, 1.0]), np.pi / 2)
    assert part.center == pytest.approx([1, 2, 3] + turn @ (scale * center), abs=1e-14)
    assert part.inertia == pytest.approx(turn @ block_inertia(2.0, size * scale) @ turn.T, abs=1e-14)
    assert part.mass == 2.0


def test_a_mesh_that_is_probably_in_millimeters_is_remarked(tmp_path):
    write_stl(tmp_path / "b.stl", block([200, 50, 20]))
    (said,) = part_of(tmp_path, "[{file: b.stl}]").source.remarks
    assert said.startswith("arm has a large mesh, b.stl (radius of gyration 57.7 m)") and "'scale: 0.001'" in said
    assert part_of(tmp_path, "[{file: b.stl, scale: [0.001, 0.001, 0.001]}]").source.remarks == ()


def test_several_meshes_share_the_mass_by_their_volumes(tmp_path):
    write_stl(tmp_path / "left.stl", block([1, 1, 1], [-0.5, 0, 0]))
    write_stl(tmp_path / "right.stl", block([1, 1, 1], [0.5, 0, 0])[:, ::-1])  # turned inside out
    part = part_of(tmp_path, "[{file: left.stl}, {file: right.stl}]").parts["arm"]
    assert part.center == pytest.approx(np.zeros(3), abs=1e-14)
    assert part.inertia == pytest.approx(block_inertia(2.0, [2, 1, 1]), abs=1e-14)


def test_the_inertia_follows_the_mass(tmp_path):
    write_stl(tmp_path / "b.stl", block([1, 1, 1]))
    mechanism = part_of(tmp_path, "[{file: b.stl}]", "mass: 2 kg")
    heavier = with_values(mechanism, {"parts.arm.mass": "6 kg"})
    assert heavier.parts["arm"].inertia == pytest.approx(block_inertia(6.0, [1, 1, 1]))


def test_a_recording_does_not_need_the_mesh(tmp_path):
    write_stl(tmp_path / "b.stl", block([1, 0.5, 0.25], [1, 0, 0]))
    mechanism = part_of(tmp_path, "[{file: b.stl}]")
    (tmp_path / "b.stl").unlink()
    again = parse_mechanism(mechanism_text(mechanism.source), str(tmp_path / "m.yaml"))
    assert np.array_equal(again.parts["arm"].inertia, mechanism.parts["arm"].inertia)
    assert np.array_equal(again.parts["arm"].center, mechanism.parts["arm"].center)


@pytest.mark.parametrize(
    ("triangles", "reason"),
    [
        (block([1, 1, 1])[1:], "its surface is not closed"),
        (np.concatenate([block([1, 1, 1])[:-1], block([1, 1, 1])[-1:, ::-1]]), "its surface is not closed"),
        (np.concatenate([block([1, 1, 1])[:2], block([1, 1, 1])[:2, ::-1]]), "it encloses no volume"),
        (None, "not found"),
    ],
)
def test_a_part_without_a_solid_is_a_point_mass_with_a_remark(tmp_path, triangles, reason):
    if triangles is not None:
        write_stl(tmp_path / "b.stl", triangles)
    mechanism = part_of(tmp_path, "[{file: b.stl}]")
    assert not np.any(mechanism.parts["arm"].inertia)
    (said,) = mechanism.source.remarks
    assert said.startswith("arm is a point mass at its origin: no solid is known of b.stl (") and reason in said
    assert "Give its 'inertia'." in said
    assert "inertia: [0, 0, 0]" in mechanism_text(mechanism.source)  # a recording does not look for the mesh again


def test_a_center_keeps_the_point_mass(tmp_path):
    write_stl(tmp_path / "b.stl", block([1, 1, 1]))
    mechanism = part_of(tmp_path, "[{file: b.stl}]", "mass: 2, center: [0.1, 0, 0]")
    assert mechanism.parts["arm"].center.tolist() == [0.1, 0.0, 0.0]
    assert "arm is a point mass at its 'center'" in Simulation(mechanism).remarks[0]


@pytest.mark.parametrize("keys", ["mass: 2, inertia: [1, 1, 1]", "mass: 2, shape: {type: sphere, radius: 0.1}"])
def test_an_inertia_and_shapes_with_mass_come_first(tmp_path, keys):
    write_stl(tmp_path / "b.stl", block([1, 1, 1], [3, 0, 0]))
    mechanism = part_of(tmp_path, "[{file: b.stl}]", keys)
    assert not np.any(mechanism.parts["arm"].center) and not mechanism.source.remarks
    assert mechanism.source.text is not None


def test_a_scale_of_zero_is_refused(tmp_path):
    write_stl(tmp_path / "b.stl", block([1, 1, 1]))
    with pytest.raises(MechanismError, match=r"m.yaml:2: parts.arm: has meshes without volume"):
        part_of(tmp_path, "[{file: b.stl, scale: [1, 0, 1]}]")


def test_repeated_parts_keep_their_solids_when_their_number_changes(tmp_path):
    write_stl(tmp_path / "b.stl", block([1, 1, 1]))
    text = """
mechanism: m
parameters: {n: 2}
parts: {'p{i}': {for: {i: 1..n}, mass: 1, meshes: [{file: b.stl}]}}
joints: {'j{i}': {for: {i: 1..n}, type: free, between: [ground, 'p{i}']}}
"""
    mechanism = parse_mechanism(text, str(tmp_path / "m.yaml"))
    more = with_values(mechanism, {"n": 3})
    assert len(more.parts) == 3
    assert all(np.allclose(part.inertia, np.eye(3) / 6.0, rtol=1e-12) for part in more.parts.values())


def test_an_open_surface_is_told_from_a_closed_one_with_duplicates():
    cube = block([1, 1, 1])
    with pytest.raises(MeshError, match="not closed"):
        solid(np.concatenate([cube, cube[:1]]))
    degenerate = np.repeat(cube[:1, :1], 3, axis=1)
    assert solid(np.concatenate([cube, degenerate]))["volume"] == pytest.approx(1.0)


ROBOT = """<robot name="r"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1"/></inertial>
<visual><geometry><mesh filename="meshes/a.stl"/></geometry></visual>
<visual><geometry><mesh filename="package://robot/meshes/a.stl"/></geometry></visual></link>
<joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""


def test_meshes_of_a_robot_that_is_extended_from_another_folder(tmp_path, capsys):
    """They count from the folder of the URDF; `convert` prints URIs that count anywhere (they were lost)."""
    from mbd_sim.cli.main import main
    from mbd_sim.pictures.shapes.meshes import undrawn_meshes

    (
        (tmp_path / "vendor" / "robot" / "meshes").mkdir(parents=True),
        (tmp_path / "mine").mkdir(),
        (tmp_path / "out").mkdir(),
    )
    write_stl(tmp_path / "vendor" / "robot" / "meshes" / "a.stl", block([1, 1, 1]))
    (tmp_path / "vendor" / "robot" / "r.urdf").write_text(ROBOT)
    (tmp_path / "mine" / "m.yaml").write_text("urdf: ../vendor/robot/r.urdf\njoints: {j: {damping: 1}}\n")
    extended = load_mechanism(tmp_path / "mine" / "m.yaml")
    assert undrawn_meshes(extended) == []
    assert [mesh.file for mesh in extended.parts["arm"].meshes] == ["../vendor/robot/meshes/a.stl"] * 2
    for source, to in (("mine/m.yaml", "yaml"), ("mine/m.yaml", "urdf"), ("vendor/robot/r.urdf", "yaml")):
        assert main(["convert", str(tmp_path / source), "--to", to]) == 0
        written = tmp_path / "out" / f"c.{to}"
        written.write_text(capsys.readouterr().out)
        assert undrawn_meshes(load_mechanism(written)) == []
    shutil.move(tmp_path / "mine", tmp_path / "vendor" / "robot" / "mine")
    (tmp_path / "vendor" / "robot" / "mine" / "m.yaml").write_text("urdf: ../r.urdf\njoints: {j: {damping: 1}}\n")
    assert undrawn_meshes(load_mechanism(tmp_path / "vendor" / "robot" / "mine" / "m.yaml")) == []
