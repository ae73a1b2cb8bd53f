"""STEP files that OpenCASCADE wrote: masses against closed forms and meshes, the tree, units, and files that are refused."""

import functools
from importlib.util import find_spec

import numpy as np
import pytest

from mbd_sim import InputError, Simulation, load_mechanism
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.cli.main import main
from mbd_sim.files.text.mesh_files import solid
from mbd_sim.imports import step
from mbd_sim.imports.step import read_step
from mbd_sim.mechanism.mass_properties import MassProperties, composite

pytestmark = pytest.mark.skipif(find_spec("OCP") is None, reason="needs OpenCASCADE")


@functools.cache
def cad():
    """The module, with which OpenCASCADE is imported: late, as that takes a second in each process."""
    from test.generators import step_files

    return step_files


STEEL, ALUMINUM = 7850.0, 2700.0


def disc(start, radius, length):
    """A steel cylinder along y from a point, in mm, by its closed form."""
    mass = STEEL * np.pi * radius**2 * length * 1e-9
    across = mass * (3.0 * radius**2 + length**2) / 12.0 * 1e-6
    center = 1e-3 * (np.array(start) + np.array([0.0, length / 2.0, 0.0]))
    return MassProperties(mass, center, np.diag([across, mass * radius**2 / 2.0 * 1e-6, across]))


def expected_crankshaft():
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    bodies = [disc((0, -60, 0), cad().SHAFT, 60), disc((0, 300, 0), cad().SHAFT, 60)]
    for k, angle in enumerate(angles):
        y = cad().PITCH * (k + 0.5)
        pin = (cad().CRANK * np.sin(angle), y - 15, cad().CRANK * np.cos(angle))
        bodies += [disc((0, y - 50, 0), 65, 35), disc((0, y + 15, 0), 65, 35), disc(pin, cad().PIN, 30)]
    return composite(bodies)


def test_an_engine_of_two_materials_becomes_a_mechanism_by_one_command(tmp_path, monkeypatch, capsys):
    """Masses and inertias are those of closed forms and of the meshes; the closed loops assemble where they are."""
    monkeypatch.chdir(tmp_path)
    cad().engine().write(tmp_path / "engine.step")
    line = "import engine.step --density steel --density piston*=aluminum --joints all --joint 5=weld"
    assert main([*line.split(), *(f"--joint=rod{k}_pin{k}=weld" for k in ("", "_2", "_3"))]) == 0
    said = capsys.readouterr()
    assert "engine.step is in millimetre" in said.err + said.out
    assert "1      block – crankshaft     hinge" in said.out
    mechanism = load_mechanism("engine.yaml")
    assert len(mechanism.parts) == 12
    parts = mechanism.parts
    wheel = disc((0, -60, 0), 120, 30), disc((0, -60, 0), cad().SHAFT, 30).scaled(-1.0)
    closed = {
        "flywheel": composite(wheel),
        "crankshaft": expected_crankshaft(),
        "pin": disc((0, -30, 0), cad().WRIST, 60),
    }
    for name, expected in closed.items():
        part, largest = parts[name], np.max(expected.inertia)
        assert part.mass == pytest.approx(expected.mass, rel=1e-9)
        assert part.center == pytest.approx(expected.center, abs=1e-9)
        assert part.inertia == pytest.approx(expected.inertia, abs=1e-9 * largest), name
    for name, part in parts.items():
        found = solid(np.asarray(triangles_of(part, tmp_path)), outward=True)
        density = ALUMINUM if name.startswith("piston") else STEEL
        assert part.mass == pytest.approx(density * found["volume"], rel=1e-2)
        assert part.center == pytest.approx(found["center"], abs=2e-4)
    assert {part.meshes[0].color for name, part in parts.items() if name.startswith("rod")} == {"#b38033"}
    assert (tmp_path / "engine_joints.png").stat().st_size > 10_000


def triangles_of(part, folder):
    from mbd_sim.pictures.shapes.meshes import part_triangles

    ((_, triangles),) = part_triangles(part, str(folder / "engine.yaml"))
    return triangles


def test_one_cylinder_runs(tmp_path, monkeypatch):
    """The crank turns by itself: one degree of freedom besides the redundant conditions, and energy is kept."""
    monkeypatch.chdir(tmp_path)
    cad().engine(1).write(tmp_path / "one.step")
    line = "import one.step --density steel --joints all --joint crankshaft_flywheel=weld --joint rod_pin=weld --force"
    assert main(line.split()) == 0
    text = (tmp_path / "one.yaml").read_text()
    (tmp_path / "one.yaml").write_text(text.replace("block_crankshaft:\n", "block_crankshaft:\n    velocity: 30\n"))
    simulation = Simulation.from_file("one.yaml")
    start = simulation.energies
    simulation.step(100)
    turned = dict(zip(simulation.coordinate_names, simulation.q, strict=True))["block_crankshaft"]
    assert abs(turned) > 2.0
    assert simulation.energies.total == pytest.approx(start.total, rel=1e-6)


def nested(tmp_path, unit="MM"):
    """Two mirrored jaws, each with two pins, in turned sub-assemblies of a vice with names beyond ASCII."""
    assembly = cad().StepAssembly("étau")
    jaw = cad().cut(cad().box((0, 0, 0), (30, 20, 10)), cad().cylinder((5, 5, -1), (0, 0, 1), 2.0, 12.0))
    pin = assembly.product("Stift Ø4", cad().cylinder((0, 0, 0), (0, 0, 1), 2.0, 10.0), (0.2, 0.4, 0.6))
    for name, shape, angle in (("左", jaw, 0.7), ("右", cad().mirrored(jaw, (1, 0, 0)), -0.4)):
        group = assembly.group(f"unit {name}")
        assembly.add("клешня", shape, into=group)
        assembly.place(pin, cad().placement((1, 2, 3), (0, 1, 0), 0.3), into=group)
        assembly.place(pin, cad().placement((-5, 5, 0)), into=group, name="axis {A}")
        assembly.place(group, cad().placement((10, 0, -20), (1, 1, 0), angle))
    return assembly.write(tmp_path / "étau.step", unit)


@pytest.mark.parametrize("unit", ["MM", "INCH", "M"])
def test_nested_mirrored_and_repeated_parts_keep_their_places_in_every_unit(tmp_path, unit):
    assembly = read_step(nested(tmp_path, unit))
    assert assembly.notes[0].split()[-1] in {"MM": "millimetre", "INCH": "inch", "M": "metre"}[unit]
    assert [part.name for part in assembly.parts] == [
        *("клешня", "Stift Ø4", "axis _A_"),
        *("клешня_2", "Stift Ø4_2", "axis _A__2"),
    ]
    left, right = assembly.parts[0], assembly.parts[3]
    volume = (30 * 20 * 10 - np.pi * 4 * 10) * 1e-9
    for jaw, angle, side in ((left, 0.7, 1.0), (right, -0.4, -1.0)):
        turn = cad().rotation((1, 1, 0), angle)
        assert jaw.volume == pytest.approx(volume, rel=1e-9)
        assert jaw.pose.rotation == pytest.approx(turn, abs=1e-12)
        assert jaw.pose.position == pytest.approx([0.01, 0.0, -0.02], abs=1e-12)
        hole = np.pi * 4 * 10 * 1e-9
        x = (30 * 20 * 10e-9 * 0.015 - hole * 0.005) / volume
        assert jaw.bodies[0].body.volume.center[0] == pytest.approx(side * x, rel=1e-9)
    pin = assembly.parts[4]
    inner = Pose(np.array([1e-3, 2e-3, 3e-3]), cad().rotation((0, 1, 0), 0.3))
    expected = right.pose @ inner
    assert pin.pose.position == pytest.approx(expected.position, abs=1e-12)
    assert pin.pose.rotation == pytest.approx(expected.rotation, abs=1e-12)
    assert pin.bodies[0].body is assembly.parts[1].bodies[0].body
    assert pin.bodies[0].color == "#336699"


def test_a_rigid_sub_assembly_is_one_part(tmp_path):
    path = nested(tmp_path)
    separate, joined = read_step(path), read_step(path, ["unit *"])
    assert [part.name for part in joined.parts] == ["unit 左", "unit 右"]
    for group, own in zip(joined.parts, (separate.parts[:3], separate.parts[3:]), strict=True):
        assert len(group.bodies) == 3
        ours = composite([body.body.volume.placed(group.pose @ body.pose) for body in group.bodies])
        theirs = composite([body.body.volume.placed(part.pose) for part in own for body in part.bodies])
        assert ours.center == pytest.approx(theirs.center, abs=1e-12)
        assert ours.inertia == pytest.approx(theirs.inertia, rel=1e-9, abs=1e-20)
        assert group.pose.rotation == pytest.approx(own[0].pose.rotation)
    with pytest.raises(InputError, match="no sub-assembly or component of several solids is called wheel"):
        read_step(path, ["wheel"])


def test_what_is_not_a_solid_is_refused_with_the_reason(tmp_path, monkeypatch):
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.gp import gp_Pln

    sheet = cad().StepAssembly("sheet")
    sheet.add("skin", BRepBuilderAPI_MakeFace(gp_Pln(), 0.0, 1.0, 0.0, 1.0).Shape())
    cases = {
        "the file is empty": b" \n",
        "this is not a STEP file": b"solid x\nendsolid\n",
        "the file is damaged|the file contains no shapes": b"ISO-10303-21;\nHEADER;\nnonsense",
    }
    for said, content in cases.items():
        (tmp_path / "bad.step").write_bytes(content)
        with pytest.raises(InputError, match=said):
            read_step(tmp_path / "bad.step")
    with pytest.raises(InputError, match=r"contains no solids, only surfaces or curves \(skin\)"):
        read_step(sheet.write(tmp_path / "sheet.step"))
    monkeypatch.setattr(step, "MOST_BYTES", 100)
    with pytest.raises(InputError, match="at most 0 MB are read"):
        read_step(tmp_path / "sheet.step")


def test_a_missing_package_is_told_with_the_line_that_installs_it(monkeypatch, tmp_path):
    monkeypatch.setattr("mbd_sim.base.packages._is_installed", lambda module: module != "OCP")
    with pytest.raises(InputError, match="pip install cadquery-ocp-novtk"):
        read_step(tmp_path / "any.step")
