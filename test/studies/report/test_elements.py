"""Forces and actuators in the report of `mbd_sim check`: type, place, and what they depend on."""

import pytest

from mbd_sim.files.load import parse_mechanism
from mbd_sim.simulation.run.simulation import BaseSimulation
from mbd_sim.studies.report.elements import actuator_report, force_reports
from mbd_sim.studies.report.mechanism_report import report
from mbd_sim.studies.report.text import report_text

TEXT = """
mechanism: text
parameters: {k: 5}
ground: {points: {wall: [-2, 0, 0.5]}}
parts: {box: {mass: 1, inertia: [1, 1, 1]}, arm: {mass: 1, inertia: [1, 1, 1]}}
joints:
  rail: {type: prismatic, between: [ground, box], axis: [1, 0, 0]}
  hinge: {type: spherical, between: [box, arm], stiffness: 2}
"""
FORCES = {
    "{type: spring, between: [ground.wall, box], stiffness: k, length: 1, damping: 1}": ("spring", "ground – box", ["x", "x.velocity"]),
    "{type: spring, between: [ground.wall, box], force: k*x**3}": ("spring by law", "ground – box", ["x"]),
    "{type: line_force, between: [ground.wall, box], force: k*x.velocity + rail}": ("spring by law", "ground – box", ["rail", "x.velocity"]),
    "{type: elastic_bar, between: [ground.wall, box], stiffness: 1, length: 1}": ("elastic_bar", "ground – box", ["x"]),
    "{type: damper, between: [ground.wall, box], coefficient: 1}": ("damper", "ground – box", ["x.velocity"]),
    "{type: damper, between: [ground.wall, box], coefficient: 1, along: velocity}": ("damper", "ground – box", ["relative velocity"]),
    "{type: force, at: box, vector: [k, sin(t), -rail.velocity]}": ("force", "box", ["rail.velocity", "t"]),
    "{type: couple, on: arm, vector: [0, 0, 1]}": ("couple", "arm", []),
    "{type: effort, coordinate: rail, effort: -k*rail}": ("effort", "rail", ["rail"]),
    "{type: potential, energy: k*rail**2}": ("potential", "rail", ["rail"]),
    "{type: bushing, between: [ground, arm], stiffness: 1, damping: 1}":
        ("bushing", "ground – arm", ["relative position", "relative velocity"]),
}  # fmt: skip


@pytest.mark.parametrize("entry", FORCES)
def test_a_force_is_listed_with_what_it_acts_and_depends_on(entry):
    found = force_reports(parse_mechanism(f"{TEXT}forces:\n  it: {entry}\n"))
    kind, at, depends = FORCES[entry]
    assert found[0] == {"name": "it", "type": kind, "at": at, "depends_on": depends}
    assert found[1:] == [
        {"name": "hinge", "type": "joint spring", "at": "box – arm", "depends_on": ["relative position"]}
    ]


CYLINDER = "areas: [10 cm^2, 8 cm^2], stroke: 0.5, dead_volumes: [1e-4, 1e-4]"
ACTUATORS = {
    "{type: effort, joint: rail, effort_limit: 5 N, delay: 4 ms}": ("effort", ["5 N"]),
    "{type: dc_motor, joint: rail, torque_constant: 1, resistance: 1, lead: 1, voltage_limit: 24}": ("dc_motor", ["24 V"]),
    "{type: hydraulic_cylinder, joint: rail, " + CYLINDER + ", rated_flow: 1e-4, supply: 1e7}":
        ("hydraulic_cylinder", ["pushes 1e+04 N", "pulls 8000 N", "stroke 0.5 m"]),
    "{type: pneumatic_cylinder, joint: rail, " + CYLINDER + ", conductance: 1e-8, supply: 6 bar, exhaust: 1 bar}":
        ("pneumatic_cylinder", ["pushes 500 N", "pulls 400 N", "stroke 0.5 m"]),
}  # fmt: skip


@pytest.mark.parametrize("entry", ACTUATORS)
def test_an_actuator_is_listed_with_its_limits(entry):
    (actuator,) = parse_mechanism(f"{TEXT}actuators:\n  it: {entry}\n").actuators
    found = actuator_report(actuator)
    assert (found["type"], found["limits"], found["at"], found["servo"]) == (*ACTUATORS[entry], "rail", None)


def test_the_text_has_a_line_for_each():
    servo = "servo: {controls: position, kp: 1, sample_rate: 500 Hz}"
    text = TEXT + "forces: {push: {type: force, at: box, vector: [1, 0, 0]}}\nactuators:\n"
    text += "  motor: {type: effort, joint: rail, delay: 4 ms, " + servo + "}\n"
    lines = [" ".join(line.split()) for line in report_text(report(BaseSimulation.from_text(text))).splitlines()]
    assert "push force box constant" in lines
    assert "motor effort rail position, 500 Hz position, velocity, effort, 0.004 s later" in lines
