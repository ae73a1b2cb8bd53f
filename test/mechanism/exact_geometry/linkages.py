"""Exact linkages of each family in random places, written as files with as many digits as people write."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, field

import numpy as np

from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.load import parse_mechanism

X, Y, Z = np.eye(3)


@dataclass
class Linkage:
    """Joints (type, first part, second part, frame) with their axes along z, before everything is turned.

    `freedoms` is what the exact linkage has. Parts have masses at the points of their joints.
    """

    joints: list[tuple[str, str, str, Pose]]
    freedoms: int
    parts: list[str] = field(init=False)

    def __post_init__(self):
        names = [name for _, *ends, _ in self.joints for name in ends if name != "ground"]
        self.parts = list(dict.fromkeys(names))


def frame(at, along=Z):
    """The frame at a point with z along a direction."""
    return Pose(np.array(at, dtype=float), rot.aligning_z(rot.unit(np.array(along, dtype=float))))


def _ring(kinds, frames, freedoms):
    names = ["ground", *(f"p{n}" for n in range(1, len(kinds))), "ground"]
    return Linkage(
        [(k, names[n], names[n + 1], f) for n, (k, f) in enumerate(zip(kinds, frames, strict=True))], freedoms
    )


def _points(rng, count):
    """Points of a convex polygon at various heights over it."""
    angles = np.arange(count) * 2 * np.pi / count + rng.uniform(-0.3, 0.3, count)
    sizes, heights = rng.uniform(0.5, 1.0, (2, count))
    return [np.array([s * np.cos(a), s * np.sin(a), h]) for s, a, h in zip(sizes, angles, heights, strict=True)]


def planar(rng, kinds, freedoms):
    """Hinges about z and sliders across; heights differ, as in machines."""
    frames = []
    for kind, point in zip(kinds, _points(rng, len(kinds)), strict=True):
        along = np.array([*rng.normal(size=2), 0.0]) if kind == "prismatic" else Z
        frames.append(frame(point, along))
    return _ring(kinds, frames, freedoms)


def spherical(rng, kinds, freedoms):
    """Axes through one point."""
    center = rng.uniform(-0.5, 0.5, 3)
    directions = [rot.unit(rng.normal(size=3)) for _ in kinds]
    return _ring(kinds, [frame(center + d * rng.uniform(0.3, 0.8), d) for d in directions], freedoms)


def on_one_axis(rng, kinds, freedoms):
    """All joints on one line, between ground and one part."""
    frames = [frame([0.0, 0.0, height]) for height in rng.uniform(-1.0, 1.0, len(kinds))]
    return Linkage([(kind, "ground", "p1", place) for kind, place in zip(kinds, frames, strict=True)], freedoms)


def side_by_side(rng, kinds, freedoms):
    """Joints with parallel axes between ground and one part: rails, telescopes."""
    frames = [frame(rng.uniform(-1.0, 1.0, 3)) for _ in kinds]
    return Linkage([(kind, "ground", "p1", place) for kind, place in zip(kinds, frames, strict=True)], freedoms)


def sarrus(rng):
    """Two chains of three parallel hinges each, about different directions: a platform that moves straight."""
    height, width = rng.uniform(0.6, 0.9), rng.uniform(0.2, 0.4)
    frames = [frame([1, 0, 0], Y), frame([1 + width, 0, height / 2], Y), frame([1, 0, height], Y)]
    frames += [frame([0, 1, height], X), frame([0, 1 + width, height / 2], X), frame([0, 1, 0], X)]
    return _ring(["revolute"] * 6, frames, 1)


def six_bar(rng):
    """Two loops that share parts and hinges."""
    a, b, c, d, e, f, g = (frame([*point, rng.uniform(-0.2, 0.2)]) for point in
                           [(0, 0), (0.3, 0.6), (1.1, 0.9), (1.3, 0), (1.2, 0.5), (2.0, 0.7), (2.2, 0)])  # fmt: skip
    ends = [("ground", "p1", a), ("p1", "p2", b), ("p2", "p3", c), ("ground", "p3", d)]
    ends += [("p3", "p4", e), ("p4", "p5", f), ("ground", "p5", g)]
    return Linkage([("revolute", *one) for one in ends], 1)


def door(rng):
    """A hinge and a ball joint on its axis."""
    return on_one_axis(rng, ["revolute", "spherical"], 1)


FAMILIES = {
    "four-bar": lambda rng: planar(rng, ["revolute"] * 4, 1),
    "five-bar": lambda rng: planar(rng, ["revolute"] * 5, 2),
    "slider-crank": lambda rng: planar(rng, ["revolute"] * 3 + ["prismatic"], 1),
    "four-bar with a ball joint": lambda rng: planar(rng, ["revolute", "revolute", "spherical", "revolute"], 1),
    "cross slider": lambda rng: planar(rng, ["revolute", "prismatic", "revolute", "prismatic"], 1),
    "four-bar with a cylindrical joint": lambda rng: planar(rng, ["revolute", "revolute", "cylindrical", "revolute"], 1),
    "six-bar": six_bar,
    "spherical four-bar": lambda rng: spherical(rng, ["revolute"] * 4, 1),
    "spherical five-bar": lambda rng: spherical(rng, ["revolute"] * 5, 2),
    "door": door,
    "two bearings": lambda rng: on_one_axis(rng, ["revolute"] * 2, 1),
    "three bearings": lambda rng: on_one_axis(rng, ["revolute"] * 3, 1),
    "two bearings that slide": lambda rng: on_one_axis(rng, ["cylindrical"] * 2, 2),
    "two rails": lambda rng: side_by_side(rng, ["prismatic"] * 2, 1),
    "three rails": lambda rng: side_by_side(rng, ["prismatic"] * 3, 1),
    "two telescopes": lambda rng: side_by_side(rng, ["cylindrical"] * 2, 1),
    "rail and telescope": lambda rng: side_by_side(rng, ["prismatic", "cylindrical"], 1),
    "sarrus": sarrus,
}  # fmt: skip


def rounded(value, digits):
    """A number, or nested lists of numbers, with some significant digits."""
    if isinstance(value, list):
        return [rounded(one, digits) for one in value]
    return float(f"{value:.{digits}g}")


def placed(linkage, rng):
    """The poses of the parts and the frames of the joints, everything turned at random, with axes of its own each."""
    turn = Pose(np.zeros(3), rot.from_quaternion(rot.unit(rng.normal(size=4))))
    poses = {
        name: Pose(rng.uniform(-0.5, 0.5, 3), rot.from_quaternion(rot.unit(rng.normal(size=4))))
        for name in linkage.parts
    }
    poses["ground"] = Pose(np.zeros(3), np.eye(3))
    spins = [Pose(np.zeros(3), rot.about(Z, angle)) for angle in rng.uniform(-3.0, 3.0, len(linkage.joints))]
    return poses, [turn @ place @ spin for (*_, place), spin in zip(linkage.joints, spins, strict=True)]


def mechanism_file(linkage, rng, digits=17, **more):
    """The linkage as a mechanism file: every number that is geometry has this many significant digits."""
    poses, frames = placed(linkage, rng)
    parts = {name: {"mass": 1.0, "inertia": [0.1, 0.12, 0.15], "points": {}} for name in linkage.parts}
    ground, joints = {}, {}
    for number, ((kind, *ends, _), place) in enumerate(zip(linkage.joints, frames, strict=True)):
        for end in ends:
            local = poses[end].inverse() @ place
            point = {
                "at": local.position.tolist(),
                "rotate": {"quaternion": rot.to_quaternion(local.rotation).tolist()},
            }
            point = {
                "at": rounded(point["at"], digits),
                "rotate": {"quaternion": rounded(point["rotate"]["quaternion"], digits)},
            }
            (ground if end == "ground" else parts[end]["points"])[f"c{number}"] = point
        joints[f"j{number}"] = {"type": kind, "between": [f"{end}.c{number}" for end in ends]}
        joints[f"j{number}"] |= {} if kind in ("spherical", "fixed") else {"axis": [0, 0, 1]}
    data = {"mechanism": "linkage", "ground": {"points": ground}, "parts": parts, "joints": joints, **more}
    return parse_mechanism(json.dumps(data))


def sdf_text(linkage, rng, digits):
    """The linkage as an SDF, whose joints have a frame on their child only, with roll, pitch and yaw."""
    poses, frames = placed(linkage, rng)

    def pose_text(pose):
        return " ".join(f"{value:.{digits}g}" for value in [*pose.position, *rot.to_rpy(pose.rotation)])

    lines = ['<sdf version="1.9"><model name="linkage">']
    for name in linkage.parts:
        inertia = "<mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.12</iyy><izz>0.15</izz></inertia>"
        lines.append(f'<link name="{name}"><pose>{pose_text(poses[name])}</pose><inertial>{inertia}</inertial></link>')
    for number, ((kind, first, second, _), place) in enumerate(zip(linkage.joints, frames, strict=True)):
        if second == "ground":
            first, second = second, first
        local = poses[second].inverse() @ place
        axis = " ".join(f"{value:.{digits}g}" for value in local.rotation[:, 2])
        first = first.replace("ground", "world")
        pose = " ".join(f"{value:.{digits}g}" for value in [*local.position, 0, 0, 0])
        lines.append(f'<joint name="j{number}" type="{kind}"><pose>{pose}</pose><parent>{first}</parent>')
        lines.append(f"<child>{second}</child><axis><xyz>{axis}</xyz></axis></joint>")
    return "\n".join([*lines, "</model></sdf>"])


def urdf_and_loops(linkage, rng, digits):
    """The linkage as a URDF of its joints but the last of a ring, and a mechanism file that closes the ring."""
    poses, frames = placed(linkage, rng)

    def numbers(values):
        return " ".join(f"{value:.{digits}g}" for value in values)

    lines = ['<robot name="linkage"><link name="base"/>']
    for name in linkage.parts:
        inertia = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.12" iyz="0" izz="0.15"/>'
        lines.append(f'<link name="{name}"><inertial><mass value="1"/>{inertia}</inertial></link>')
    moved = {"base": Pose(np.zeros(3), np.eye(3))}  # URDF puts the frame of a link at its joint
    for number, ((kind, first, second, _), place) in enumerate(zip(linkage.joints[:-1], frames, strict=False)):
        moved[second] = Pose(place.position, poses[second].rotation)
        origin = moved[first.replace("ground", "base")].inverse() @ moved[second]
        axis = moved[second].rotation.T @ place.rotation[:, 2]
        kind = kind.replace("revolute", "continuous")
        lines.append(f'<joint name="j{number}" type="{kind}"><parent link="{first.replace("ground", "base")}"/>')
        lines.append(f'<child link="{second}"/><axis xyz="{numbers(axis)}"/>')
        lines.append(f'<origin xyz="{numbers(origin.position)}" rpy="{numbers(rot.to_rpy(origin.rotation))}"/></joint>')
    kind, last, _, _ = linkage.joints[-1]
    places = {name: moved[name].inverse() @ frames[-1] for name in ("base", last)}
    data = {
        "urdf": "linkage.urdf",
        "parts": {
            name: {"points": {"end": {
                "at": rounded(place.position.tolist(), digits),
                "rotate": {"quaternion": rounded(rot.to_quaternion(place.rotation).tolist(), digits)},
            }}} for name, place in places.items()
        },
        "joints": {"last": {"type": kind, "between": [f"{last}.end", "base.end"], "axis": [0, 0, 1]}},
    }  # fmt: skip
    return "\n".join([*lines, "</robot>"]), json.dumps(data)


def cranks(rng, count):
    """A coupler on parallel cranks of equal length."""
    angle = rng.uniform(0.3, 1.2)
    crank = rng.uniform(0.2, 0.5) * np.array([np.cos(angle), np.sin(angle), 0.0])
    joints = []
    for number in range(count):
        at = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(-0.2, 0.2)])
        joints += [
            ("revolute", "ground", f"c{number}", frame(at)),
            ("revolute", f"c{number}", "coupler", frame(at + crank)),
        ]
    return Linkage(joints, 1)


def double_parallelogram(rng):
    """Two bars with two rungs at different heights."""
    angle = rng.uniform(0.3, 1.2)
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    ends = {name: np.array([*rng.uniform(-1.0, 1.0, 2), 0.0]) for name in ("left", "right")}
    joints = [("revolute", "ground", name, frame(at)) for name, at in ends.items()]
    for rung, height in (("a", rng.uniform(0.2, 0.4)), ("b", rng.uniform(0.5, 0.8))):
        joints += [("revolute", name, rung, frame(at + height * along)) for name, at in ends.items()]
    return Linkage(joints, 1)


def bennett(rng):
    """Four hinges in space: sin α / a = sin β / b, and tan(θ/2) tan(φ/2) = sin((β + α)/2) / sin((β - α)/2)."""
    a, alpha, theta = rng.uniform(0.4, 0.8), rng.uniform(0.5, 1.2), rng.uniform(0.6, 1.4)
    beta = alpha + rng.uniform(0.3, 0.8)
    b = a * np.sin(beta) / np.sin(alpha)
    phi = 2.0 * np.arctan(np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2) / np.tan(theta / 2))
    frames = [Pose(np.zeros(3), np.eye(3))]
    for angle, length, twist in [(theta, a, alpha), (phi, b, beta), (-theta, a, alpha), (-phi, b, beta)]:
        turn, link = Pose(np.zeros(3), rot.about(Z, angle)), Pose(np.array([length, 0.0, 0.0]), rot.about(X, twist))
        frames.append(frames[-1] @ turn @ link)
    assert np.allclose(frames[-1].position, 0.0)
    assert np.allclose(frames[-1].rotation, np.eye(3))
    return _ring(["revolute"] * 4, frames[:4], 1)


def sarrus_with_three_legs(rng):
    """A platform that three chains of parallel hinges move straight."""
    height, width, joints = rng.uniform(0.6, 0.9), rng.uniform(0.2, 0.4), []
    for number, angle in enumerate(rng.uniform(-0.5, 0.5, 3) + np.arange(3) * 2 * np.pi / 3):
        out, along = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
        knee = out * (1.0 + width) + Z * height / 2
        ends = ["ground", f"a{number}", f"b{number}", "top"]
        places = zip(itertools.pairwise(ends), (out, knee, out + Z * height), strict=True)
        joints += [("revolute", first, second, frame(at, along)) for (first, second), at in places]
    return Linkage(joints, 1)


def spherical_legs(rng):
    """A part that turns about a point on three legs, all axes through this point."""
    center, joints = rng.uniform(-0.5, 0.5, 3), []
    for number in range(3):
        ends = ["ground", f"a{number}", f"b{number}", "top"]
        for first, second in itertools.pairwise(ends):
            along = rot.unit(rng.normal(size=3))
            joints.append(("revolute", first, second, frame(center + along * rng.uniform(0.3, 0.8), along)))
    return Linkage(joints, 3)


TOGETHER = {
    "three cranks": lambda rng: cranks(rng, 3),
    "four cranks": lambda rng: cranks(rng, 4),
    "double parallelogram": double_parallelogram,
    "bennett": bennett,
    "sarrus with three legs": sarrus_with_three_legs,
    "spherical legs": spherical_legs,
}  # of which loops are redundant only together, and not because their axes are parallel, or meet
