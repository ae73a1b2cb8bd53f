"""The JSON Schema that editors use agrees with what the program accepts."""

import copy
import functools
import json

import jsonschema
import pytest

from mbd_sim.cli.main import main
from mbd_sim.files.checks.json_schema import json_schema, known_keys, known_types
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.text.library import shipped
from mbd_sim.files.text.yaml_text import parse_source
from test.generators.mechanism_texts import PENDULUM, changed, problems_of
from test.generators.mechanisms import KINDS
from test.mechanism.elements import test_actuator_kinds, test_constraints, test_forces, test_joint_types, test_sensors


@functools.cache
def validator():
    """Made by the first test: the schema takes seconds in a process."""
    return jsonschema.Draft202012Validator(json_schema())


def accepts(text):
    return validator().is_valid(parse_source(text).data)


def test_the_command_prints_a_json_schema_of_the_draft_it_names(capsys):
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema == json.loads(json.dumps(json_schema()))
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    jsonschema.Draft202012Validator.check_schema(schema)


def test_a_former_spelling_of_a_key_is_accepted():
    text = PENDULUM.replace("type: revolute", "type: revolute\n    friction: {coulomb: 1, regularisation: 0.1}")
    assert accepts(text) and not accepts(text.replace("regularisation", "regularisatio"))


def test_changing_a_copy_does_not_change_the_schema():
    before = copy.deepcopy(json_schema())
    json_schema()["properties"].clear()
    assert json_schema() == before


@pytest.mark.parametrize("name", [*KINDS, "gear_teeth", "geneva_drive", "jansen_walker", "six_axis_servo_arm", "rover"])
def test_shipped_files_satisfy_it(name):
    """Those with every kind of element, and with outlines, entries for ranges, contacts, actuators and sensors."""
    data = parse_source(shipped()[name].read_text(encoding="utf-8")).data
    assert [error.message for error in validator().iter_errors(data)] == []


# A file with each kind of element: these tests have one of every kind.
OF_EACH_KIND = [
    *((kind, test_joint_types.FILE.format(type=kind, keys=keys)) for kind, keys in test_joint_types.KEYS.items()),
    *(
        (kind, test_forces.FILE.format(element=f"one: {{type: {kind}, {keys}}}"))
        for kind, keys in test_forces.KEYS.items()
    ),
    *((kind, test_constraints.FILE.format(type=kind, keys=keys)) for kind, keys in test_constraints.KEYS.items()),
    *((kind, test_sensors.FILE.format(type=kind, keys=keys)) for kind, keys in test_sensors.KEYS.items()),
    *((kind, test_actuator_kinds.FILE.format(type=kind, keys=keys)) for kind, keys in test_actuator_kinds.KEYS.items()),
]
MANY_KEYS = """
mechanism: all
description: text
parameters: {l: 2 m, k: "l/2", n: 3}
gravity: [0, 0, -1 g0]
integrator: {method: rk4, step: 1 ms}
ground: {points: {a: [0, 0, l], b: {at: [0, 0, 1], rotate: {axis: [0, 0, 1], angle: 3 deg}}}}
parts:
  one:
    mass: 3
    shapes:
      - {type: rod, from: [0, 0, 0], to: [1, 0, 0], mass: 1, radius: 0.1, color: "#123456"}
      - {type: particle, at: [0, 0, 1], rotate: {rpy: [0, 0, 1]}, mass: 1, radius: 1}
      - {type: ring, radius: 1, axis: [0, 1, 0], mass: 1}
      - {type: disc, radius: 1, hole: false, mass: 1}
      - {type: plate, size: [1, 1], mass: 1}
      - {type: cylinder, radius: 1, length: 1, density: 1}
      - {type: sphere, radius: 1, density: 1, name: round}
      - {type: block, size: [1, 1, 1]}
  two: {mass: 20, center: [0, 0, 1], inertia: {xx: 1, yy: 1, zz: 1, xy: 0, xz: 0, yz: 0}}
  three: {mass: 1, inertia: [1, 1, 1], points: {p: {rotate: {quaternion: [1, 0, 0, 0]}}}}
  four: {shapes: [{type: block, size: [1, 2, 3], density: 1}, {type: sphere, radius: 1, mass: 0, name: ball}]}
  five: {mass: 1}
  six: {mass: 1, inertia: [1, 1, 1]}
joints:
  r: {type: revolute, between: [ground.a, one], axis: [1, 0, 0], position: 1, velocity: 1, stiffness: 1, rest: 1,
      damping: 1, limits: {lower: -1, upper: 1, stiffness: 1}, effort_limit: 1}
  p: {type: prismatic, between: [one, two], axis: [1, 0, 0], position: 1, velocity: 1, stiffness: 1, rest: 1,
      damping: 1, limits: {lower: -1, upper: 1}, effort_limit: 1, damper: {coefficient: 1, exponent: 2, regularization: 1}}
  l: {type: prismatic, between: [two, five], axis: [1, 0, 0], spring: {force: 3*x}, friction: {coulomb: 1, static: 2,
      stribeck_velocity: 1, viscous: 1, regularization: 1}, limits: {lower: -1, upper: 1, stiffness: 1, damping: 1}}
  h: {type: revolute, between: [two, six], axis: [1, 0, 0], spring: {table: [[0, 0], [1 deg, 1]]}, damper: {coefficient: 1},
      friction: {coulomb: 1}}
  x: {type: fixed, between: [three.p, two]}
  f: {type: free, between: [ground.b, four], position: [1, 2, 3], orientation: {rpy: [1, 2, 3]}, velocity: [1, 2, 3],
      angular_velocity: [1, 2, 3]}
contacts:
  a: {between: [one.round, four.ball], inside: false, restitution: 0.5, friction: 0.1, static_friction: n*0.1}
  b: {parts: [four], plane: ground.a, normal: [0, 0, 1], friction: 0.1, stiffness: 1e5 N/m, exponent: 1, damping: 1 s/m,
      regularization: 1 mm/s}
  c_{i}: {for: {i: 1..2}, parts: ["three.p"], cam: four, profile: "0.01*l + 0.001*cos(i*angle)"}
  d: {among: [one.round, three.p, four.ball]}
forces:
  s: {type: spring, between: [ground, four], stiffness: 1, length: 1, damping: 1, mass: 1}
  e: {type: spring, between: [one, four], force: n*x**3}
  t: {type: spring, between: [one, four], table: [[0, 1], [1, "n*2"]]}
  b: {type: elastic_bar, between: [one, four], stiffness: 1, length: 1, strain: small, damping: 1}
  d: {type: damper, between: [one, four], coefficient: 1, exponent: 2, along: velocity, regularization: 1}
  f: {type: force, at: three.p, vector: [t, 0, 0], axes: ground.b}
  c: {type: couple, on: four, vector: [0, "sin(t)", 0], axes: three}
actuators:
  d: {type: dc_motor, joint: r, torque_constant: 1, resistance: 1}
ranges: {n: [1, 3]}
sensor_seed: 3
sensors:
  a: {type: imu, at: one, rate: 200 Hz, delay: 5 ms, drop_out: 0.1, orientation: {bias: 1 deg, bias_walk: 1, noise_density: 1},
      angular_velocity: {bias: 1 deg/s, bias_walk: 1, noise_density: n*1, resolution: 1, limit: 1}, specific_force: {limit: 2 g0}}
  b_{i}: {for: {i: 1..2}, type: accelerometer, at: three.p, noise_density: i*0.1, resolution: 1 mm/s^2}
  c: {type: force_torque, joint: x, force: {limit: 3 N}, torque: {bias: 1 N*m}}
  d: {type: encoder, joint: r, counts: n*1024, index: 10 deg, bias: 1 deg, noise_density: 1}
  e: {type: encoder, joint: f.x, resolution: 1 um}
  g: {type: tachometer, joint: p, bias: 1, bias_walk: 1, noise_density: 1 mm/s, resolution: 1, limit: 1}
  h: {type: range, at: one, plane: ground.a, normal: [0, 0, 1], least: 0.1, most: 2, field_of_view: 5 deg, radiation: ultrasound,
      bias: 1 mm, bias_walk: 1, noise_density: 1, resolution: 1 mm}
  m: {type: current, actuator: d, bias: 1 mA, noise_density: 1, bias_walk: 1, resolution: 1 mA, limit: 1 A}
  i: {type: range, at: one, point: four, most: 2}
  j: {type: pose, at: one, position: {bias: 1 mm}, orientation: {bias: 1 deg}}
  k: {type: twist, at: one, axes: frame, velocity: {bias: 1}, angular_velocity: {bias: 1}}
  l: {type: odometry, at: one, position: {bias: 1}, orientation: {bias: 1}, velocity: {bias: 1}, angular_velocity: {bias: 1}}
"""


@pytest.mark.parametrize(("kind", "text"), OF_EACH_KIND)
def test_a_file_with_each_kind_of_element_satisfies_it(kind, text):
    assert [error.message for error in validator().iter_errors(parse_source(text).data)] == []
    assert problems_of(text.replace(f"type: {kind}", f"type: {kind}s"))
    assert not accepts(text.replace(f"type: {kind}", f"type: {kind}s"))


def test_a_file_with_many_keys_satisfies_it_and_loads():
    assert [error.message for error in validator().iter_errors(parse_source(MANY_KEYS).data)] == []
    text = MANY_KEYS.replace("  one:\n    mass: 3\n", "  one:\n    mass: 30\n")
    assert set(parse_mechanism(text).tree) == {"r", "p", "l", "h", "x", "f"}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mechanism: pendulum", "mechanism: two{words}"),
        ("mechanism: pendulum\n", ""),
        ("    mass: m", "    mass: -1"),
        ("    mass: m", "    mass: [1]"),
        ("    mass: m", "    mas: m"),
        ("  rod:\n", "  rod: {}\n  the}rod:\n"),
        ("  l: 1.5 m", "  l: [1]"),
        ("type: rod", "type: blob"),
        ("to: [0, 0, -l]}\n    points", "to: [0, 0]}\n    points"),
        ("{tip: [0, 0, -l]}", "{tip: [0, 0, 0, 0]}"),
        ("type: revolute", "type: hinge"),
        ("[ground, rod]", "[rod]"),
        ("    axis: [0, -1, 0]\n", ""),
        ("position: 90 deg", "position: [1]"),
        ("position: 90 deg", "limits: {lower: 1}"),
        ("position: 90 deg", "friction: {coulomb: [1]}"),
        ("joints:", "contacts: {k: {parts: rod, plane: ground}}\njoints:"),
        ("joints:", "contacts: {k: {parts: [rod], plane: ground, restitution: 2}}\njoints:"),
        ("joints:", "contacts: {k: {parts: [rod], plane: ground, friction: -1}}\njoints:"),
        ("joints:", "contacts: {k: {parts: [rod], plane: ground, stiffness: 1, exponent: 0.5}}\njoints:"),
        ("position: 90 deg", "spring: {table: [[0, 1, 2], [1, 2, 3]]}"),
        ("joints:", "sensors: {k: {type: gyro, at: rod}}\njoints:"),
        ("joints:", "sensors: {k: {type: imu}}\njoints:"),
        ("joints:", "sensors: {k: {type: imu, at: rod, rate: 0}}\njoints:"),
        ("joints:", "sensors: {k: {type: imu, at: rod, drop_out: 2}}\njoints:"),
        ("joints:", "sensors: {k: {type: imu, at: rod, specific_force: {noise: 1}}}\njoints:"),
        ("joints:", "sensors: {k: {type: tachometer, joint: pivot, resolution: 0}}\njoints:"),
        ("joints:", "sensor_seed: -1\njoints:"),
    ],
)
def test_what_it_refuses_the_program_refuses(old, new):
    assert accepts(PENDULUM)
    broken = changed((old, new))
    assert not accepts(broken)
    assert problems_of(broken)


def test_the_keys_of_a_place_are_known_from_its_section():
    assert set(known_keys(())) == set(json_schema()["properties"])
    assert "friction" in known_keys(("contacts", "any")) and "radii" in known_keys(("constraints", "any", "gear"))
    assert "dc_motor" in known_types(("actuators", "any"))
