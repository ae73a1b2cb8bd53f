"""Every kind of force element has all that the package needs to know of it: a new one fails here until it is complete."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.base.geometry.pose import identity_pose
from mbd_sim.cli.mechanisms.convert import WRITERS
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.kinematics.parameters import add_leaves
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.schema.forces import AnyForceSpec
from mbd_sim.files.urdf.writer import left_out
from mbd_sim.mechanism.elements.forces import ForceElement
from mbd_sim.pictures.drawing.picture import mechanism_sheet
from mbd_sim.pictures.drawing.sheet import ScaledView, view_of
from mbd_sim.pictures.shapes.extent import extent_of
from mbd_sim.pictures.shapes.primitives import connectors, primitives
from mbd_sim.studies.kinematic_analysis.parametric import without_forces
from mbd_sim.studies.report.elements import force_reports
from test.generators.mechanisms import accelerations
from test.oracles import kane

ROOT = Path(__file__).parents[3]
KEYS = {
    "spring": "between: [ground.peg, rod.tip], stiffness: 50, length: 0.2",
    "elastic_bar": "between: [ground.peg, rod.tip], stiffness: 50, length: 0.9",
    "damper": "between: [ground.peg, rod.tip], coefficient: 5",
    "force": "at: rod.tip, vector: [1, 2, 3]",
    "couple": "on: rod, vector: [1, 2, 3]",
    "line_force": "between: [ground.peg, rod.tip], force: 7*x",
    "bushing": "between: [ground.peg, rod.tip], stiffness: 50",
    "effort": "coordinate: hinge, effort: 3",
    "potential": "energy: 4*hinge.position",
}
FILE = """
mechanism: loaded
ground: {{points: {{peg: [0.3, 0, 0.8]}}}}
parts: {{rod: {{mass: 2, inertia: [0.1, 0.2, 0.3], points: {{tip: [0.5, 0, 0]}}}}}}
joints: {{hinge: {{type: revolute, between: [ground, rod], axis: [0, 1, 0]}}}}
forces: {{{element}}}
"""
Q, U, NONE = np.array([0.3]), np.array([1.5]), np.zeros(1)


def loaded(kind):
    return parse_mechanism(FILE.format(element=f"one: {{type: {kind}, {KEYS[kind]}}}"))


def test_the_schema_the_records_and_these_tests_have_the_same_kinds():
    in_files = [get_args(spec.model_fields["type"].annotation)[0] for spec in get_args(get_args(AnyForceSpec)[0])]
    assert sorted(in_files) == sorted(KEYS)
    assert {type(element) for kind in KEYS for element in loaded(kind).force_elements} == set(get_args(ForceElement))


@pytest.mark.parametrize("kind", KEYS)
def test_the_mechanism_has_it(kind):
    """The builder sorts elements by kind, and a kind without a place there would be lost."""
    assert [element.name for element in loaded(kind).force_elements] == ["one"]


@pytest.mark.parametrize("kind", KEYS)
def test_it_acts_in_both_derivations(kind):
    free = accelerations(derive(parse_mechanism(FILE.format(element=""))), Q, U, NONE, 0.0)
    found = accelerations(derive(loaded(kind)), Q, U, NONE, 0.0)
    assert np.max(np.abs(found - free)) > 0.1
    np.testing.assert_allclose(lagrange_equations(loaded(kind)).accelerations(Q, U, NONE, 0.0), found, rtol=1e-11)
    np.testing.assert_allclose(kane.equations(loaded(kind), Q, U, NONE).accelerations, found, rtol=1e-11)


@pytest.mark.parametrize("kind", KEYS)
def test_its_energy_is_accounted_for(kind):
    """Accelerations do not show a potential, a dissipation or a power that is missing."""
    simulation = Simulation(loaded(kind))
    simulation.reset(q=Q, u=U)
    start = simulation.energies.kinetic
    simulation.step(100)
    energies = simulation.energies
    assert abs(energies.kinetic - start) > 1e-3
    assert abs(energies.residual) < 1e-13 * (energies.kinetic + abs(energies.potential))


@pytest.mark.parametrize("kind", KEYS)
def test_positions_are_studied_without_it(kind):
    assert without_forces(loaded(kind)).force_elements == ()


@pytest.mark.parametrize("kind", KEYS)
def test_its_numbers_can_be_live_values(kind):
    """All but directions, and the shape of a power law; numbers of expressions are names of parameters."""
    (element,) = loaded(kind).force_elements
    leaves: list = []
    add_leaves(element, (), True, leaves)
    fixed = {path[-1] for path, value, live in leaves if not live and isinstance(value, float | np.ndarray)}
    assert fixed <= {"axes", "first_axes", "second_axes", "exponent", "regularization"}


@pytest.mark.parametrize("kind", KEYS)
def test_the_report_names_it(kind):
    assert [report["name"] for report in force_reports(loaded(kind))] == ["one"]


@pytest.mark.parametrize("kind", KEYS)
@pytest.mark.parametrize("to", WRITERS)
def test_every_export_contains_it_or_says_that_it_does_not(to, kind):
    written = WRITERS[to](loaded(kind))
    assert 'name="one"' in written.text or any("one" in text.split(": ")[-1] for text in written.left_out)


def drawn_pieces(mechanism):
    """The number of paths of a drawing, and of primitives, connectors and arrows of a viewer."""
    simulation = Simulation(mechanism)
    poses, extent = simulation.poses(), extent_of(simulation.model)
    paths = mechanism_sheet(ScaledView(view_of(mechanism, poses), 100.0), mechanism, poses, 1.0, []).paths
    start = {"ground": identity_pose(), **poses}
    lists = primitives(mechanism, extent, lambda mesh: True), connectors(mechanism, extent, start), mechanism.applied
    return len(paths), sum(map(len, lists))


@pytest.mark.parametrize("kind", [kind for kind in KEYS if kind != "potential"])  # which has no place
def test_it_is_drawn(kind):
    plain, with_element = drawn_pieces(parse_mechanism(FILE.format(element=""))), drawn_pieces(loaded(kind))
    assert with_element[0] > plain[0] and with_element[1] > plain[1]


@pytest.mark.parametrize("kind", KEYS)
def test_the_reference_page_describes_it(kind):
    assert f"`{kind}`" in (ROOT / "docs" / "mechanism_file.md").read_text(encoding="utf-8")


def test_a_bushing_with_the_name_of_a_joint_is_not_the_spring_of_that_joint():
    mechanism = parse_mechanism(FILE.format(element=f"hinge: {{type: bushing, {KEYS['bushing']}}}"))
    assert left_out(mechanism) == ("springs, dampers and forces: hinge",)
    assert to_mjcf(mechanism).left_out == ("forces, efforts, potentials and bushings: hinge",)
