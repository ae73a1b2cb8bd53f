"""The report of `mbd_sim check`: degrees, names, round-off, and suspicious angles."""

import re

import pytest

from mbd_sim import Simulation
from mbd_sim.cli.runs.run import simulate
from mbd_sim.files.load import parse_mechanism
from mbd_sim.studies.report.mechanism_report import report
from mbd_sim.studies.report.text import report_text
from test.simulation.contact.test_contact_forces import SOFT_BALL

PENDULUM = """mechanism: pendulum
parts: {rod: {mass: 1, center: [0, 0, -1], inertia: [0.1, 0.1, 0.01]}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: ANGLE}}
"""


def text_of(angle):
    return report_text(report(Simulation.from_text(PENDULUM.replace("ANGLE", angle))))


def test_a_mechanism_with_loops_is_told_how_to_list_its_assembly_modes():
    """With the coordinate that can be its drive, as the command accepts it."""
    found = report(Simulation.from_file("four_bar"))
    assert "mbd_sim kinematics FILE --drive crank_pivot=VALUE --modes\n" in report_text(found)
    assert "NAME=VALUE … --modes\n" in report_text(found | {"degrees_of_freedom": 2})
    for without in ({"closing_joints": []}, {"holonomic": False}, {"degrees_of_freedom": 0}):
        assert "--modes" not in report_text(found | without)


def test_angles_are_shown_in_degrees_as_well():
    assert "[1.047] (60°)" in text_of("60 deg")


def test_an_angle_beyond_a_full_turn_without_a_unit_is_remarked():
    remark = "joints.pin.position is 60 rad (3438°), because it has no unit. Write 60 deg or 60 rad."
    assert remark in text_of("60") and "no unit" not in text_of("60 rad") + text_of("6") + text_of("60 deg")


def test_round_off_is_shown_as_zero_and_equilibria_are_named():
    text = text_of("90 deg")
    assert "potential 0 J, total 0 J" in text
    assert "Equilibrium         at pin = 0\n" in text and not re.search(r"e-1\d\d", text)


def test_components_of_quaternions_are_named():
    ball = PENDULUM.replace("type: revolute", "type: spherical").replace(", axis: [0, 1, 0], position: ANGLE", "")
    assert "Equilibrium         at pin.qw = 1, pin.qx = 0, pin.qy = 0, pin.qz = 0\n" in report_text(
        report(Simulation.from_text(ball))
    )


def test_shapes_that_are_only_drawn_may_stand_beside_the_mass_of_the_part():
    shapes = "shapes: [{type: sphere, radius: 0.1, mass: 0}]"
    part = parse_mechanism(PENDULUM.replace("inertia: [0.1, 0.1, 0.01]", shapes).replace("ANGLE", "1")).parts["rod"]
    assert part.mass == 1.0 and part.center.tolist() == [0.0, 0.0, -1.0] and not part.inertia.any()
    both = parse_mechanism(PENDULUM.replace("0.01]", "0.01], " + shapes).replace("ANGLE", "1")).parts["rod"]
    assert both.inertia[0, 0] == 0.1 and len(both.shapes) == 1


@pytest.mark.parametrize("step, warned", [(0.5, True), (1e-3, False)])
def test_a_large_energy_residual_is_a_warning(step, warned):
    sim = Simulation.from_text(PENDULUM.replace("ANGLE", "1"), method="euler" if warned else None, step=step)
    summary = simulate(sim, 5.0, quiet=True)
    assert bool(re.search(r"WARNING +(a step of 0.5 s is too large|the energy account)", summary)) == warned


def test_compliant_contacts_are_listed_apart_from_one_sided_elements():
    simulation = Simulation.from_text(SOFT_BALL.replace("[0, 0.12, 0]", "[0, 0.099, 0]"))
    found = report(simulation)
    assert found["one_sided"] == {"elements": {}}
    assert found["compliant_contacts"]["floor"]["normal"] == simulation.contacts()["floor"].normal
    assert "Compliant contacts  1\n  floor: slides, force 3.16228\n" in report_text(found)


def test_a_joint_that_slides_with_friction_by_its_load_keeps_its_degree_of_freedom():
    text = report_text(report(Simulation.from_file("slider_crank_friction")))
    assert "One-sided           1 element leaves 1 of 1 degrees of freedom at the start\n" in text


def test_contacts_that_are_not_active_are_listed():
    contacts = "contacts: {floor: {parts: [rod], plane: ground, active: false}}\n"
    ball = PENDULUM.replace("ANGLE", "0").replace("{mass: 1,", "{shape: {type: sphere, radius: 0.1}, mass: 1,")
    line = "Contact             floor: not active, see 'active' in the file\n"
    assert line in report_text(report(Simulation.from_text(ball + contacts)))
    assert "not active" not in report_text(report(Simulation.from_text(ball)))


def test_parameters_are_listed_with_their_values_and_formulas():
    text = PENDULUM.replace("ANGLE", "0") + "parameters: {crank: 55 mm, rod: 'hypot(crank, 2*crank)', count: 3}\n"
    found = report(Simulation.from_text(text))
    assert found["parameters"]["rod"] == {"value": pytest.approx(0.055 * 5**0.5), "given": "hypot(crank, 2*crank)"}
    lines = [line.split() for line in report_text(found).splitlines()]
    assert ["crank", "0.055", "55", "mm"] in lines and ["count", "3"] in lines


def test_where_nothing_is_free_there_is_no_condition_number():
    driven = PENDULUM.replace("position: ANGLE", "drive: t")
    assert "nothing is free to move" in report_text(report(Simulation.from_text(driven)))
