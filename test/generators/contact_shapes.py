"""Random bodies in contact: shapes with a plane and with each other, in the plane and in space; cams; joint stops."""

from __future__ import annotations

UPRIGHT = {"type": "planar", "axis": [0, 1, 0], "x_axis": [1, 0, 0]}


def _shape(draw, kinds):
    kind = kinds[int(draw.rng.integers(len(kinds)))]
    mass, size = draw.number(0.5, 2), draw.number(0.06, 0.15)
    match kind:
        case "sphere":
            return {"type": "sphere", "mass": mass, "radius": size}
        case "disc":
            return {"type": "disc", "mass": mass, "radius": size, "axis": [0, 1, 0]}
        case "cylinder":
            sizes = {"radius": size, "length": draw.number(0.05, 0.3)}
            return {"type": "cylinder", "mass": mass, **sizes, "axis": [0, 1, 0]}
        case "capsule":
            return {"type": "rod", "mass": mass, "from": [-size, 0, 0], "to": [size, 0, 0], "radius": 0.4 * size}
        case _:
            return {"type": "block", "mass": mass, "size": [2 * size, draw.number(0.05, 0.1), draw.number(0.05, 0.2)]}


def flat_bodies(draw):
    """Discs, balls, capsules and blocks that fall on a floor; those that are round strike each other."""
    count = int(draw.rng.integers(1, 4))
    parts, joints, contacts = {}, {}, {}
    for number in range(count):
        parts[f"b{number}"] = {"shape": _shape(draw, ("sphere", "disc", "capsule", "block"))}
        place = [round(0.4 * number, 4), -draw.number(0.3, 0.7), draw.number(-3, 3)]  # y is down
        speeds = [draw.number(-2, 2), draw.number(-1, 1), draw.number(-15, 15)]
        joints[f"f{number}"] = {**UPRIGHT, "between": ["ground", f"b{number}"], "position": place, "velocity": speeds}
    contacts["floor"] = {"parts": list(parts), "plane": "ground", **draw.law()}
    if draw.maybe():
        contacts["wall"] = {"parts": list(parts), "plane": "ground.wall", "normal": [-1, 0, 0], **draw.law()}
    round_ones = [name for name, part in parts.items() if part["shape"]["type"] in ("sphere", "disc")]
    pairs = [
        (first, second)
        for number, first in enumerate(round_ones)
        for second in round_ones[number + 1 :]
        if "sphere" in (parts[first]["shape"]["type"], parts[second]["shape"]["type"])
    ]
    for number, pair in enumerate(pairs):
        contacts[f"pair{number}"] = {"between": list(pair), **draw.law()}
    points = {"wall": [round(0.4 * count + 0.2, 4), 0, 0]}
    return {"ground": {"points": points}, "parts": parts, "joints": joints, "contacts": contacts}


def spatial_bodies(draw):
    """Balls, discs or cylinders that fall on a floor and are thrown about; balls strike each other."""
    count = int(draw.rng.integers(1, 3))
    parts, joints = {}, {}
    for number in range(count):
        parts[f"b{number}"] = {"shape": _shape(draw, ("sphere", "sphere", "disc", "cylinder"))}
        joint = {"type": "free", "between": ["ground", f"b{number}"], "position": [round(0.5 * number, 4), 0, 0.45]}
        joint |= {"orientation": {"quaternion": [1.0, *(0.2 * part for part in draw.vector(1))]}}
        joints[f"f{number}"] = {**joint, "velocity": draw.vector(0.7), "angular_velocity": draw.vector(6)}
    contacts = {"floor": {"parts": list(parts), "plane": "ground", **draw.law()}}
    balls = [name for name, part in parts.items() if part["shape"]["type"] == "sphere"]
    if len(balls) > 1:
        contacts["pair"] = {"among": balls, **draw.law()}
    return {"parts": parts, "joints": joints, "contacts": contacts}


def cam(draw):
    """A driven or free cam that lifts a roller follower with a spring."""
    base, lift, roller = 0.03, draw.number(0.002, 0.01), 0.01
    parts = {
        "cam": {"shape": {"type": "cylinder", "mass": 0.5, "radius": base, "length": 0.01, "at": [lift, 0, 0]}},
        "follower": {"shape": {"type": "cylinder", "mass": draw.number(0.1, 0.5), "radius": roller, "length": 0.01}},
    }
    parts["follower"]["shape"]["axis"] = [0, 1, 0]
    turning = {"type": "revolute", "between": ["ground.cam", "cam"], "axis": [0, 0, 1]}
    speed = draw.number(5, 80)
    turning |= {"drive": f"{speed}*t"} if draw.maybe() else {"velocity": speed, "damping": 1e-4}
    follower = {"type": "prismatic", "between": ["ground", "follower"], "axis": [0, 0, 1]}
    follower |= {"position": round(base + roller + lift + 0.001, 4), "stiffness": draw.number(50, 800), "rest": 0.0}
    if draw.maybe(0.4):
        follower |= draw.joint_friction(1.0, False)
    profile = f"{lift}*cos(angle) + sqrt({base}**2 - ({lift}*sin(angle))**2)"
    contact = {"parts": ["follower"], "cam": "cam", "profile": profile, **draw.law()}
    contact["restitution"] = min(contact["restitution"], 0.95)  # with 1 it hops without end, 30,000 times a second
    return {
        "ground": {"points": {"cam": {"rotate": {"axis": [1, 0, 0], "angle": "90 deg"}}}},
        "parts": parts,
        "joints": {"cam": turning, "follower": follower},
        "contacts": {"lift": contact},
    }


def limited_joints(draw):
    """A body on a universal, cylindrical or planar joint with stops of some coordinates, and one that hangs on it."""
    kind = ("universal", "cylindrical", "planar")[int(draw.rng.integers(3))]
    keys = {
        "universal": {"axes": [[1, 0, 0], [0.3, 1, 0]]},
        "cylindrical": {"axis": [1, 0, draw.number(-2, 2)]},
        "planar": {"axis": [0, 1, 0], "x_axis": [1, 0, 0]},
    }[kind]
    count = 3 if kind == "planar" else 2
    limits = [draw.stops(1.0) if draw.maybe(0.8) else None for _ in range(count)]
    limits[0] = limits[0] or draw.stops(1.0)
    joint = {"type": kind, "between": ["ground", "body"], **keys, "limits": limits}
    joint["velocity"] = [draw.number(-3, 3) for _ in range(count)]
    body = {"type": "block", "mass": 1, "size": [0.1, 0.2, 0.4], "at": [0.02, 0.01, -0.3]}
    parts = {"body": {"shape": body, "points": {"end": [0, 0, -0.5]}}}
    joints = {"joint": joint}
    if draw.maybe():
        parts["bob"] = {"shape": {"type": "sphere", "mass": 0.5, "radius": 0.05, "at": [0, 0, -0.3]}}
        swing = {"type": "revolute", "between": ["body.end", "bob"], "axis": [0, 1, 0], "velocity": draw.number(-4, 4)}
        joints["swing"] = {**swing, "limits": draw.stops(1.5), **draw.joint_friction(0.2, True)}
    return {"parts": parts, "joints": joints}
