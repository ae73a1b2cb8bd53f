"""Linkages that move although counting says they are rigid: parallel cranks, Bennett, Goldberg, Bricard, Sarrus and others.

Each function takes a random generator and returns the YAML (JSON) text of a mechanism that starts closed. All parts have
their frames in ground's origin at the start, so that a joint has the same coordinates in both of its parts, and all
joint coordinates start at zero. The joint `input` moves the linkage.
"""

from __future__ import annotations

import json

import numpy as np

from mbd_sim.base.geometry import rotation as rot

X, Y, Z = np.eye(3)


class Linkage:
    """A linkage in the position in which it is assembled, rotated to a random orientation in space."""

    def __init__(self, rng, *, upright=False):
        self.rng = rng
        self.rotation = np.eye(3) if upright else rot.about(rot.unit(rng.normal(size=3)), rng.uniform(0.0, 3.0))
        self.parts, self.joints, self.places = {}, {}, {"ground": []}

    def joint(self, name, kind, inner, outer, at, axis=None, **more):
        """A joint at a point (3,), with an axis (3,), two (2, 3) if it is universal, none if it is spherical; `more` is written as it is."""
        at = self.rotation @ np.asarray(at, dtype=float)
        for part in (inner, outer):
            self.places.setdefault(part, []).append((name, at))
        self.joints[name] = {"type": kind, "between": [f"{inner}.{name}", f"{outer}.{name}"], **more}
        if axis is not None:
            turned = (np.asarray(axis, dtype=float) @ self.rotation.T).tolist()
            self.joints[name]["axes" if kind == "universal" else "axis"] = turned

    def text(self, *, speed=3.0, drive=None):
        """The mechanism, with joints of different compliances; its joint `input` has a speed or is driven."""
        parts = {}
        for part, places in self.places.items():
            points = {name: at.tolist() for name, at in places}
            if part == "ground":
                ground = {"points": points}
                continue
            center = np.mean([at for _, at in places], axis=0) + self.rng.uniform(-0.05, 0.05, 3)
            mass = self.rng.uniform(0.3, 1.5)
            inertia = (mass * self.rng.uniform(0.02, 0.03, 3)).tolist()
            parts[part] = {"mass": mass, "center": center.tolist(), "inertia": inertia, "points": points}
        joints = {name: joint | {"compliance": self.rng.uniform(0.2, 5.0)} for name, joint in self.joints.items()}
        joints["input"] |= {"velocity": speed} if drive is None else {"drive": drive}
        return json.dumps({"mechanism": "linkage", "ground": ground, "parts": parts, "joints": joints})


def _frames(angles, lengths, twists):
    """The hinges' frames (4, 4) along a loop, by Denavit and Hartenberg, and what the loop comes back to."""
    at, found = np.eye(4), []
    for angle, length, twist in zip(angles, lengths, twists, strict=True):
        turn, link = np.eye(4), np.eye(4)
        turn[:3, :3], link[:3, :3], link[0, 3] = rot.about(Z, angle), rot.about(X, twist), length
        found.append(at)
        at = at @ turn @ link
    return found, at


def _closed_angles(rng, lengths, twists):
    """Angles (n,) about the hinges at which the loop is closed and has one freedom."""
    from scipy.optimize import least_squares  # conftest.py imports this module for the names of the linkages

    def openness(angles):
        return (_frames(angles, lengths, twists)[1] - np.eye(4))[:3].ravel()

    for _ in range(400):
        guess = rng.uniform(-np.pi, np.pi, len(lengths))
        found = least_squares(openness, guess, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        sizes = np.linalg.svd(found.jac)[1]
        if np.max(np.abs(found.fun)) < 1e-13 and sizes[-2] > 0.1 and sizes[-1] < 1e-6:
            return found.x
    raise ValueError("the loop does not close")


def hinge_loop(rng, lengths, twists):
    """A loop of hinges; its last link is ground."""
    linkage = Linkage(rng)
    names = [*(f"link{index}" for index in range(len(lengths) - 1)), "ground"]
    frames, _ = _frames(_closed_angles(rng, lengths, twists), lengths, twists)
    for index, frame in enumerate(frames):
        name = f"hinge{index}" if index else "input"
        linkage.joint(name, "revolute", names[index - 1], names[index], frame[:3, 3], frame[:3, 2])
    return linkage


def bennett(rng):
    """Four hinges: opposite links are equal, and sin(alpha)/a = sin(beta)/b."""
    a, alpha, beta = rng.uniform(0.3, 0.6), rng.uniform(0.4, 0.9), rng.uniform(1.1, 1.5)
    b = a * np.sin(beta) / np.sin(alpha)
    return hinge_loop(rng, [a, b, a, b], [alpha, beta, alpha, beta])


def goldberg(rng):
    """Five hinges: two of Bennett's linkages put together at a common link, which is then left out."""
    alpha, beta, gamma = rng.uniform(0.5, 0.8), rng.uniform(0.9, 1.1), rng.uniform(1.2, 1.5)
    a = rng.uniform(0.3, 0.5)
    b, c = (a * np.sin(angle) / np.sin(alpha) for angle in (beta, gamma))
    return hinge_loop(rng, [a, b, c, a, b + c], [alpha, beta, gamma, alpha, beta + gamma])


def bricard(rng):
    """Six hinges at right angles in turn, trihedral: a1² + a3² + a5² = a2² + a4² + a6²."""
    while True:
        a = rng.uniform(0.4, 0.6, 5)
        if (last := a[0] ** 2 + a[2] ** 2 + a[4] ** 2 - a[1] ** 2 - a[3] ** 2) > 0.1:
            return hinge_loop(rng, [*a, np.sqrt(last)], [np.pi / 2, 3 * np.pi / 2] * 3)


def sarrus(rng):
    """A plate that moves straight, held by two pairs of leaves hinged in planes at an angle."""
    linkage = Linkage(rng)
    angle, height = rng.uniform(0.9, 2.2), 2.0 * rng.uniform(0.15, 0.35)
    for index, heading in enumerate((0.0, angle)):
        out = np.array([np.cos(heading), np.sin(heading), 0.0])
        axis = np.cross(Z, out)
        foot, knee, top = 0.3 * out, 0.7 * out + height / 2 * Z, 0.3 * out + height * Z
        linkage.joint("foot1" if index else "input", "revolute", "ground", f"lower{index}", foot, axis)
        # The springs keep it away from the two positions in which all leaves are in line.
        linkage.joint(f"knee{index}", "revolute", f"lower{index}", f"upper{index}", knee, axis, stiffness=500)
        linkage.joint(f"top{index}", "revolute", f"upper{index}", "plate", top, axis)
    return linkage


def parallel_cranks(rng):
    """A coupler on three to five equal parallel cranks in a tilted plane; no position of it is singular."""
    linkage = Linkage(rng)
    arm = rng.uniform(0.15, 0.3) * np.array([np.cos(first := rng.uniform(0.0, 6.0)), np.sin(first), 0.0])
    feet = [[0.0, 0.0, 0.0], [0.7, 0.0, 0.0], [0.3, 0.5, 0.0], [-0.4, 0.3, 0.0], [0.2, -0.5, 0.0]]
    for index, foot in enumerate(feet[: int(rng.integers(3, 6))]):
        foot = np.asarray(foot) + rng.uniform(-0.1, 0.1, 3) * [1.0, 1.0, 0.0]
        linkage.joint(f"foot{index}" if index else "input", "revolute", "ground", f"crank{index}", foot, Z)
        linkage.joint(f"pin{index}", "revolute", f"crank{index}", "coupler", foot + arm, Z)
    return linkage


def spatial_parallelogram(rng):
    """A plate that hangs from three equal parallel rods with universal joints: it translates on a sphere."""
    linkage = Linkage(rng, upright=True)
    rod = 0.4 * rot.unit(0.3 * rng.normal(size=3) - Z)  # hanging
    first = rot.unit(np.cross(rod, rng.normal(size=3)))
    second = rot.unit(np.cross(rod, first))
    for index, foot in enumerate(([0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.2, 0.4, 0.0])):
        name = f"foot{index}" if index else "input"
        linkage.joint(name, "universal", "ground", f"rod{index}", foot, [first, second])
        top = np.asarray(foot) + rod
        linkage.joint(f"top{index}", "universal", f"rod{index}", "plate", top, [second, first])
    return linkage


def tilted_four_bar(rng):
    """A planar four-bar that does not lie in a coordinate plane."""
    linkage = Linkage(rng)
    a, b, c, d = [0, 0, 0], [0.1, 0.3, 0], [0.9, 0.8, 0], [1.0, 0, 0]
    for name, first, second, at in (
        ("input", "ground", "crank", a),
        ("crank_pin", "crank", "coupler", b),
        ("rocker_pin", "coupler", "rocker", c),
        ("foot", "rocker", "ground", d),
    ):
        linkage.joint(name, "revolute", first, second, at, Z)
    return linkage


def double_wishbone(rng):
    """A wheel carrier on two wishbones, each on two hinges in line, and a tie rod."""
    linkage = Linkage(rng)
    ahead = rot.unit(X + rng.uniform(-0.1, 0.1, 3))
    for arm, height, length in (("lower", 0.0, 0.45), ("upper", 0.3, 0.35)):
        root = np.array([0.0, 0.0, height])
        for place, along in (("front", 0.15), ("rear", -0.2)):
            name = "input" if (arm, place) == ("lower", "front") else f"{arm}_{place}"
            linkage.joint(name, "revolute", "ground", arm, root + along * ahead, ahead)
        ball = root + length * Y + rng.uniform(-0.03, 0.03, 3)
        linkage.joint(f"{arm}_ball", "spherical", arm, "carrier", ball)
    linkage.joint("tie_inner", "universal", "ground", "tie", [-0.2, 0.05, 0.1], [X, Z])
    linkage.joint("tie_outer", "spherical", "tie", "carrier", [-0.2, 0.42, 0.1])
    return linkage


LINKAGES = {
    "bennett": bennett,
    "goldberg": goldberg,
    "bricard": bricard,
    "sarrus": sarrus,
    "parallel_cranks": parallel_cranks,
    "spatial_parallelogram": spatial_parallelogram,
    "tilted_four_bar": tilted_four_bar,
    "double_wishbone": double_wishbone,
}

DRIVES = {
    "bennett": "2.0*t",
    "goldberg": "0.15*sin(3*t)",
    "bricard": "0.15*sin(3*t)",
    "sarrus": "0.15*sin(3*t)",
    "parallel_cranks": "2.0*t + 0.3*sin(2*t)",
    "spatial_parallelogram": ["0.3*sin(2*t)", "0.2*sin(3*t)"],
    "tilted_four_bar": "0.15*sin(3*t)",
    "double_wishbone": "0.15*sin(3*t)",
}
SPEEDS = {"sarrus": 1.0, "spatial_parallelogram": [0.8, 0.5]}


def linkage_text(name, seed, *, driven):
    """A random linkage whose joint `input` is driven or has a speed at the start."""
    linkage = LINKAGES[name](np.random.default_rng(seed))
    return linkage.text(drive=DRIVES[name]) if driven else linkage.text(speed=SPEEDS.get(name, 3.0))
