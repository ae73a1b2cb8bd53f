"""Mass, center and inertia from meshes with a mass or a density, and from the material of a part."""

import numpy as np
import pytest

from mbd_sim import MechanismError, parse_mechanism
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.text.yaml_text import mechanism_text
from test.files.text.test_mesh_files import block, block_inertia, write_stl

SIZE = np.array([0.2, 0.3, 0.5])
MASS = 7850.0 * 0.03


@pytest.fixture
def folder(tmp_path):
    outward = block(SIZE)[:, ::-1]
    write_stl(tmp_path / "block.stl", 1000.0 * outward)  # in mm
    write_stl(tmp_path / "open.stl", outward[:-1])
    write_stl(tmp_path / "inside_out.stl", block(SIZE))
    write_stl(tmp_path / "flat.stl", outward * [1.0, 1.0, 0.0])
    return tmp_path


def mechanism_of(folder, part, more=""):
    text = f"mechanism: m\n{more}parts:\n  arm: {part}\n"
    text += "joints: {pin: {type: revolute, between: [ground, arm], axis: [0, 1, 0]}}\n"
    return parse_mechanism(text, str(folder / "m.yaml"))


@pytest.mark.parametrize(
    "part",
    [
        "{mesh: {file: block.stl, scale: 0.001, density: 7850}}",
        "{mesh: {file: block.stl, scale: 0.001}, material: steel}",
        f"{{mesh: {{file: block.stl, scale: [1e-3, -1e-3, 1e-3], mass: {MASS}}}}}",
        "{meshes: [{file: block.stl, scale: 0.001, density: 7.85 g/cm**3}]}",
        "{shape: {type: block, size: [0.2, 0.3, 0.5]}, material: steel}",
        f"{{mesh: {{file: block.stl, scale: 0.001}}, mass: {MASS}}}",
    ],
)
def test_the_ways_to_give_a_mesh_its_mass(folder, part):
    found = mechanism_of(folder, part)
    arm = found.parts["arm"]
    assert arm.mass == pytest.approx(MASS)
    assert arm.inertia == pytest.approx(block_inertia(MASS, SIZE), abs=1e-6)
    again = parse_mechanism(mechanism_text(found.source), "elsewhere.yaml").parts["arm"]
    assert (again.mass, again.inertia.tolist()) == (arm.mass, arm.inertia.tolist())


def test_meshes_and_shapes_of_different_densities_make_one_part(folder):
    part = "{mesh: {file: block.stl, scale: 0.001, density: 1000}, material: lead_bronze, shapes: [{type: block, size: [0.2, 0.3, 0.5], at: [1, 0, 0]}]}"
    arm = mechanism_of(folder, part, "materials: {lead_bronze: 9 g/cm**3}\n").parts["arm"]
    assert arm.mass == pytest.approx(300.0)
    assert arm.center == pytest.approx([0.9, 0.0, 0.0])


def test_a_density_can_be_changed(folder):
    found = mechanism_of(folder, "{mesh: {file: block.stl, scale: 0.001, density: 7850}}")
    assert with_values(found, {"parts.arm.mesh.density": 1000.0}).parts["arm"].mass == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ("{mesh: {file: open.stl, density: 1}}", "m.yaml:3: parts.arm.mesh.file: mass, center and inertia of this mesh are not known: its surface is not closed"),
        ("{mesh: {file: inside_out.stl, density: 1}}", "it is inside out: its triangles face inward (got 'inside_out.stl'). Flip its normals."),
        ("{mesh: {file: flat.stl, density: 1}}", "it encloses no volume"),
        ("{mesh: {file: none.stl}, material: steel}", "not found (got 'none.stl')"),
        ("{mesh: {file: block.stl}, material: stel}", "parts.arm.material: unknown material 'stel'. Did you mean 'steel'?"),
        ("{mesh: {file: block.stl, density: 1}, mass: 2}", "parts.arm.mass: follows from the meshes, which have masses"),
        ("{mesh: {file: block.stl, density: 1, mass: 2}}", "has both mass and density"),
        ("{mesh: {file: block.stl}, material: steel, mass: 2}", "has both material and mass"),
        ("{mesh: {file: block.stl}, meshes: [{file: block.stl}], mass: 2}", "has both mesh and meshes"),
        ("{shape: {type: rod, to: [1, 0, 0]}, material: steel}", "has a rod, which has no volume for the density of a material"),
    ],
)  # fmt: skip
def test_what_gives_no_mass_is_refused_with_the_reason(folder, part, said):
    with pytest.raises(MechanismError) as error:
        mechanism_of(folder, part)
    assert said in str(error.value)
