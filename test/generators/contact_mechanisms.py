"""Random mechanisms with one-sided rows: boxes, balls, chains and loops with stops, ropes, planes, plays and clutches."""

from __future__ import annotations

import json

import numpy as np

from test.generators import contact_loops, contact_shapes

KINDS = ("block", "box", "ball", "chain", "spatial_chain", "four_bar", "rotors", "sliders")  # where none is given
LOOPS = ("four_bar", "slider_crank", "two_loops", "spatial_four_bar")
SHAPES = ("flat_bodies", "spatial_bodies", "cam", "limited_joints")
ALL_KINDS = tuple(dict.fromkeys((*KINDS, *LOOPS, *SHAPES)))


def contact_mechanism(seed, kind=None, restitution=None, friction=None):
    """The text of a random mechanism; `restitution` and `friction` are drawn in 0…1 where they are not given."""
    rng = np.random.default_rng(seed)
    kind = KINDS[int(rng.integers(len(KINDS)))] if kind is None else kind
    draw = Draw(rng, restitution, friction)
    data = _MAKERS[kind](draw)
    return json.dumps({"mechanism": f"{kind}_{seed}", **data})


class Draw:
    """Random numbers, rounded so that the texts are short."""

    def __init__(self, rng, restitution, friction):
        self.rng, self._restitution, self._friction = rng, restitution, friction

    def number(self, low, high):
        return round(float(self.rng.uniform(low, high)), 4)

    def vector(self, size):
        return [round(float(value) * size, 4) for value in self.rng.normal(size=3)]

    def maybe(self, share=0.5):
        return bool(self.rng.random() < share)

    @property
    def restitution(self):
        if self._restitution is not None:
            return self._restitution
        return float(self.rng.choice([0.0, 0.3, 0.5, 0.8, 0.95, 1.0]))

    @property
    def friction(self):
        if self._friction is not None:
            return self._friction
        return float(self.rng.choice([0.0, 0.1, 0.3, 0.5, 0.8, 1.0]))

    def law(self):
        """Restitution and friction of a contact with a plane."""
        mu = self.friction
        static = {"static_friction": round(mu * 1.2, 4)} if mu and self.maybe(0.3) else {}
        return {"restitution": self.restitution, "friction": mu, **static}

    def stops(self, reach):
        return {"lower": self.number(-reach, -0.1), "upper": self.number(0.1, reach), "restitution": self.restitution}

    def joint_friction(self, size, hinge):
        """Sticking friction of a joint, constant or in proportion to its load; {} where friction is 0."""
        mu = self.friction
        if not mu:
            return {}
        if self.maybe():
            return {"friction": {"coefficient": round(0.5 * mu, 4), **({"radius": 0.02} if hinge else {})}}
        return {"friction": {"coulomb": round(size * mu, 4), "sticking": True}}


def _corners(sides, spatial):
    numbers = range(8) if spatial else (0, 1, 4, 5)
    signs = {f"p{i}": [1 if i & bit else -1 for bit in (1, 2, 4)] for i in numbers}
    return {name: [s * side for s, side in zip(sign, sides, strict=True)] for name, sign in signs.items()}


def _planes(draw, points):
    law = draw.law()
    return {f"c{name}": {"type": "on_plane", "point": f"body.{name}", "bound": "at_least", **law} for name in points}


def _body(sides, points):
    return {"shape": {"type": "block", "mass": 1, "size": [2 * side for side in sides]}, "points": points}


def _block(draw):
    sides = [draw.number(0.05, 0.15), 0.05, draw.number(0.03, 0.1)]
    points = _corners(sides, False)
    joint = {"type": "planar", "between": ["ground", "body"], "axis": [0, 1, 0], "x_axis": [1, 0, 0]}
    joint |= {"position": [0, -0.4, draw.number(-3, 3)], "velocity": [draw.number(-2, 2), 0, draw.number(-8, 8)]}
    return {"parts": {"body": _body(sides, points)}, "joints": {"flight": joint}, "constraints": _planes(draw, points)}


def _box(draw):
    sides = [draw.number(0.05, 0.15), draw.number(0.05, 0.1), draw.number(0.03, 0.1)]
    points = _corners(sides, True)
    joint = {"type": "free", "between": ["ground", "body"], "position": [0, 0, 0.4]}
    joint |= {"orientation": {"quaternion": draw.vector(1)[:1] + draw.vector(1)}, "velocity": draw.vector(0.7)}
    joint["angular_velocity"] = draw.vector(4)
    return {"parts": {"body": _body(sides, points)}, "joints": {"flight": joint}, "constraints": _planes(draw, points)}


def _ball(draw):
    joint = {"type": "free", "between": ["ground", "body"], "position": [0, 0, draw.number(0.11, 0.6)]}
    joint |= {"velocity": draw.vector(1), "angular_velocity": draw.vector(15)}
    ball = {"shape": {"type": "sphere", "mass": 1, "radius": 0.1}}
    floor = {"type": "rolling", "wheel": "body", "radius": 0.1, **draw.law()}
    wall = {"type": "on_plane", "point": "body", "plane": "ground.wall", "normal": [-1, 0, 0], "bound": "at_least"}
    wall |= {"restitution": draw.restitution}
    return {
        "ground": {"points": {"wall": [1.0, 0, 0]}},
        "parts": {"body": ball},
        "joints": {"flight": joint},
        "constraints": {"floor": floor, **({"wall": wall} if draw.maybe() else {})},
    }


def _links(draw, axes):
    """A chain of rods from ground, hinged about these axes, with stops and friction."""
    parts, joints, last = {}, {}, "ground"
    for number, axis in enumerate(axes):
        length = draw.number(0.3, 0.8)
        rod = {"type": "rod", "mass": draw.number(0.5, 2), "to": [0, 0, -length]}
        parts[f"l{number}"] = {"shape": rod, "points": {"tip": [0, 0, -length]}}
        joint = {"type": "revolute", "between": [last, f"l{number}"], "axis": axis}
        joint |= {"position": draw.number(-0.09, 0.09), "velocity": draw.number(-4, 4)}
        if draw.maybe(0.6):
            joint["limits"] = draw.stops(1.5)
        if draw.maybe(0.4):
            joint |= draw.joint_friction(0.5, True)
        joints[f"j{number}"], last = joint, f"l{number}.tip"
    return parts, joints, last


def _with_ends(draw, parts, joints, tip, depth):
    """A chain with a floor, ropes or struts at its tip."""
    constraints = {}
    points = {"floor": [0, 0, -depth], "anchor": [draw.number(-0.5, 0.5), 0, draw.number(0.2, 0.6)]}
    if draw.maybe(0.6):
        constraints["floor"] = {"type": "on_plane", "point": tip, "plane": "ground.floor", "bound": "at_least"}
        constraints["floor"] |= draw.law()
    if draw.maybe(0.4) or not constraints:
        constraints["rope"] = {"type": "distance", "between": ["ground.anchor", tip], "length": round(depth + 0.7, 4)}
        constraints["rope"] |= {"bound": "at_most", "restitution": draw.restitution}
    return {"ground": {"points": points}, "parts": parts, "joints": joints, "constraints": constraints}


def _length(parts):
    return sum(-part["points"]["tip"][2] for part in parts.values())


def _chain(draw):
    parts, joints, tip = _links(draw, [[0, 1, 0]] * int(draw.rng.integers(1, 4)))
    return _with_ends(draw, parts, joints, tip, round(_length(parts) * draw.number(1.001, 1.1), 4))


def _spatial_chain(draw):
    axes = [[[0, 1, 0], [1, 0, 0], [1, 1, 0]][int(draw.rng.integers(3))] for _ in range(int(draw.rng.integers(2, 4)))]
    parts, joints, tip = _links(draw, axes)
    return _with_ends(draw, parts, joints, tip, round(_length(parts) * draw.number(1.001, 1.1), 4))


def _four_bar(draw):
    parts = {
        name: {"mass": length, "shape": {"type": "rod", "to": [length, 0, 0]}, "points": {"tip": [length, 0, 0]}}
        for name, length in (("crank", 0.5), ("coupler", 1.4), ("rocker", 1.2))
    }
    hinge = {"type": "revolute", "axis": [0, -1, 0]}
    joints = {
        "crank": {**hinge, "between": ["ground", "crank"], "position": 1.57, "velocity": draw.number(-8, 8)},
        "pin": {**hinge, "between": ["crank.tip", "coupler"], "position": -1.05, "guess": True},
        "rocker": {**hinge, "between": ["ground.pivot", "rocker"], "position": 1.75, "guess": True},
        "loop": {**hinge, "between": ["coupler.tip", "rocker.tip"]},
    }
    constraints = {}
    if draw.maybe():
        reach = draw.number(0.1, 3.0)
        joints["crank"]["limits"] = {
            "lower": 1.57 - reach,
            "upper": 1.57 + 0.7 * reach,
            "restitution": draw.restitution,
        }
    if draw.maybe(0.4):
        joints["crank"] |= draw.joint_friction(0.5, True)
    if draw.maybe(0.4):
        joints["rocker"] |= draw.joint_friction(0.5, True)
    if draw.maybe():
        floor = {"type": "on_plane", "point": "coupler.tip", "plane": "ground.floor", "bound": "at_least", **draw.law()}
        constraints["floor"] = floor
    if draw.maybe(0.3) or not (constraints or "limits" in joints["crank"]):
        rope = {"type": "distance", "between": ["ground.floor", "crank.tip"], "length": draw.number(1.2, 1.5)}
        constraints["rope"] = {**rope, "bound": "at_most", "restitution": draw.restitution}
    points = {"pivot": [1.5, 0, 0], "floor": [0, 0, draw.number(-0.6, 0.6)]}
    return {"ground": {"points": points}, "parts": parts, "joints": joints, "constraints": constraints}


def _rotors(draw):
    """Shafts in line with plays, clutches and brakes, of which a couple turns the first to and fro."""
    count = int(draw.rng.integers(2, 5))
    parts, joints, constraints = {}, {}, {}
    for number in range(count):
        inertia = draw.number(0.02, 0.3)
        parts[f"r{number}"] = {"mass": 1, "center": [0, 0, 0], "inertia": [inertia] * 3}
        joint = {"type": "revolute", "between": ["ground", f"r{number}"], "axis": [1, 0, 0]}
        joints[f"r{number}"] = {**joint, "velocity": draw.number(-5, 5)}
        if draw.maybe(0.4):
            joints[f"r{number}"] |= draw.joint_friction(0.5, True)
    for number in range(count - 1):
        terms = {f"r{number}": 1, f"r{number + 1}": -1}
        choice = int(draw.rng.integers(3))
        if choice == 0:
            made = {"type": "coupling", "terms": terms, "backlash": draw.number(0.02, 0.5)}
            made["restitution"] = draw.restitution
        elif choice == 1:
            made = {"type": "clutch", "terms": terms, "one_way": True}
            joints[f"r{number}"]["velocity"], joints[f"r{number + 1}"]["velocity"] = 1.0, 0.5
        else:
            made = {"type": "clutch", "terms": terms, "capacity": draw.number(0.1, 2), "static": draw.number(1, 1.5)}
        constraints[f"c{number}"] = made
    couple = {"type": "couple", "on": "r0", "vector": [f"{draw.number(0.2, 4)}*sin({draw.number(2, 15)}*t)", 0, 0]}
    forces = {"couple": couple}
    return {"gravity": [0, 0, 0], "parts": parts, "joints": joints, "constraints": constraints, "forces": forces}


def _sliders(draw):
    """Masses on a rail that strike each other and stops: a Newton's cradle with any coefficients."""
    count = int(draw.rng.integers(2, 6))
    parts, joints, constraints = {}, {}, {}
    for number in range(count):
        parts[f"m{number}"] = {"mass": draw.number(0.3, 2)}
        joint = {"type": "prismatic", "between": ["ground", f"m{number}"], "axis": [1, 0, 0]}
        joints[f"m{number}"] = {**joint, "position": round(0.2 * number, 4), "velocity": draw.number(-3, 3)}
        if draw.maybe(0.4):
            joints[f"m{number}"] |= draw.joint_friction(2.0, False)
        if draw.maybe(0.3):
            joints[f"m{number}"] |= {"stiffness": draw.number(5, 50), "rest": 0.2 * number}
    for number in range(count - 1):
        terms = {f"m{number + 1}": 1, f"m{number}": -1}
        made = {"type": "coupling", "terms": terms, "value": 0.2, "backlash": draw.number(0.1, 0.3)}
        constraints[f"c{number}"] = {**made, "restitution": draw.restitution}
    joints["m0"]["limits"] = {"lower": -0.3, "upper": 1.5, "restitution": draw.restitution}
    return {"parts": parts, "joints": joints, "constraints": constraints}


_MAKERS = {
    **{kind: globals()[f"_{kind}"] for kind in KINDS},
    **{kind: getattr(contact_loops, kind) for kind in LOOPS if kind not in KINDS},
    **{kind: getattr(contact_shapes, kind) for kind in SHAPES},
}
