"""Random mechanisms with loops and constraints: random trees, closed in their current configuration."""

from __future__ import annotations

import json
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
from hypothesis import seed, settings
from hypothesis import strategies as st

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.dynamics.constraints.assembly import close_loops, nearest_speeds
from mbd_sim.dynamics.constraints.start import given_start
from mbd_sim.dynamics.layouts.vectors import coordinate_layout
from mbd_sim.files.load import parse_mechanism
from test.generators.mechanisms import random_trees
from test.oracles import kane

FREEDOMS = {"revolute": 1, "prismatic": 1, "screw": 1, "cylindrical": 2, "universal": 2, "planar": 3, "spherical": 3}
FREEDOMS |= {"fixed": 0}
ROWS = {"distance": 1, "cable": 1, "on_plane": 1, "on_line": 2, "on_surface": 1, "on_curve": 2, "gear": 1, "rack": 1}
ROWS |= {"coupling": 1, "rolling": 3, "ball": 3, "knife_edge": 1}


def with_same_mechanisms(test):
    """For tests of `random_mechanisms()`: they draw the same ones, which are derived once.

    The seed gives twice as many constraints as most others, of all types.
    """
    return settings(max_examples=5)(seed(3)(test))


def state_near_start(mechanism, derived, rng, t, distance=0.3):
    """Coordinates, speeds and efforts that satisfy the constraints at time t, or None if the loops do not close."""
    constraints, start, nv = derived.constraints, derived.start, derived.layout.nv
    for attempt in range(6):
        away = constraints.displaced(start.q, constraints.scales * rng.uniform(-distance, distance, nv) * 0.5**attempt)
        closing = close_loops(constraints, t, away, np.ones(nv, dtype=bool))
        if closing.closed:
            speeds = nearest_speeds(constraints, t, closing.q, rng.uniform(-2.0, 2.0, nv))
            return closing.q, speeds, rng.uniform(-5.0, 5.0, nv)
    return None


def _given_positions(rng, joints):
    """Give all joints with coordinates a random start position."""
    for joint in joints.values():
        kind = joint["type"]
        if "drive" in joint or kind == "fixed":
            continue
        if kind in ("spherical", "free"):
            joint["orientation"] = {"quaternion": rng.normal(size=4).tolist()}
        if kind == "free":
            joint["position"] = rng.uniform(-1.0, 1.0, 3).tolist()
        elif kind != "spherical":
            position = rng.uniform(-0.7, 0.7, FREEDOMS[kind]).tolist()
            joint["position"] = position if len(position) > 1 else position[0]
        joint["guess"] = bool(rng.random() < 0.5)


class _Closer:
    """Adds loops and constraints to a tree so that they are satisfied in its start configuration."""

    def __init__(self, data, rng):
        self.data, self.rng = data, rng
        self.mechanism = mechanism = parse_mechanism(json.dumps(data))
        self.q, u = given_start(mechanism, coordinate_layout(mechanism))
        moving = kane.motions(mechanism, self.q, u)
        self.frames = {name: (m.origin.d[0], m.rotation.d[0]) for name, m in moving.items()}
        self.frames["ground"] = np.zeros(3), np.eye(3)
        self.left = len(u)
        self.number = 0

    def add_point(self, part, position, rotation=None):
        """Add a point of a part at a position in ground's frame; returns its name in the file."""
        self.number += 1
        origin, axes = self.frames[part]
        rotation = axes if rotation is None else rotation
        local = rot.to_quaternion(axes.T @ rotation).tolist()
        points = self.data["ground"]["points"] if part == "ground" else self.data["parts"][part]["points"]
        at = (axes.T @ (position - origin)).tolist()
        points[f"c{self.number}"] = {"at": at, "rotate": {"quaternion": local}}
        return f"{part}.c{self.number}"

    def random_position(self):
        return self.rng.uniform(-1.0, 1.0, 3)

    def random_rotation(self):
        return rot.from_quaternion(rot.unit(self.rng.normal(size=4)))

    def freedoms_between(self, first, second):
        """The number of free coordinates between two parts."""
        inward = {joint.outboard: joint for joint in self.mechanism.joints.values()}
        paths = []
        for part in (first, second):
            path = {}
            while part in inward:
                path[inward[part].name] = len(inward[part].coordinate_names)
                part = inward[part].inboard
            paths.append(path)
        return sum(paths[0].get(name, 0) + paths[1].get(name, 0) for name in paths[0].keys() ^ paths[1].keys())

    def pair(self):
        parts = list(self.frames)
        first, second = self.rng.choice(len(parts), 2, replace=False)
        return parts[first], parts[second]

    def loose_pair(self, rows):
        """Two parts between which more coordinates are free than `rows` constrain, or None."""
        for _ in range(8):
            first, second = self.pair()
            if rows < min(self.freedoms_between(first, second), self.left):
                return first, second
        return None

    def loop(self, kind):
        """Add a closing joint between two parts, away from its zero position."""
        rows = 6 - FREEDOMS[kind]
        if (parts := self.loose_pair(rows)) is None:
            return
        axis, across = (rot.unit(self.rng.normal(size=3)) for _ in range(2))
        across = rot.unit(across - (axis @ across) * axis)
        joint = {"type": kind, "cut": bool(self.rng.random() < 0.5)}
        q = self.rng.uniform(-0.7, 0.7, FREEDOMS[kind])
        if kind == "universal":
            across = rot.unit(across + 0.3 * axis)
            joint["axes"] = [axis.tolist(), across.tolist()]
        elif kind not in ("spherical", "fixed"):
            joint["axis"] = axis.tolist()
        if kind == "planar":
            joint["x_axis"] = across.tolist()
        if kind == "screw":
            joint["lead"] = float(self.rng.uniform(-1.0, 1.0))
        if kind == "spherical":
            q = rot.unit(self.rng.normal(size=4))
            joint |= {"orientation": {"quaternion": q.tolist()}, "guess": True}
        elif len(q):
            joint |= {"position": q.tolist() if len(q) > 1 else float(q[0]), "guess": True}
        record = SimpleNamespace(type=kind, axis=axis, second=across, lead=joint.get("lead", 0.0), drive=())
        at_rest = np.zeros(FREEDOMS[kind])
        position, rotation = kane.joint_jets(record, q, at_rest, at_rest, 0.0)
        base, axes = self.random_position(), self.random_rotation()
        place = base + axes @ position.d[0], axes @ rotation.d[0]
        joint["between"] = [self.add_point(parts[0], base, axes), self.add_point(parts[1], *place)]
        self.number += 1
        self.data["joints"][f"loop{self.number}"] = joint
        self.left -= rows

    def constrain(self, kind):
        """Add a constraint that is satisfied, if enough coordinates are free."""
        if kind in ("gear", "rack", "coupling"):
            record = self._coupled(kind) if self.left > 1 else None
        else:
            parts = self.loose_pair(ROWS[kind])
            record = None if parts is None else getattr(self, f"_{kind}")(*parts)
        if record is not None:
            self.number += 1
            self.data["constraints"][f"k{self.number}"] = record
            self.left -= ROWS[kind]

    def _in_time(self, value):
        if self.rng.random() < 0.5:
            return value
        return f"{value} + 0.05*sin({self.rng.uniform(-3, 3)}*t)"

    def _distance(self, first, second):
        a, b = self.random_position(), self.random_position()
        length = self._in_time(float(np.linalg.norm(b - a)))
        return {"type": "distance", "between": [self.add_point(first, a), self.add_point(second, b)], "length": length}

    def _cable(self, first, second):
        places = [self.random_position() for _ in range(4)]
        parts = [first, *self.rng.choice(list(self.frames), 2), second]
        length = float(sum(np.linalg.norm(b - a) for a, b in pairwise(places)))
        points = [self.add_point(part, place) for part, place in zip(parts, places, strict=True)]
        return {"type": "cable", "through": points, "length": self._in_time(length)}

    def _on_plane(self, first, second):
        place, axes, normal = self.random_position(), self.random_rotation(), rot.unit(self.rng.normal(size=3))
        beside = axes @ np.cross(normal, self.rng.normal(size=3))
        ends = {"point": self.add_point(first, place), "plane": self.add_point(second, place + beside, axes)}
        return {"type": "on_plane", **ends, "normal": normal.tolist()}

    def _on_line(self, first, second):
        place, axes, direction = self.random_position(), self.random_rotation(), rot.unit(self.rng.normal(size=3))
        ends = {"point": self.add_point(first, place), "line": self.add_point(second, place + axes @ direction, axes)}
        return {"type": "on_line", **ends, "direction": direction.tolist()}

    def _equation(self, place):
        a, b, c = self.rng.uniform(-1.0, 1.0, 3)
        x, y, z = place
        value = a * x**2 + b * y * z + np.sin(z - x) + c * y
        moving = f"0.05*sin({self.rng.uniform(-3, 3)}*t)" if self.rng.random() < 0.5 else "0"
        return f"({a})*x^2 + ({b})*y*z + sin(z - x) + ({c})*y - ({value}) + {moving}"

    def _on_surface(self, first, second, count=1):
        place, axes, local = self.random_position(), self.random_rotation(), self.random_position()
        ends = {
            "point": self.add_point(first, place),
            "frame": self.add_point(second, place - axes @ local, axes),
        }
        equations = [self._equation(local) for _ in range(count)]
        if count == 1:
            return {"type": "on_surface", **ends, "equation": equations[0]}
        return {"type": "on_curve", **ends, "equations": equations}

    def _on_curve(self, first, second):
        return self._on_surface(first, second, 2)

    def _rolling(self, first, second, disc=True):
        place, axes, turn = self.random_position(), self.random_rotation(), self.random_rotation()
        normal, axis = (rot.unit(self.rng.normal(size=3)) for _ in range(2))
        cosine = float((axes @ normal) @ (turn @ axis)) if disc else 0.0
        if abs(cosine) > 0.9:
            return None
        radius = float(self.rng.uniform(0.1, 1.0))
        below = axes @ (np.cross(normal, self.rng.normal(size=3)) - normal * radius * np.sqrt(1.0 - cosine**2))
        ends = {"wheel": self.add_point(first, place, turn), "plane": self.add_point(second, place + below, axes)}
        record = {"type": "rolling", **ends, "radius": radius, "normal": normal.tolist()}
        return record | {"axis": axis.tolist()} if disc else record

    def _ball(self, first, second):
        return self._rolling(first, second, disc=False)

    def _knife_edge(self, first, second):
        axes, turn = self.random_rotation(), self.random_rotation()
        normal, direction = (rot.unit(self.rng.normal(size=3)) for _ in range(2))
        if abs(float((axes @ normal) @ (turn @ direction))) > 0.9:
            return None
        ends = {
            "at": self.add_point(first, self.random_position(), turn),
            "plane": self.add_point(second, self.random_position(), axes),
        }
        return {"type": "knife_edge", **ends, "normal": normal.tolist(), "direction": direction.tolist()}

    def _coupled(self, kind):
        values = {
            name: jet.d[0] for name, jet in kane.coordinate_jets(self.mechanism, self.q, self.q * 0.0, 0.0).items()
        }
        free = [name for name in self.mechanism.coordinate_names if name in values]
        if len(values) < 2 or not free:
            return None
        one = str(self.rng.choice(free))
        other = str(self.rng.choice([name for name in values if name != one]))
        x, y = float(values[one]), float(values[other])
        if kind == "coupling":
            factors = {one: float(self.rng.uniform(0.5, 2.0)), other: float(self.rng.uniform(-2.0, 2.0))}
            value = factors[one] * x + factors[other] * y
            return {"type": "coupling", "terms": factors, "value": self._in_time(value)}
        if min(abs(x), abs(y)) < 0.05:
            return None
        if kind == "gear":
            return {"type": "gear", "joints": [one, other], "radii": [abs(y), abs(x)], "internal": y / x > 0.0}
        return {"type": "rack", "pinion": one, "rack": other, "radius": abs(y / x), "reverse": y / x < 0.0}


@st.composite
def random_mechanisms(draw, kinds=(*FREEDOMS, *ROWS), most=5):
    """The text of a random mechanism with loops and constraints, and a random-number generator for its state."""
    text, rng = draw(random_trees(most=most, fewest=3))
    data = json.loads(text)
    _given_positions(rng, data["joints"])
    data["constraints"] = {}
    closer = _Closer(data, rng)
    for kind in draw(st.lists(st.sampled_from(kinds), min_size=2, max_size=6)):
        if kind in FREEDOMS:
            closer.loop(kind)
        else:
            closer.constrain(kind)
    if "distance" in kinds and not data["constraints"] and len(data["joints"]) == len(closer.mechanism.joints):
        closer.constrain("distance")
    return json.dumps(data), rng
