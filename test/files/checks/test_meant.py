"""Mistakes hide no others: any few of them in one file are all reported at once, in the order of its lines."""

import random
import re
from functools import cache

import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism

FILE = """\
mechanism: machine
parameters:
  l: 0.5 m
ranges:
  l: [0.2, 0.8]
ground:
  points: {wall: [1, 0, 0]}
parts:
  rod:
    mass: 1
    inertia: [1, 1, 1]
    points: {tip: [0, 0, 1]}
  slider: {mass: 2, shape: {type: block, size: [1, 1, 1]}}
  wheel: {shape: {type: disc, radius: 0.2, mass: 1}}
  bob: {mass: 1}
joints:
  hinge: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: 0.3, damping: 2}
  rail: {type: prismatic, between: [ground, slider], axis: [1, 0, 0], limits: {lower: -1, upper: 1}}
  axle:
    type: revolute
    between: [slider, wheel]
    axis: [0, 1, 0]
    friction: {coulomb: 1}
  cage: {type: free, between: [ground, bob]}
constraints:
  roll: {type: rolling, wheel: wheel, radius: 0.2}
  mesh: {type: coupling, terms: {hinge: 1, axle: 2}}
forces:
  spring: {type: spring, between: [rod.tip, ground.wall], stiffness: 10, length: l}
  push: {type: effort, coordinate: rail, effort: "-2*rail.velocity"}
  weight: {type: force, at: rod.tip, vector: [0, 0, 1]}
actuators:
  motor: {type: dc_motor, joint: hinge, torque_constant: 0.1, resistance: 2, gear_ratio: 3}
  cylinder: {type: effort, between: [slider, ground.wall], effort_limit: 3 N}
sensors:
  gyro: {type: imu, at: rod.tip, rate: 100}
  angle: {type: encoder, joint: hinge, counts: 100}
  flow: {type: current, actuator: motor, noise_density: 1}
integrator: {method: rk4, step: 1 ms}
"""
# What is replaced in the file, each once; the key of the problem is that of a single mistake, or of its entry.
MISTAKES = {
    "[0.2, 0.8]": "[0.8, 0.2]",
    "l: [0.2": "ll: [0.2",
    "mass: 1\n": "mas: 1\n",
    "[1, 1, 1]\n": "[1, 1, 9]\n",
    "{tip:": "{tipp:",
    "mass: 2": "mass: -2",
    "type: block": "type: box",
    "radius: 0.2, mass": "radis: 0.2, mass",
    "hinge: {type: revolute": "hinge: {type: revolutee",
    "position: 0.3": "postion: 0.3",
    "damping: 2": "damping: 2 kg",
    "rail: {type: prismatic": "rail: {type: slidingg",
    "[ground, slider], axis": "[grund, slider], axis",
    "lower: -1": "lower: 2",
    "upper: 1": "uper: 1",
    "[slider, wheel]": "[slider, weel]",
    "    axis: [0, 1, 0]": "    axis: [0, 0, 0]",
    "coulomb: 1": "coulom: 1",
    "  cage: {type: free, between: [ground, bob]}": "  # gone",
    "type: rolling": "typ: rolling",
    "wheel: wheel": "wheel: whel",
    "{hinge: 1,": "{hing: 1,",
    "type: spring": "type: sprng",
    "stiffness: 10": "stifness: 10",
    "length: l": "length: k",
    "[rod.tip, ground.wall": "[rod.tip, ground.wal",
    "coordinate: rail": "coordinate: rale",
    "rail.velocity": "rial.velocity",
    "vector: [0, 0, 1]": "vector: [0, 1]",
    "at: rod.tip, vector": "at: rodd.tip, vector",
    "joint: hinge, torque": "joint: hing, torque",
    "gear_ratio: 3": "gear_rato: 3",
    "effort_limit: 3 N": "effort_limit: 3 N*m",
    "at: rod.tip, rate": "at: rod.tap, rate",
    "rate: 100": "rate: 3000",
    "type: encoder": "type: encodr",
    "joint: hinge, counts": "joint: hige, counts",
    "actuator: motor": "actuator: moter",
    "method: rk4": "metod: rk4",
    "forces:": "force:",
}


# Pairs of which the second cannot be judged: without its type, or without the place.
UNKNOWN = (
    {"rail: {type: prismatic", "lower: -1"},
    {"rail: {type: prismatic", "upper: 1"},
    {"{tip:", "at: rod.tip, vector"},
    {"{tip:", "at: rod.tip, rate"},
)
UNCONNECTED = {(15, "is not connected by any joint")}


@cache
def problems_with(*mistakes):
    text = FILE
    for right in mistakes:
        assert text.count(right) == 1, right
        text = text.replace(right, MISTAKES[right])
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text, "m.yaml")
    return caught.value.problems


def named(problems):
    return {(problem.line, problem.message) for problem in problems}


@pytest.mark.parametrize("seed", range(2))
def test_each_of_several_mistakes_is_named_as_if_it_were_the_only_one(seed):
    generator = random.Random(seed)
    for _ in range(12):
        chosen = generator.sample(list(MISTAKES), generator.randint(2, 4))
        if any(pair <= set(chosen) for pair in UNKNOWN):
            continue
        problems = problems_with(*chosen)
        alone = set().union(*(named(problems_with(one)) for one in chosen))
        assert named(problems) | UNCONNECTED == alone | UNCONNECTED, chosen  # which not all files can show
        assert [problem.line for problem in problems] == sorted(problem.line for problem in problems)


def test_a_part_that_nothing_joins_is_named_beside_mistakes_elsewhere():
    cage = "  cage: {type: free, between: [ground, bob]}"
    for other in ("rate: 100", "stiffness: 10", "at: rod.tip, rate"):
        assert named(problems_with(cage, other)) >= UNCONNECTED


KEYS = "type between axis wheel radius terms stiffness coordinate effort vector joint torque_constant resistance"
WRITTEN = [found for found in re.finditer(r"(?<!^  )\b([a-z_]+): ", FILE, re.MULTILINE) if found[1] in KEYS.split()]


def misspelled(key, generator):
    """The key with a letter left out, doubled, or exchanged with the next one."""
    at = generator.randrange(len(key) - 1)
    ways = key[:at] + key[at + 1 :], key[: at + 1] + key[at:], key[:at] + key[at + 1] + key[at] + key[at + 2 :]
    return generator.choice([word for word in ways if word != key])


@pytest.mark.parametrize("seed", range(4))
def test_a_misspelled_required_key_is_one_problem_which_names_both_spellings(seed):
    """It was two: the key was missing, and the word unknown."""
    generator = random.Random(seed)
    for found in generator.sample(WRITTEN, 12):
        word = misspelled(found[1], generator)
        with pytest.raises(MechanismError) as caught:
            parse_mechanism(FILE[: found.start()] + word + FILE[found.end(1) :], "m.yaml")
        (problem,) = caught.value.problems
        assert f"'{word}'" in str(problem) and f"'{found[1]}'" in str(problem), word


def test_a_missing_key_beside_an_unknown_one_of_another_meaning_stays_a_problem():
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(FILE.replace("vector: [0, 0, 1]", "tint: [0, 0, 1]"), "m.yaml")
    assert [problem.message for problem in caught.value.problems] == ["'vector' is missing", "unknown key 'tint'"]


@pytest.mark.parametrize(
    ("entry", "key"),
    [
        ("forces: {f: {type: damper, between: [ground, rod], damping: 3}}", "coefficient"),
        ("forces: {f: {type: couple, part: rod, vector: [0, 0, 1]}}", "on"),
        ("forces: {f: {type: potential, expression: 3*hinge}}", "energy"),
        ("forces: {f: {type: effort, joint: hinge, effort: 1}}", "coordinate"),
        ("constraints: {c: {type: coupling, coefficients: {hinge: 1}}}", "terms"),
        ("constraints: {c: {type: rolling, body: rod, radius: 0.2}}", "wheel"),
        ("constraints: {c: {type: on_plane, body: rod}}", "point"),
        ("constraints: {c: {type: cable, points: [rod, ground], length: 1}}", "through"),
        ("actuators: {a: {type: dc_motor, joint: hinge, kt: 0.1, resistance: 2}}", "torque_constant"),
    ],
)
def test_a_word_for_a_required_key_is_one_problem_that_names_the_key(entry, key):
    """A damper's `damping` was answered with "Did you mean 'along'?"."""
    text = (
        "mechanism: m\nparts: {rod: {mass: 1, inertia: [1, 1, 1]}}\n"
        "joints: {hinge: {type: revolute, between: [ground, rod], axis: [0, 1, 0]}}\n"
    )
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text + entry, "m.yaml")
    (problem,) = caught.value.problems
    assert f"'{key}" in problem.remedy
