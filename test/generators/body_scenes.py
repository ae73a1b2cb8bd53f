"""Random scenes of bodies of all shapes that touch each other, a floor and obstacles, with joints, loops and springs.

In a plane: prisms, rods, rollers and outlines. In space: also plates, discs, cones, ellipsoids and hulls. Bodies start
apart in any orientation, and springs keep them near each other.
"""

from __future__ import annotations

import json
import math

import numpy as np

from mbd_sim import Simulation
from test.generators.contact_mechanisms import Draw
from test.generators.outlines import random_chain

SCENES = ("plane_pile", "plane_outlines", "plane_loop", "plane_table", "space_pair", "space_floor", "space_loop")
PLANE_SHAPES = ("sphere", "rod", "bar", "capsule", "block", "block", "prism", "disc", "cylinder")
SPACE_SHAPES = (
    *("sphere", "particle", "rod", "bar", "capsule", "disc", "ring", "cylinder", "block", "plate", "cone"),
    *("ellipsoid", "hull"),
)
PAIRS = [(one, two) for k, one in enumerate(SPACE_SHAPES) for two in SPACE_SHAPES[k:]]
ROUND_IN_PLANE = ("sphere", "disc", "cylinder", "outline")
APART = 0.45  # m, of bodies at the start, none of which reaches farther than 0.2 m from its origin
STEP = 0.002  # s
HINGE = {"type": "revolute", "axis": [0, -1, 0]}
ACROSS = [0, 1, 0]


def scene(seed: int, kind: str, restitution: float | None = None, friction: float | None = None) -> str:
    """The text of a scene; `restitution` and `friction` are drawn where they are not given."""
    draw = Draw(np.random.default_rng([seed, SCENES.index(kind)]), restitution, friction)
    head = {"mechanism": f"{kind}_{seed}", "integrator": {"step": STEP}}
    return json.dumps(head | _MAKERS[kind](draw, seed))


def throw(sim: Simulation, rng: np.random.Generator) -> None:
    """Begin a run with random speeds, and with the bodies that move freely turned at random."""
    sim.reset()
    q, place = sim.q.copy(), 0
    for name in sim.coordinate_names:
        if name.endswith(".angle"):
            q[place] = rng.uniform(-3.0, 3.0)
        elif name.endswith(".rx"):
            turn = rng.normal(size=4)
            q[place : place + 4] = turn / np.linalg.norm(turn)
            place += 1  # four numbers of three speeds
        place += 1
    free = {name.removesuffix(".rx") for name in sim.coordinate_names if name.endswith(".rx")}
    sizes = [0.4 if name[:-2] in free else 1.5 for name in sim.coordinate_names]  # slow enough to meet
    sim.reset(q, rng.normal(size=sim.u.size) * sizes, nearest_speeds=True)


def _shape(draw: Draw, kind: str, spatial: bool) -> dict[str, object]:
    mass, size = draw.number(0.3, 2), draw.number(0.05, 0.12)
    found: dict[str, object] = {"mass": mass}
    axis = {} if spatial else {"axis": ACROSS}
    match kind:
        case "sphere":
            found |= {"type": "sphere", "radius": size}
        case "particle":
            found |= {"type": "particle"}
        case "disc" | "ring":
            found |= {"type": kind, "radius": size, **axis}
        case "cylinder":
            found |= {"type": kind, "radius": size, "length": draw.number(0.03, 0.15), **axis}
        case "cone":
            found |= {"type": kind, "radius": size, "length": draw.number(0.05, 0.19)}
        case "ellipsoid":
            found |= {"type": kind, "radii": [size, draw.number(0.04, 0.15), draw.number(0.04, 0.15)]}
        case "rod" | "bar":
            found |= {"type": "rod", "from": [-size, 0, 0], "to": [1.5 * size, 0, 0]}
            found |= {"radius": round(0.3 * size, 4)} if kind == "bar" else {}
        case "capsule":
            found |= {"type": kind, "radius": round(0.4 * size, 4), "length": 1.5 * size, "axis": [1, 0, 0]}
        case "plate":
            found |= {"type": kind, "size": [2 * size, draw.number(0.05, 0.2)]}
        case "hull":
            points = [draw.vector(1.0) for _ in range(int(draw.rng.integers(4, 9)))]
            found |= {"type": kind, "points": [_shortened(point, 0.06, 0.19) for point in points]}
        case "prism":
            corners = _polygon(draw, int(draw.rng.integers(3, 7)))
            found |= {"type": "hull", "points": [[x, y, z] for x, z in corners for y in (-0.05, 0.05)]}
        case "outline":
            found |= {"type": kind, "plane": "xz", "points": _scaled(random_chain(int(draw.rng.integers(10**6))), 0.09)}
        case _:
            found |= {"type": "block", "size": [2 * size, draw.number(0.05, 0.1), draw.number(0.04, 0.2)]}
    return found


def _shortened(point: list[float], least: float, most: float) -> list[float]:
    size = math.hypot(*point) or 1.0
    return [round(value / size * min(max(size * 0.1, least), most), 4) for value in point]


def _polygon(draw: Draw, count: int) -> list[tuple[float, float]]:
    angles = [2.0 * math.pi * (k + 0.7 * float(draw.rng.random())) / count for k in range(count)]
    return [(round(0.13 * math.cos(a), 4), round(0.1 * math.sin(a), 4)) for a in angles]


def _scaled(chain: object, size: float) -> object:
    """A chain of which all lengths are multiplied by a size."""
    if isinstance(chain, dict):
        return {key: _scaled(value, size) for key, value in chain.items()}
    if isinstance(chain, list):
        return [_scaled(value, size) for value in chain]
    return round(float(chain) * size, 6)  # type: ignore[arg-type]


def _falling(draw: Draw, kinds: list[str]) -> tuple[dict[str, object], dict[str, object]]:
    """Bodies beside each other in the plane xz, each held by a soft spring above the origin."""
    parts: dict[str, object] = {}
    joints: dict[str, object] = {}
    for number, kind in enumerate(kinds):
        parts[f"b{number}"] = _part(_shape(draw, kind, False))
        place = [round(APART * (number - 0.5 * len(kinds) + 0.5), 4), -draw.number(0.5, 0.9), draw.number(-3, 3)]
        joint = {"type": "planar", "between": ["ground", f"b{number}"], "axis": ACROSS, "x_axis": [1, 0, 0]}
        joint |= {"position": place, "stiffness": [draw.number(2, 20), 0, 0]}  # y is down
        joints[f"f{number}"] = {**joint, "velocity": [draw.number(-2, 2), 0, draw.number(-9, 9)]}
    return parts, joints


def _kinds(draw: Draw, among: tuple[str, ...], least: int, most: int) -> list[str]:
    return [str(draw.rng.choice(among)) for _ in range(int(draw.rng.integers(least, most + 1)))]


def _plane_pile(draw: Draw, _: int) -> dict[str, object]:
    """Two or three bodies that fall on a floor and on each other."""
    parts, joints = _falling(draw, _kinds(draw, PLANE_SHAPES, 2, 3))
    contacts = {"floor": {"parts": list(parts), "plane": "ground", **draw.law()}}
    contacts["pairs"] = {"among": list(parts), **draw.law()}
    return {"parts": parts, "joints": joints, "contacts": contacts}


def _plane_outlines(draw: Draw, _: int) -> dict[str, object]:
    """Outlines and rollers that fall on a floor, in a bowl and on each other."""
    parts, joints = _falling(draw, ["outline", *_kinds(draw, ROUND_IN_PLANE, 0, 2)])
    contacts = {"pairs": {"among": list(parts), **draw.law()}} if len(parts) > 1 else {}
    if draw.maybe():
        contacts["floor"] = {"parts": list(parts), "plane": "ground", **draw.law()}
    else:
        arc = {"to": [-2.0, 1.2], "through": [0, -0.02]}  # the material is on its left
        bowl = {"type": "outline", "plane": "xz", "points": [[2.0, 1.2], arc], "closed": False, "mass": 0}
        parts["bowl"], joints["bowl"] = {"shape": bowl}, {"type": "fixed", "between": ["ground", "bowl"]}
        contacts |= {f"bowl{name}": {"between": [name, "bowl"], **draw.law()} for name in list(parts)[:-1]}
    return {"parts": parts, "joints": joints, "contacts": contacts}


def _plane_loop(draw: Draw, _: int) -> dict[str, object]:
    """A four-bar whose coupler is struck by falling bodies, which may lie on it; its crank has stops or a spring."""
    parts, joints = _falling(draw, _kinds(draw, PLANE_SHAPES, 1, 2))
    names = list(parts)
    sizes = {"crank": 0.25, "coupler": 0.8, "rocker": 0.3}
    for name, length in sizes.items():
        parts[name] = {"shape": {"type": "rod", "mass": draw.number(0.3, 2), "to": [length, 0, 0]}}
        parts[name]["points"] = {"end": [length, 0, 0]}
    tray = {"type": "block", "size": [0.7, 0.1, 0.03], "at": [0.4, 0, 0.02], "mass": draw.number(0.1, 1)}
    parts["coupler"] = {"shape": tray, "points": {"end": [0.8, 0, 0]}}
    joints |= {
        "crank": {**HINGE, "between": ["ground.left", "crank"], "position": 1.4, "stiffness": 40, "rest": 1.5},
        "pin": {**HINGE, "between": ["crank.end", "coupler"], "position": -1.4, "guess": True},
        "rocker": {**HINGE, "between": ["ground.right", "rocker"], "position": 1.6, "guess": True},
        "loop": {**HINGE, "between": ["coupler.end", "rocker.end"]},
    }
    joints["crank"] |= {"limits": {"lower": 0.5, "upper": 2.2, "restitution": draw.restitution}}
    contacts = {f"tray{name}": {"between": [name, "coupler"], **draw.law()} for name in names}
    if draw.maybe():
        contacts["floor"] = {"parts": names, "plane": "ground", "normal": [0, 0, 1], **draw.law()}
    if len(names) > 1:
        contacts["pair"] = {"between": names, **draw.law()}
    ground = {"points": {"left": [-0.4, 0, 0], "right": [0.4, 0, 0]}}
    return {"ground": ground, "parts": parts, "joints": joints, "contacts": contacts}


def _plane_table(draw: Draw, _: int) -> dict[str, object]:
    """Bodies on a table that is shaken by a drive, or on a swing that hangs on a spring."""
    parts, joints = _falling(draw, _kinds(draw, PLANE_SHAPES, 1, 3))
    names = list(parts)
    parts["table"] = {"shape": {"type": "block", "size": [1.6, 0.2, 0.1], "at": [0, 0, -0.05], "mass": 2}}
    table: dict[str, object] = {"between": ["ground", "table"]}
    match int(draw.rng.integers(3)):
        case 0:
            drive = f"{draw.number(0.005, 0.03)}*sin({draw.number(5, 30)}*t)"
            table |= {"type": "prismatic", "axis": [0, 0, 1], "drive": drive}
        case 1:
            table |= {"type": "prismatic", "axis": [0.3, 0, 1], "stiffness": draw.number(200, 3000), "damping": 2}
        case _:
            table |= {**HINGE, "stiffness": draw.number(20, 100), "damping": draw.number(0, 1)}
    joints["table"] = table
    contacts = {"table": {"among": [*names, "table"], **draw.law()}}
    return {"parts": parts, "joints": joints, "contacts": contacts}


def _free(draw: Draw, number: int, kind: str, height: float) -> tuple[dict[str, object], dict[str, object]]:
    joint = {"type": "free", "between": ["ground", f"b{number}"], "position": [round(APART * number, 4), 0, height]}
    joint |= {"orientation": {"quaternion": [1.0, *draw.vector(1)]}, "velocity": draw.vector(0.7)}
    spring = [draw.number(20, 100), draw.number(50, 150), draw.number(50, 150), 0, 0, 0]  # they meet at the origin
    return _part(_shape(draw, kind, True)), {**joint, "angular_velocity": draw.vector(6), "stiffness": spring}


def _part(shape: dict[str, object]) -> dict[str, object]:
    """A part of this shape; of a point or a line, with an inertia about each axis."""
    if shape["type"] not in ("particle", "rod"):
        return {"shape": shape}
    return {"shape": shape | {"mass": 0}, "mass": shape["mass"], "inertia": [0.002, 0.003, 0.004]}


def _space_pair(draw: Draw, seed: int) -> dict[str, object]:
    """Two bodies without weight, which springs bring together: all pairs of shapes in turn."""
    parts, joints = {}, {}
    for number, kind in enumerate(PAIRS[seed % len(PAIRS)]):
        parts[f"b{number}"], joints[f"f{number}"] = _free(draw, number, kind, 0.0)
    contacts = {"pair": {"between": list(parts), **draw.law()}}
    return {"gravity": [0, 0, 0], "parts": parts, "joints": joints, "contacts": contacts}


def _space_floor(draw: Draw, seed: int) -> dict[str, object]:
    """A body that falls on a floor, or on a block on it."""
    parts, joints = {}, {}
    parts["b0"], joints["f0"] = _free(draw, 0, SPACE_SHAPES[seed % len(SPACE_SHAPES)], 0.6)
    joints["f0"]["stiffness"] = [10, 10, 0, 0, 0, 0]
    if draw.maybe():
        return {
            "parts": parts,
            "joints": joints,
            "contacts": {"floor": {"parts": ["b0"], "plane": "ground", **draw.law()}},
        }
    parts["table"] = {"shape": {"type": "block", "size": [0.5, 0.4, 0.2], "at": [0, 0, 0.1], "mass": 2}}
    joints["table"] = {"type": "fixed", "between": ["ground", "table"]}
    joints["f0"]["stiffness"] = [30, 60, 10, 0, 0, 0]
    return {"parts": parts, "joints": joints, "contacts": {"table": {"between": ["b0", "table"], **draw.law()}}}


def _space_loop(draw: Draw, seed: int) -> dict[str, object]:
    """A spatial four-bar whose rocker bears a body, which strikes another one on a spring."""
    kinds = SPACE_SHAPES[seed % len(SPACE_SHAPES)], str(draw.rng.choice(SPACE_SHAPES))
    club, target = (_shape(draw, kind, True) for kind in kinds)
    parts = {
        "crank": {"shape": {"type": "rod", "mass": 0.5, "to": [0, 0, 0.3]}, "points": {"end": [0, 0, 0.3]}},
        "rocker": {"shape": {"type": "rod", "mass": 0.5, "to": [0, 0, 0.7]}, "points": {"end": [0, 0, 0.7]}},
        "club": {"shape": club},
        "target": {"shape": target},
    }
    joints = {
        "crank": {
            "type": "revolute",
            "between": ["ground", "crank"],
            "axis": [0, 1, 0],
            "velocity": draw.number(-8, 8),
        },
        "rocker": {"type": "revolute", "between": ["ground.pivot", "rocker"], "axis": [0.3, 1, 0.2]},
        "club": {"type": "fixed", "between": ["rocker.end", "club"]},
        "target": {"type": "prismatic", "between": ["ground.target", "target"], "axis": [1, 0.1, 0]},
    }
    joints["crank"]["limits"] = {"lower": -1.2, "upper": 1.2, "restitution": draw.restitution}
    joints["rocker"] |= {"position": 0.1, "guess": True}
    joints["target"] |= {"stiffness": draw.number(20, 200), "velocity": draw.number(-2, 0)}
    constraints = {"coupler": {"type": "distance", "between": ["crank.end", "rocker.end"], "length": 1.0}}
    ground = {"points": {"pivot": [0.9, 0, -0.1], "target": [1.5, 0, 0.6]}}
    contacts = {"strike": {"between": ["club", "target"], **draw.law()}}
    return {"ground": ground, "parts": parts, "joints": joints, "constraints": constraints, "contacts": contacts}


_MAKERS = {kind: globals()[f"_{kind}"] for kind in SCENES}
