"""An angle is a dimension of its own: no quantity of the file takes one for nothing, or nothing for one.

The expected factors come from the exponents of the base units alone.
"""

import math
import typing

import pytest
from pydantic import TypeAdapter

from mbd_sim.base.errors import InputError, MechanismError
from mbd_sim.cli.main import main
from mbd_sim.files.checks.json_schema import json_schema
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.schema.fields import ExpressionField, QuantityField, Spec
from mbd_sim.many.sweep.plan import variation
from mbd_sim.simulation.run.simulation import BaseSimulation
from mbd_sim.studies.kinematic_analysis.system import drive_speed, parameter_value

TURN = 2.0 * math.pi
# The factor to SI, and the powers of m, kg, s, A and rad.
UNITS = {
    "": (1.0, 0, 0, 0, 0, 0),
    "rad": (1.0, 0, 0, 0, 0, 1),
    "deg": (TURN / 360, 0, 0, 0, 0, 1),
    "rev": (TURN, 0, 0, 0, 0, 1),
    "turn": (TURN, 0, 0, 0, 0, 1),
    "Hz": (1.0, 0, 0, -1, 0, 0),
    "kHz": (1e3, 0, 0, -1, 0, 0),
    "s**-1": (1.0, 0, 0, -1, 0, 0),
    "rad/s": (1.0, 0, 0, -1, 0, 1),
    "deg/s": (TURN / 360, 0, 0, -1, 0, 1),
    "rpm": (TURN / 60, 0, 0, -1, 0, 1),
    "rev/s": (TURN, 0, 0, -1, 0, 1),
    "Hz*turn": (TURN, 0, 0, -1, 0, 1),
    "s**-2": (1.0, 0, 0, -2, 0, 0),
    "rad/s**2": (1.0, 0, 0, -2, 0, 1),
    "rpm/s": (TURN / 60, 0, 0, -2, 0, 1),
    "mm": (1e-3, 1, 0, 0, 0, 0),
    "m": (1.0, 1, 0, 0, 0, 0),
    "mm/turn": (1e-3 / TURN, 1, 0, 0, 0, -1),
    "mm/rev": (1e-3 / TURN, 1, 0, 0, 0, -1),
    "m/turn": (1.0 / TURN, 1, 0, 0, 0, -1),
    "mm/rad": (1e-3, 1, 0, 0, 0, -1),
    "mm/deg": (0.36 / TURN, 1, 0, 0, 0, -1),
    "m/s": (1.0, 1, 0, -1, 0, 0),
    "m*rpm": (TURN / 60, 1, 0, -1, 0, 1),
    "m/s**2": (1.0, 1, 0, -2, 0, 0),
    "m**2": (1.0, 2, 0, 0, 0, 0),
    "m**3": (1.0, 3, 0, 0, 0, 0),
    "m**3/s": (1.0, 3, 0, -1, 0, 0),
    "cm**3/turn": (1e-6 / TURN, 3, 0, 0, 0, -1),
    "m**3/(s*Pa)": (1.0, 4, -1, 1, 0, 0),
    "s": (1.0, 0, 0, 1, 0, 0),
    "s/rad": (1.0, 0, 0, 1, 0, -1),
    "s/deg": (360 / TURN, 0, 0, 1, 0, -1),
    "s/m": (1.0, -1, 0, 1, 0, 0),
    "kg": (1.0, 0, 1, 0, 0, 0),
    "kg/m**3": (1.0, -3, 1, 0, 0, 0),
    "kg*m**2": (1.0, 2, 1, 0, 0, 0),
    "kg*m**2/rad**2": (1.0, 2, 1, 0, 0, -2),
    "N": (1.0, 1, 1, -2, 0, 0),
    "N/rad": (1.0, 1, 1, -2, 0, -1),
    "N/m": (1.0, 0, 1, -2, 0, 0),
    "N*s/m": (1.0, 0, 1, -1, 0, 0),
    "N*m": (1.0, 2, 1, -2, 0, 0),
    "J": (1.0, 2, 1, -2, 0, 0),
    "N*m/rad": (1.0, 2, 1, -2, 0, -1),
    "N*m/deg": (360 / TURN, 2, 1, -2, 0, -1),
    "J/turn": (1.0 / TURN, 2, 1, -2, 0, -1),
    "N*m*s": (1.0, 2, 1, -1, 0, 0),
    "N*m*s/rad": (1.0, 2, 1, -1, 0, -1),
    "N*m/rpm": (60 / TURN, 2, 1, -1, 0, -1),
    "Pa": (1.0, -1, 1, -2, 0, 0),
    "V": (1.0, 2, 1, -3, -1, 0),
    "ohm": (1.0, 2, 1, -3, -2, 0),
    "H": (1.0, 2, 1, -2, -2, 0),
    "A": (1.0, 0, 0, 0, 1, 0),
    "N*m/A": (1.0, 2, 1, -2, -1, 0),
    "V*s/rad": (1.0, 2, 1, -2, -1, -1),
    "V/rpm": (60 / TURN, 2, 1, -2, -1, -1),
}


def expected(unit, wanted):
    """The factor between two units; None if they do not fit."""
    wanted = {"N*m/A": "V*s/rad"}.get(wanted, wanted)
    (size, *powers, angles), (si_size, *si_powers, si_angles) = UNITS[unit], UNITS[wanted]
    if powers != si_powers:
        return None
    if angles == si_angles:
        return size / si_size
    return size / (si_size * TURN if wanted == "m/turn" else si_size) if si_angles < 0 and not angles else None


def markers(kind):
    for mark in getattr(kind, "__metadata__", ()):
        if isinstance(mark, QuantityField | ExpressionField):
            yield mark
    for inner in typing.get_args(kind):
        yield from markers(inner)


def records(kind=Spec):
    for inner in kind.__subclasses__():
        yield inner
        yield from records(inner)


def fields():
    json_schema()  # builds the records that are built late
    for record in records():
        for key, field in record.model_fields.items():
            if "fields" not in record.__module__:
                kind = typing.get_type_hints(record, include_extras=True).get(key, field.annotation)
                for mark in markers(kind):
                    yield f"{record.__name__}.{key}", mark


def test_every_quantity_of_the_schema_takes_its_units_with_their_factor_and_refuses_all_others():
    """`3 Hz` was 3 rad/s, `6000 rpm` 628 Hz, and `5 mm/turn` 0.8 mm for a turn."""
    marks = {(name, repr(mark)): mark for name, mark in fields() if mark.unit is not None}
    assert len(marks) > 150 and {"ScrewJointSpec.lead", "ImuSpec.rate"} <= {name for name, _ in marks}
    distinct = {
        repr(mark): (name, mark) for (name, _), mark in sorted(marks.items())
    }  # a field depends on its mark alone
    tried = set()
    for number, (name, mark) in enumerate(distinct.values()):
        wanted, adapter, of_all = mark.unit, TypeAdapter(typing.Annotated[float, mark]), sorted(UNITS.keys() - {""})
        # All units for each wanted one; of other fields in the same unit, which have other limits, some.
        for unit in of_all[number % 8 :: 8] if (type(mark), wanted) in tried else of_all:
            factor = expected(unit, wanted)
            size = 0.9 if factor is None else 0.9 / max(factor, 1.0)
            try:
                value = adapter.validate_python(f"{size!r} {unit}")
            except ValueError as error:
                assert factor is None and "does not fit" in str(error), (name, unit, str(error))
            else:
                assert factor is not None, (name, wanted, unit, value)
                found = value if isinstance(value, float) else value.value(dict.fromkeys(value.variables, 0.3))
                assert found == pytest.approx(size * factor, rel=1e-12), (name, unit)
        tried.add((type(mark), wanted))


SCREW = """
mechanism: screw
parameters: {p: 5 mm/turn, k: 2 N*m/deg}
parts: {nut: {mass: 1, inertia: [1, 1, 1]}, disc: {mass: 1, inertia: [1, 1, 1]}, cart: {mass: 1}}
joints:
  thread: {type: screw, between: [ground, nut], axis: [0, 0, 1], lead: LEAD}
  hinge: {type: revolute, between: [ground, disc], axis: [0, 0, 1], stiffness: k, velocity: VELOCITY}
  rail: {type: prismatic, between: [ground, cart], axis: [0, 0, 1]}
actuators:
  motor: {type: effort, joint: rail, lead: 10 mm/turn, gear_ratio: 2, rotor_inertia: 1e-3}
sensors:
  imu: {type: imu, at: cart, rate: 100 Hz}
SECTION
"""


def screw(lead="5 mm", velocity="0", section=""):
    return parse_mechanism(
        SCREW.replace("LEAD", lead).replace("VELOCITY", velocity).replace("SECTION", section), "f.yaml"
    )


@pytest.mark.parametrize("lead", ["5 mm/turn", "5 mm/rev", "5 mm", "0.005", "0.8 mm/rad", "2*pi*p"])
def test_a_lead_is_the_travel_for_one_turn(lead):
    nominal = 0.8e-3 * TURN if "rad" in lead else 5e-3
    assert screw(lead).joints["thread"].lead == pytest.approx(nominal, rel=1e-14)


def test_a_torsion_spring_is_per_rad_where_its_unit_has_no_angle():
    for stiffness, value in {"3 N*m": 3.0, "3 N*m/rad": 3.0, "3": 3.0, "3 N*m/deg": 540 / math.pi}.items():
        joint = with_values(screw(), {"joints.hinge.stiffness": stiffness}).joints["hinge"]
        assert joint.stiffness == pytest.approx([value])


MISTAKES = {
    "lead: p": "the parameter 'p' is in mm/turn, and so counts per rad; a value in m/turn is expected here",
    "velocity: 3 Hz": "the unit 'Hz' does not fit: a value in rad/s is expected here (got '3 Hz'). It has no angle. "
    "Write for example 0.5 rad/s, or 0.5 rev/s for turns.",
    "rate: 6000 rpm": "the unit 'rpm' does not fit: a value in Hz is expected here (got '6000 rpm'). It has an angle. "
    "Write for example 0.5 Hz; in turns, 1 rpm is 0.0166667 Hz.",
    "position: k": "the parameter 'k': the unit 'N*m/deg' does not fit: a value in rad is expected here",
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_does_not_fit_is_refused_with_the_remedy(mistake):
    key, value = mistake.split(": ")
    changes = {"lead": "joints.thread.lead", "rate": "sensors.imu.rate"}.get(key, f"joints.hinge.{key}")
    with pytest.raises(MechanismError) as caught:
        with_values(screw(), {changes: value})
    assert MISTAKES[mistake] in str(caught.value)


BUSHING = "forces: {b: {type: bushing, between: [nut, disc], stiffness_matrix: %s}}"
OF_UNKNOWN_DIMENSION = {  # sections whose units depend on other keys, and what they refuse
    "constraints: {c: {type: coupling, terms: {thread: 1, hinge: 2}, value: 30 deg, backlash: 1 deg}}": "",
    "constraints: {c: {type: coupling, terms: {thread: 1, hinge: 2}, value: 3 Hz}}": "constraints.c.value",
    "constraints: {c: {type: coupling, terms: {thread: 1, hinge: 2}, value: 3 mm}}": "constraints.c.value",
    "constraints: {c: {type: coupling, terms: {thread: 0.01, rail: 2}, value: 3 mm}}": "",
    "constraints: {c: {type: coupling, terms: {thread: 1, hinge: 2}, backlash: 3 mm/turn}}": "constraints.c.backlash",
    "constraints: {c: {type: rack, pinion: hinge, rack: rail, radius: 1 cm, backlash: 1 deg}}": "constraints.c.backlash",
    "constraints: {c: {type: rack, pinion: hinge, rack: rail, radius: 5 mm/turn}}": "constraints.c.radius",
    "constraints: {c: {type: clutch, terms: {hinge: 1}, capacity: 3 N*m}}": "",
    "constraints: {c: {type: clutch, terms: {hinge: 1}, capacity: 3 N*m/rad}}": "constraints.c.capacity",
    "constraints: {c: {type: clutch, terms: {rail: 1}, capacity: 3 N*m}}": "constraints.c.capacity",
    BUSHING
    % str([[f"{1 + (i == j)} N{'*m' * (i > 2)}/{'rad' if j > 2 else 'm'}" for j in range(6)] for i in range(6)]): "",
    BUSHING % str([["1 N/m" if i == j else 0 for j in range(6)] for i in range(6)]): "forces.b.stiffness_matrix[3][3]",
}


@pytest.mark.parametrize("section", OF_UNKNOWN_DIMENSION)
def test_units_that_depend_on_other_keys_are_checked(section):
    """The values of couplings, clutches and matrices took any unit."""
    key = OF_UNKNOWN_DIMENSION[section]
    if not key:
        assert screw(section=section)
        return
    with pytest.raises(MechanismError, match="does not fit") as caught:
        screw(section=section)
    assert caught.value.problems[0].key == key and caught.value.problems[0].line


def test_a_compliant_contact_takes_a_unit_only_if_it_fits_its_exponent():
    text = "mechanism: m\nparts: {a: {mass: 1, shape: {type: sphere, radius: 1}}}\njoints: {f: {type: free, between: [ground, a]}}\n"
    text += "contacts: {c: {parts: [a], plane: ground, stiffness: %s, exponent: %s}}"
    assert parse_mechanism(text % ("5 N/mm", 1)).contacts[0].law.stiffness == 5000.0
    for stiffness, exponent in (("5 N/mm", 1.5), ("5 N*m/rad", 1), ("5 N/m", 2)):
        with pytest.raises(MechanismError, match=r"contacts\.c\.stiffness"):
            parse_mechanism(text % (stiffness, exponent))


def test_values_of_runs_sweeps_and_studies_have_the_unit_of_their_key():
    """A varied lead was taken per rad, whatever its unit said."""
    mechanism, key = screw(), "joints.thread.lead"
    assert variation(f"{key}=4 mm/turn,3 mm/rad", mechanism).values == pytest.approx((0.004, 0.003 * TURN))
    assert parameter_value(f"{key}=0.1 mm/turn", mechanism) == (key, pytest.approx(1e-4))
    simulation = BaseSimulation(mechanism, live=["joints.hinge.stiffness"])
    simulation.set_live({"joints.hinge.stiffness": "1 N*m/turn"})
    assert simulation.live["joints.hinge.stiffness"] == pytest.approx(1.0 / TURN)
    for refused in ("joints.hinge.velocity=1,3 Hz", "sensors.imu.rate=10 rpm"):
        with pytest.raises(Exception, match="does not fit"):
            variation(refused, mechanism)
    with pytest.raises(InputError, match="does not fit"):
        drive_speed("3 Hz", mechanism, [type("Drive", (), {"name": "hinge", "start": 0, "stop": 1})])


def test_the_command_line_refuses_cycles_as_angles(capsys):
    assert main(["check", "rod_pendulum", "--set", "joints.pin.velocity=3 Hz"]) != 0
    assert "does not fit" in capsys.readouterr().err
