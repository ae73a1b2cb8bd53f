"""Whatever a file holds: a mechanism, or an error that says what is wrong and on which line."""

import copy
import dataclasses
import functools
import inspect
import json
import pickle
import random
import time

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.text.library import shipped

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


LONGEST = 1000.0  # how many times as long as `reference_time` a mechanism of a few parts may take to derive


@functools.cache
def reference_time():
    """The processor time in s that it takes to derive the equations of a double pendulum, without what is imported."""
    mechanism = load_mechanism("double_rod")
    derive_anew = inspect.unwrap(derive)
    derive_anew(mechanism)
    start = time.process_time()
    derive_anew(mechanism)
    return time.process_time() - start


def check_refusal(error, text):
    assert error.problems and str(error)
    for problem in error.problems:
        assert problem.message and problem.file == "file.yaml" and len(str(problem)) < 2000
        assert 1 <= problem.line <= max(1, len(text.splitlines()))


derived = set()  # contents of mechanisms


def answer(text):
    """Parses and derives what has not been derived yet; whatever comes back is checked."""
    try:
        mechanism = parse_mechanism(text, "file.yaml")
    except MechanismError as error:
        check_refusal(error, text)
        return
    content = pickle.dumps(dataclasses.replace(mechanism, source=None))  # all that the equations depend on
    if content in derived:
        return
    longest = LONGEST * reference_time()
    start = time.process_time()
    try:
        assert np.isfinite(derive(mechanism).start_state).all()
        derived.add(content)
    except MechanismError as error:
        check_refusal(error, text)
    assert time.process_time() - start < longest
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


def read(text):
    return yaml.load(text, Loader=yaml.CSafeLoader)


def written(data):
    return yaml.dump(data, Dumper=yaml.CSafeDumper, allow_unicode=True, sort_keys=False)


@st.composite
def mutated_data(draw):
    data = read(draw(st.sampled_from(TEXTS)))
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


@settings(max_examples=12)
@given(mutated_data())
def test_files_with_changed_values_give_a_mechanism_or_an_error(data):
    answer(written(data))


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


@settings(max_examples=12)
@given(mutated_text())
def test_files_with_changed_text_give_a_mechanism_or_an_error(text):
    answer(text)


@settings(max_examples=50)
@given(st.one_of(st.text(max_size=200), st.text(alphabet="[]{}:,&*!|>'\"%@`?-#$ \n\tab1.", max_size=80)))
def test_any_text_gives_a_mechanism_or_an_error(text):
    answer(text)


@settings(max_examples=12)
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


EXPRESSIONS = [
    "t", "t^2", "0.1*sin(5*t)", "sqrt(t)", "1/t", "log(t)", "abs(t - 1)", "exp(exp(exp(exp(t + 3))))", "1e300*t", "t - 0.5",
    "x^2 + y^2 + z^2 - 1", "x/y", "z", "sqrt(-1 - t)", "atan2(x, y)", "0", "0.3 + 0.1*sin(t)",
]  # fmt: skip
NUMBERS = [0, -1, 1, 0.5, 2, 1e-3, 1e-9, 1e-300, 1e3, 1e9, 1e15, 1e150, 1e300, -1e300, "30 deg", "sqrt(2)", "pi/3"]
LABELED = {"cylindrical": (".displacement", ".angle"), "universal": (".first", ".second"), "free": (".x", ".z")}
JOINTS = ["revolute", "prismatic", "fixed", "free", "screw", "cylindrical", "universal", "planar", "spherical"]


class Changer:
    """Changes that leave a file a mechanism more often than not: other numbers, more joints, more constraints."""

    def __init__(self, seed):
        self.chance = random.Random(seed)
        self.data = read(self.chance.choice(TEXTS))

    def end(self):
        parts = {"ground": self.data.get("ground") or {}, **self.data["parts"]}
        name = self.chance.choice(list(parts))
        return self.chance.choice([name, *(f"{name}.{point}" for point in parts[name].get("points", {}))])

    def direction(self):
        return self.chance.choice([[0, 0, 1], [1, 0, 0], [0, -1, 0], [1, 2, 3]])

    def coordinate(self):
        joints = self.data["joints"].items()
        return self.chance.choice([name + label for name, j in joints for label in LABELED.get(j.get("type"), ("",))])

    def expression(self):
        return self.chance.choice(EXPRESSIONS)

    def joint(self):
        kind = self.chance.choice(JOINTS)
        joint = {"type": kind, "between": [self.end(), self.end()], "cut": self.chance.random() < 0.3}
        if kind == "universal":
            joint["axes"] = [self.direction(), self.direction()]
        elif kind not in ("fixed", "free", "spherical"):
            joint["axis"] = self.direction()
        if kind == "screw":
            joint["lead"] = self.chance.choice([0, 0.1, 1])
        return joint

    def constraint(self):
        ends, two, normal = self.end(), [self.end(), self.end()], self.direction()
        pair = [self.coordinate(), self.coordinate()]
        return self.chance.choice(
            [
                {"type": "distance", "between": two, "length": self.expression()},
                {"type": "cable", "through": [ends, *two], "length": 1},
                {"type": "on_plane", "point": ends, "plane": two[0], "normal": normal},
                {"type": "on_line", "point": ends, "line": two[0], "direction": normal},
                {"type": "on_surface", "point": ends, "frame": two[0], "equation": self.expression()},
                {"type": "on_curve", "point": ends, "equations": [self.expression(), self.expression()]},
                {"type": "gear", "joints": pair, "radii": [1, 0.3]},
                {"type": "rack", "pinion": pair[0], "rack": pair[1], "radius": 0.3},
                {"type": "coupling", "terms": dict.fromkeys(pair, 1), "value": self.expression()},
                {"type": "rolling", "wheel": ends, "radius": 0.3, "normal": normal, "axis": self.direction()},
                {"type": "knife_edge", "at": ends, "direction": self.direction(), "normal": normal},
            ]
        )

    def change(self):
        chance, data, joints = self.chance, self.data, self.data["joints"]
        match chance.choice(
            ["number", "number", "text", "type", "guess", "joint", "twice", "constraint", "constraint"]
        ):
            case "number":
                self._replace((int, float), lambda: chance.choice([*NUMBERS, chance.gauss(0, 1)]))
            case "text":
                self._replace(str, self.expression)
            case "type":
                joints[chance.choice(list(joints))]["type"] = chance.choice(JOINTS)
            case "guess":
                joints[chance.choice(list(joints))] |= {"guess": True, "position": chance.choice([0, 1, -2, 3])}
            case "joint":
                joints[f"new{len(joints)}"] = self.joint()
            case "twice":
                name = chance.choice(list(joints))
                kept = ("type", "between", "axis", "axes", "lead")
                joints[f"{name}_twice"] = {key: copy.deepcopy(joints[name][key]) for key in kept if key in joints[name]}
            case "constraint":
                constraints = data.setdefault("constraints", {})
                constraints[f"new{len(constraints)}"] = self.constraint()

    def _replace(self, kind, value):
        found = [path for path in places(self.data) if path and isinstance(holder_of(self.data, path)[path[-1]], kind)]
        path = self.chance.choice([path for path in found if path[0] in ("ground", "parts", "joints", "constraints")])
        if path[-1] != "type":
            holder_of(self.data, path)[path[-1]] = value()


@settings(max_examples=4)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_other_mechanisms_are_derived_or_refused(seed, count):
    changer = Changer(seed)
    for _ in range(count):
        changer.change()
    answer(written(changer.data))
