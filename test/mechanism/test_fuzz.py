"""Whatever a file holds: a mechanism, or an error that says what is wrong and on which line."""

import json

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mbd_sim.errors import MechanismError
from mbd_sim.mechanism.library import shipped
from mbd_sim.mechanism.load import parse_mechanism

TEXTS = [path.read_text(encoding="utf-8") for path in shipped().values()]
TEXTS += [
    """
mechanism: everything
parameters: {a: 1 ft, b: a/2, c: "${b} kg"}
gravity: [0, 0, -9.81]
integrator: {method: rk4, step: 1 ms}
ground: {points: {o: [a, 0, 0], p: {at: [0, b, 0], rotate: {rpy: [0, 0, 1]}}}}
parts:
  one:
    mass: 10
    shapes: [{type: block, size: [1, 1, 1]}, {type: cylinder, radius: 0.1, length: 1, axis: [1, 1, 0], hole: true}]
    points: {q: {at: [0, 0, b], rotate: {axis: [0, 1, 1], angle: 30 deg}}, r: [0, 0, 1]}
  two: {mass: c, center: [0, 0, 1], inertia: {xx: 1, yy: 2, zz: 2.5, xy: 0.1}}
  three: {shapes: [{type: disc, radius: 1, mass: 1}, {type: ring, radius: 1, mass: 1}, {type: plate, size: [1, 2], mass: 1}]}
joints:
  slide: {type: prismatic, between: [ground.p, one.q], axis: [1, 0, 0], limits: {lower: -1, upper: 1, stiffness: 9}}
  hinge: {type: revolute, between: [two, one.r], axis: [0, 0, 1], stiffness: 1, rest: 1, damping: 1, effort_limit: 1}
  flight: {type: free, between: [ground.o, three], orientation: {quaternion: [1, 0, 1, 0]}, velocity: [1, 2, 3]}
"""
]

scalars = st.one_of(
    st.sampled_from(
        [
            None, True, False, 0, -1, 1e308, -1e308, 1e-320, 10**400, float("nan"), float("inf"), "", " ", ".", "a.b.c",
            "ground", "rod", "rod.tip", "m", "l/2", "${l", "${l/2}", "${l} mm", "30 deg", "5 m**999999999", "1 kg/0",
            "1 " + "m*" * 40, "9" * 400, "1/0", "9**9**9**9", "0**-1", "sqrt(-1)", "-" * 400 + "1", "(" * 200,
            "__import__('os').system('true')", "nan", "inf", "<<", "*a", "&a", "!!float 1", "#ffffff", "revolute", "free",
            "fixed", "disc", "\ufeff", "\u202e", "²", "½ m", "é" * 100, "\x1b[31m",
        ]
    ),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
)  # fmt: skip
lists = st.recursive(st.just([]), lambda inner: st.lists(inner, min_size=1, max_size=2), max_leaves=30)
values = st.one_of(
    scalars,
    lists,
    st.lists(scalars, max_size=5),
    st.dictionaries(st.one_of(st.text(max_size=8), st.sampled_from(["type", "mass", "axis", "at", "to"])), scalars, max_size=3),
)  # fmt: skip


def answer(text):
    """Parses; whatever comes back is checked."""
    try:
        mechanism = parse_mechanism(text, "file.yaml")
    except MechanismError as error:
        assert error.problems and str(error)
        for problem in error.problems:
            assert problem.message and problem.file == "file.yaml" and len(str(problem)) < 2000
            assert 1 <= problem.line <= max(1, len(text.splitlines()))
        return
    for part in mechanism.parts.values():
        assert np.isfinite([part.mass, *part.center, *part.inertia.flat]).all() and part.mass >= 0
    for joint in mechanism.joints.values():
        poses = [*joint.parent_pose.rotation.flat, *joint.child_pose.rotation.flat]
        assert np.isfinite([*joint.axis, *joint.position, *joint.velocity, *poses]).all()


def places(data, path=()):
    """The path of every value."""
    yield path
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from places(value, (*path, key))


def holder_of(data, path):
    for key in path[:-1]:
        data = data[key]
    return data


@st.composite
def mutated_data(draw):
    data = yaml.safe_load(draw(st.sampled_from(TEXTS)))
    for _ in range(draw(st.integers(1, 4))):
        paths = [path for path in places(data) if path]
        if not paths:
            break
        path = draw(st.sampled_from(paths))
        holder, key = holder_of(data, path), path[-1]
        match draw(st.sampled_from(["replace", "delete", "swap", "rename", "repeat"])):
            case "replace":
                holder[key] = draw(values)
            case "delete":
                del holder[key]
            case "swap":
                other = draw(st.sampled_from(paths))
                if other[: len(path)] != path and path[: len(other)] != other:
                    other_holder = holder_of(data, other)
                    holder[key], other_holder[other[-1]] = other_holder[other[-1]], holder[key]
            case "rename" if isinstance(holder, dict):
                holder[draw(st.one_of(st.text(max_size=5), st.sampled_from(["mass", "type", "ground"])))] = holder.pop(
                    key
                )
            case _:
                holder[key] = [holder[key]] * 3
    return data


@settings(max_examples=300)
@given(mutated_data())
def test_files_with_changed_values_give_a_mechanism_or_an_error(data):
    answer(yaml.safe_dump(data, allow_unicode=True, sort_keys=False))


@st.composite
def mutated_text(draw):
    text = draw(st.sampled_from(TEXTS))
    for _ in range(draw(st.integers(1, 3))):
        lines = text.splitlines(keepends=True) or [""]
        i, j = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines) - 1))
        k = draw(st.integers(0, len(text)))
        match draw(st.sampled_from(["drop", "swap", "double", "insert", "cut", "indent"])):
            case "drop":
                del lines[i]
            case "swap":
                lines[i], lines[j] = lines[j], lines[i]
            case "double":
                lines.insert(j, lines[i])
            case "indent":
                lines[i] = draw(st.sampled_from([" ", "  ", "\t"])) + lines[i]
            case "insert":
                piece = draw(st.one_of(st.text(max_size=6), st.sampled_from(list("[]{}:,&*!|>'\"%@`?-#$\t\x00\n."))))
                lines = [text[:k] + piece + text[k:]]
            case "cut":
                lines = [text[:k] + text[k + draw(st.integers(1, 30)) :]]
        text = "".join(lines)
    return text


@settings(max_examples=300)
@given(mutated_text())
def test_files_with_changed_text_give_a_mechanism_or_an_error(text):
    answer(text)


@settings(max_examples=200)
@given(st.one_of(st.text(max_size=200), st.text(alphabet="[]{}:,&*!|>'\"%@`?-#$ \n\tab1.", max_size=80)))
def test_any_text_gives_a_mechanism_or_an_error(text):
    answer(text)


@settings(max_examples=200)
@given(scalars.filter(lambda value: value is not None))
@pytest.mark.parametrize("key", ["mass", "radius", "axis"])
def test_any_value_in_a_shape_gives_a_mechanism_or_an_error(key, value):
    shape = {"type": "disc", "radius": 1, "mass": 1}
    shape |= {key: [value, 0, 1] if key == "axis" else value}
    file = {
        "mechanism": "one",
        "parts": {"body": {"shapes": [shape, {"type": "particle", "mass": 1, "at": [1, 2, 3]}]}},
        "joints": {"flight": {"type": "free", "between": ["ground", "body"]}},
    }
    answer(json.dumps(file))
