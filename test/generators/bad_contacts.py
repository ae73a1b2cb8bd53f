"""Random mechanism files whose contacts and shapes are wrong, or nearly so: what people mistype, and what meshes hold."""

import math
import random

POINTS = (
    "plane", "line", "one", "repeated", "thin", "tiny", "huge", "not finite", "nearly repeated", "many", "text", "good",
)  # fmt: skip
ODD = (float("nan"), float("inf"), -1, 0, 1e-300, 1e300, "a", None, [], "1 m", True)


def _points(chance, kind, dimensions):
    """Points (n, dimensions) of a kind."""
    count = chance.randint(4, 9)
    points = [[round(chance.uniform(-1, 1), 3) for _ in range(dimensions)] for _ in range(count)]
    match kind:
        case "plane":
            return [[*point[:-1], 0.5] for point in points]
        case "line":
            return [[value * point[0] for value in (1, 2, -1)[:dimensions]] for point in points]
        case "one":
            return points[:1]
        case "repeated":
            return points[:1] * count
        case "thin" | "tiny" | "huge":
            scale = {"thin": 1e-8, "tiny": 1e-13, "huge": 1e11}[kind]
            return [[*point[: -1 if kind == "thin" else 0], *(v * scale for v in point[-1 if kind == "thin" else 0 :])]
                    for point in points]  # fmt: skip
        case "not finite":
            points[0][0] = chance.choice(ODD[:2])
        case "nearly repeated":
            points += [[value + 1e-12 for value in point] for point in points]
        case "many":
            angles = [2 * math.pi * k / 150 for k in range(150)]
            return [[math.cos(a), math.sin(a), 0.3 * (-1) ** k][:dimensions] for k, a in enumerate(angles)]
        case "text":
            points[-1] = chance.choice(["x", [1], [1, 2, 3, 4], None, {}])
        case "good" if dimensions == 2:
            points.sort(key=lambda point: math.atan2(*point))
    return points


def _kind(chance):
    return chance.choice(POINTS) if chance.random() < 0.3 else "good"


def _shape(chance):
    kind = chance.choice(["hull", "hull", "outline", "outline", "sphere", "block", "plate", "cone", "ellipsoid", "rod"])
    shape = {"type": kind, "mass": 1}
    match kind:
        case "hull":
            shape["points"] = _points(chance, _kind(chance), 3)
        case "outline":
            shape |= {"plane": "xz", "points": _points(chance, _kind(chance), 2)}
            if chance.random() < 0.2:
                index = chance.randrange(len(shape["points"]))
                key, value = chance.choice(
                    [("radius", 0.2), ("center", [0, 0]), ("through", [0.1, 0]), ("round", 3), ("involute", 0.1)]
                )
                shape["points"][index] = {"to": shape["points"][index], key: value}
            shape |= chance.choice([{}, {}, {"repeat": chance.choice([0, 2, 2.5, 7])}, {"closed": False, "mass": 0}])
        case "sphere" | "cone":
            shape |= {"radius": 0.3} | ({"length": 0.5} if kind == "cone" else {})
        case "block" | "plate" | "ellipsoid":
            key = "radii" if kind == "ellipsoid" else "size"
            shape[key] = [0.4, 0.3, 0.2][: 2 if kind == "plate" else 3]
        case "rod":
            shape |= {"to": [0.3, 0, 0], **chance.choice([{}, {"radius": 0.05}])}
    if chance.random() < 0.06:
        shape[chance.choice([key for key in shape if key != "type"])] = chance.choice(ODD)
    return shape


def _contact(chance):
    known = chance.random() < 0.7
    names = ["a", "b"] if known else ["a", "b", "ground", "z", "a.edge", "ground.foot"]
    pair = chance.sample(names, 2) if known else [chance.choice(names) for _ in range(2)]
    contact = chance.choice(
        [
            {"between": pair},
            {"between": ["a", "b"]},
            {"among": pair},
            {"among": "all"},
            {"parts": "all", "without": pair[:1], "plane": "ground"},
            {"parts": pair[:1], "plane": chance.choice(["ground", "ground.foot", "b"])},
            {"parts": "all", "plane": "ground"},
            {"between": ["a", "b"], "inside": True},
        ]
    )
    for key in ("restitution", "friction", "static_friction", "stiffness", "normal"):
        if chance.random() < 0.05:
            contact[key] = chance.choice([*ODD, 0.3, 0.7, 2])
    return contact


def bad_contacts(seed):
    """The data of a mechanism file with two parts."""
    chance = random.Random(seed)
    parts = {name: {"shape": _shape(chance)} for name in "ab"}
    joint = chance.choice([{"type": "free"}, {"type": "planar", "axis": [0, 1, 0], "x_axis": [1, 0, 0]}])
    places = {"a": chance.choice([[0, 0, 0], [0, 0, 4]]), "b": [0, 0, -4]}
    if joint["type"] == "planar":
        places = {name: [0, -place[2], 0] for name, place in places.items()}
    return {
        "mechanism": f"bad_{seed}",
        "ground": {"points": {"foot": [0, 0, -8]}},
        "parts": parts,
        "joints": {name: {**joint, "between": ["ground", name], "position": places[name]} for name in "ab"},
        "contacts": {"c": _contact(chance), **({"d": _contact(chance)} if chance.random() < 0.3 else {})},
    }
