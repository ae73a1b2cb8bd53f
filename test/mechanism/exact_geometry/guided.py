"""Exact linkages with loops that constraints close, in random places, written with as many digits as people write."""

from __future__ import annotations

import json

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.load import parse_mechanism
from test.mechanism.exact_geometry.linkages import X, Y, Z, rounded


class Guided:
    """Joints and constraints at places of the assembled linkage, which is turned at random when it is written."""

    def __init__(self, rng, freedoms):
        self.rng, self.freedoms = rng, freedoms
        self.turn = rot.from_quaternion(rot.unit(rng.normal(size=4)))
        self.poses = {"ground": Pose(np.zeros(3), np.eye(3))}
        self.points, self.joints, self.constraints = {"ground": {}}, {}, {}

    def local(self, part, at, direction=None):
        """A point, or a direction, in the frame of a part, which is new at the first use."""
        if part not in self.poses:
            turn = rot.from_quaternion(rot.unit(self.rng.normal(size=4)))
            self.poses[part], self.points[part] = Pose(self.rng.uniform(-0.5, 0.5, 3), turn), {}
        pose = self.poses[part]
        if direction is not None:
            return pose.rotation.T @ self.turn @ rot.unit(np.array(direction, dtype=float))
        return pose.rotation.T @ (self.turn @ np.array(at, dtype=float) - pose.position)

    def point(self, part, at):
        """The name of a new point of a part."""
        place = self.local(part, at).tolist()
        name = f"c{len(self.points[part])}"
        self.points[part][name] = {"at": place}
        return f"{part}.{name}"

    def joint(self, kind, one, other, at, axis=Z):
        """A joint whose frames on both parts are parallel to each other, in axes that belong to neither."""
        frame = rot.aligning_z(self.turn @ rot.unit(np.array(axis, dtype=float)))
        ends = [self.point(part, at) for part in (one, other)]
        for end in ends:
            part, name = end.split(".")
            local = rot.to_quaternion(self.poses[part].rotation.T @ frame)
            self.points[part][name]["rotate"] = {"quaternion": local.tolist()}
        self.joints[f"j{len(self.joints)}"] = {"type": kind, "between": ends}
        if kind not in ("spherical", "fixed"):
            self.joints[f"j{len(self.joints) - 1}"]["axis"] = [0, 0, 1]

    def on(self, kind, part, at, guide, along, through=None):
        """A point on a line, or on a plane with a normal, through another point."""
        through = at if through is None else through
        key, direction = ("line", "direction") if kind == "on_line" else ("plane", "normal")
        self._add(
            type=kind,
            point=self.point(part, at),
            **{key: self.point(guide, through), direction: self.local(guide, None, along).tolist()},
        )

    def rod(self, one, first, other, second, kind="distance"):
        """A rod between points of two parts."""
        length = float(np.linalg.norm(np.array(first, dtype=float) - second))
        ends = [self.point(one, first), self.point(other, second)]
        self._add(type=kind, **{"between" if kind == "distance" else "through": ends}, length=length)

    def _add(self, **record):
        self.constraints[f"k{len(self.constraints)}"] = record


def somewhere(rng):
    return rng.uniform(-1.0, 1.0, 3)


def _slider_crank(rng):
    found, z = Guided(rng, 1), rng.uniform(-0.3, 0.3, 3)
    found.joint("revolute", "ground", "crank", [0, 0, z[0]])
    found.joint("revolute", "crank", "rod", [0.3, 0.2, z[1]])
    found.on("on_line", "rod", [1.2, 0.1, z[2]], "ground", [1, 0.2, 0], [0.4, -0.06, z[2]])
    return found


def _ellipse(rng):
    """A bar with two points on lines in a plane, held in this plane by a planar joint."""
    found, z = Guided(rng, 1), rng.uniform(-0.3, 0.3, 3)
    found.joint("planar", "ground", "bar", [0.1, 0.2, z[0]])
    found.on("on_line", "bar", [0.8, 0, z[1]], "ground", X, [0.1, 0, z[1]])
    found.on("on_line", "bar", [0, 0.6, z[2]], "ground", [0.3, 1, 0], [-0.3, -0.4, z[2]])
    return found


def _four_bar_with_strap(rng):
    """A four-bar linkage whose coupler also slides on a plane."""
    found, z = Guided(rng, 1), rng.uniform(-0.3, 0.3, 5)
    ends = [("ground", "crank", [0, 0]), ("crank", "coupler", [0.2, 0.3]), ("coupler", "rocker", [1, 0.8])]
    for (one, other, at), height in zip([*ends, ("rocker", "ground", [1.1, 0])], z[:4], strict=True):
        found.joint("revolute", one, other, [*at, height])
    found.on("on_plane", "coupler", [0.6, 0.9, z[4]], "ground", Z, [0, 0.5, z[4]])
    return found


def _six_bar(rng):
    """A slider-crank whose slider is a point on a line, driven by a four-bar linkage."""
    found, z = Guided(rng, 1), rng.uniform(-0.3, 0.3, 6)
    ends = [("ground", "crank", [0, 0]), ("crank", "coupler", [0.2, 0.3]), ("coupler", "rocker", [1, 0.8])]
    for (one, other, at), height in zip([*ends, ("rocker", "ground", [1.1, 0])], z[:4], strict=True):
        found.joint("revolute", one, other, [*at, height])
    found.joint("revolute", "rocker", "rod", [1.05, 0.6, z[4]])
    found.on("on_line", "rod", [2.0, 0.5, z[5]], "ground", X, [1.5, 0.5, z[5]])
    return found


def _door(constrain):
    def build(rng):
        found = Guided(rng, 1)
        found.joint("revolute", "ground", "door", [0, 0, 0])
        constrain(found, rng)
        return found

    return build


def _carriage(constrain, kind="prismatic", freedoms=1):
    def build(rng):
        found = Guided(rng, freedoms)
        found.joint(kind, "ground", "carriage", somewhere(rng))
        constrain(found, rng)
        return found

    return build


def _telescope(rng):
    found, place = Guided(rng, 2), somewhere(rng)
    found.joint("cylindrical", "ground", "carriage", place)
    found.on("on_line", "carriage", place + 0.8 * Z, "ground", Z, place - 0.4 * Z)
    return found


def _along(rng):
    return np.array([*rng.normal(size=2), 0.0])


def _group(constrain):
    """A constraint between two parts that are welded together and hang from a ball joint."""

    def build(rng):
        found = Guided(rng, 3)
        found.joint("spherical", "ground", "one", somewhere(rng))
        found.joint("fixed", "one", "other", somewhere(rng))
        constrain(found, rng)
        return found

    return build


def _ball(constrain):
    """A constraint at the center of a ball joint, and another part on it."""

    def build(rng):
        found, center = Guided(rng, 4), somewhere(rng)
        found.joint("spherical", "ground", "one", center)
        found.joint("revolute", "one", "other", somewhere(rng), rng.normal(size=3))
        constrain(found, rng, center)
        return found

    return build


def _wrist(rng):
    """Three hinges whose axes meet in a point, which is on a line."""
    found, center = Guided(rng, 3), somewhere(rng)
    for number, ends in enumerate([("ground", "one"), ("one", "two"), ("two", "three")]):
        axis = rot.unit(np.eye(3)[number] + 0.3 * rng.normal(size=3))
        found.joint("revolute", *ends, center + axis * rng.uniform(-0.5, 0.5), axis)
    found.on("on_line", "three", center, "ground", rng.normal(size=3), None)
    return found


GUIDED = {
    "slider-crank": _slider_crank,
    "ellipse": _ellipse,
    "four-bar on a plane": _four_bar_with_strap,
    "six-bar": _six_bar,
    "door in a second bearing": _door(lambda g, rng: g.on("on_line", "door", [0, 0, 1.1], "ground", Z, [0, 0, 0.4])),
    "door on an oblique line": _door(lambda g, rng: g.on("on_line", "door", [0, 0, 1.1], "ground", rng.normal(size=3))),
    "door on a plane": _door(lambda g, rng: g.on("on_plane", "door", [0.6, 0.5, 0.8], "ground", Z, [0.1, -0.5, 0.8])),
    "door on an oblique plane": _door(lambda g, rng: g.on("on_plane", "door", [0, 0, 0.7], "ground", [1, 2, 3])),
    "door on a rod": _door(lambda g, rng: g.rod("door", [0, 0, 0.9], "ground", somewhere(rng))),
    "door on a rod to its axis": _door(lambda g, rng: g.rod("door", somewhere(rng), "ground", [0, 0, -0.6])),
    "door on a cable": _door(lambda g, rng: g.rod("door", [0, 0, 0.9], "ground", somewhere(rng), "cable")),
    "carriage on a line": _carriage(
        lambda g, rng: g.on("on_line", "carriage", p := somewhere(rng), "ground", Z, p - 0.4 * Z)
    ),
    "carriage on a plane": _carriage(
        lambda g, rng: g.on("on_plane", "carriage", p := somewhere(rng), "ground", n := _along(rng), p + np.cross(Z, n))
    ),
    "telescope on its axis": _telescope,
    "plate on a plane": _carriage(
        lambda g, rng: g.on("on_plane", "carriage", p := somewhere(rng), "ground", Z, p + 0.3 * X - 0.2 * Y), "planar", 3
    ),
    "rod in a rigid group": _group(lambda g, rng: g.rod("one", somewhere(rng), "other", somewhere(rng))),
    "plane in a rigid group": _group(
        lambda g, rng: g.on("on_plane", "one", p := somewhere(rng), "other", n := rng.normal(size=3), p + np.cross(n, X))
    ),
    "line in a rigid group": _group(
        lambda g, rng: g.on("on_line", "one", p := somewhere(rng), "other", n := rng.normal(size=3), p + 0.4 * n)
    ),
    "rod at a ball joint": _ball(lambda g, rng, c: g.rod("one", c, "ground", somewhere(rng))),
    "plane at a ball joint": _ball(
        lambda g, rng, c: g.on("on_plane", "one", c, "ground", n := rng.normal(size=3), c + np.cross(n, X))
    ),
    "wrist on a line": _wrist,
}  # fmt: skip


def guided_text(name, seed, digits=17, **more):
    """The text of a random linkage of a kind with this many digits, and the freedoms of the exact one."""
    rng = np.random.default_rng(seed)
    found = GUIDED[name](rng)
    parts = {
        part: {"mass": 1.0, "inertia": [0.1, 0.12, 0.15], "points": points} for part, points in found.points.items()
    }
    for points in found.points.values():
        for point in points.values():
            point["at"] = rounded(point["at"], digits)
            if "rotate" in point:
                point["rotate"] = {"quaternion": rounded(point["rotate"]["quaternion"], digits)}
    for record in found.constraints.values():
        for key in {"direction", "normal", "length"} & record.keys():
            record[key] = rounded(record[key], digits)
    ground = {"points": parts.pop("ground")["points"]}
    data = {"mechanism": "guided", "ground": ground, "parts": parts, "joints": found.joints}
    return json.dumps({**data, "constraints": found.constraints, **more}), found.freedoms


def guided_file(name, seed, digits=17, **more):
    """The same as a mechanism."""
    text, freedoms = guided_text(name, seed, digits, **more)
    return parse_mechanism(text), freedoms
