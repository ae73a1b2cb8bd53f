"""Mechanisms that tests share: texts of textbook systems, random trees, and accelerations at a state."""

from __future__ import annotations

import json
import re

import numpy as np
from hypothesis import strategies as st

from mbd_sim.dynamics.constraints.assembly import close_loops, nearest_speeds
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.text.library import shipped
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS

# All smooth ones whose state is q, u and the energies: the oracles know neither contacts nor actuators.
SHIPPED = tuple(
    name
    for name, path in shipped().items()
    if path.parent.name != "contacts" and "\nactuators:" not in path.read_text(encoding="utf-8")
)
# Few of them that have together every type of joint, element, law and field that any of them has, then loops of several
# sorts, drives and rolling. What is compared for each of them needs no comparison for the others; test_library.py checks it.
KINDS = (
    "air_spring", "balancing_pendulum", "gas_engine", "upright_wheel", "stick_slip", "quadratic_drag", "pencil", "knife_edge",
    "rack_and_pinion", "insect_on_sphere", "atwood", "arm", "snap_through", "universal_pendulum", "screw_press",
    "cylindrical_slider", "follower_force", "slider_crank", "a04_bricard", "spring_chain",
    "bennett", "double_rod", "four_bar", "rotating_frame_mass", "scissor_lift", "spherical_top",
)  # fmt: skip

CART_PENDULUM = """
mechanism: cart_pendulum
parameters: {mc: 1, m: 1, l: 1, k: 20}
parts:
  cart: {mass: mc}
  bob: {mass: m, center: [0, 0, -l]}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], stiffness: k}
  pin: {type: revolute, between: [cart, bob], axis: [0, -1, 0], position: 60 deg}
"""

TRIPLE_ROD = """
mechanism: triple_rod
parameters: {m: 1, l: 0.5, tip: 0.5}
parts:
  first: {mass: m, shape: {type: rod, to: [0, 0, -l]}, points: {tip: [0, 0, -l]}}
  second: {mass: m, shape: {type: rod, to: [0, 0, -l]}, points: {tip: [0, 0, -l]}}
  third: {mass: m, shape: {type: rod, to: [0, 0, -l]}, points: {tip: [0, 0, -l]}}
  particle: {mass: tip}
joints:
  a: {type: revolute, between: [ground, first], axis: [0, -1, 0], stiffness: 8, position: 0.8}
  b: {type: revolute, between: [first.tip, second], axis: [0, -1, 0], stiffness: 6, position: -0.4}
  c: {type: revolute, between: [second.tip, third], axis: [0, -1, 0], stiffness: 4, position: -0.4}
  weld: {type: fixed, between: [third.tip, particle]}
"""

COLLARS = """
mechanism: collars
parameters: {l: 2}
gravity: [0, 0, 0]
parts:
  arm: {mass: 3, shape: {type: rod, to: [l, 0, 0]}}
  inner: {mass: 0.7}
  outer: {mass: 0.4}
joints:
  hub: {type: revolute, between: [ground, arm], axis: [0, 0, 1]}
  first: {type: prismatic, between: [arm, inner], axis: [1, 0, 0], position: 0.3}
  second: {type: prismatic, between: [inner, outer], axis: [1, 0, 0], position: 0.5}
"""

DISK = """
mechanism: disk
parameters: {r: 0.3}
parts:
  disk: {mass: 4, shape: {type: disc, radius: r, axis: [0, 1, 0]}}
joints:
  bearing: {type: revolute, between: [ground, disk], axis: [0, 1, 0]}
"""

PROJECTILE = """
mechanism: projectile
parts:
  body: {mass: 2, inertia: [0.1, 0.25, 0.3]}
joints:
  flight: {type: free, between: [ground, body], velocity: [12, 0, 9], angular_velocity: [0.5, 4, -1]}
"""

# Spring, damper, stop and efforts together, with one joint declared from its outboard to its inboard part.
AUDITED = """
mechanism: audited
parts:
  cart: {mass: 2}
  arm: {mass: 1, shape: {type: rod, to: [0, 0, -0.7]}, points: {tip: [0, 0, -0.7]}}
  hand: {mass: 0.5, center: [0.1, 0.02, -0.2], inertia: [0.02, 0.03, 0.015]}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], stiffness: 40, rest: 0.1, damping: 3}
  shoulder: {type: revolute, between: [arm, cart], axis: [0, 1, 0], position: 0.9, damping: 0.2, STOP}
  wrist: {type: revolute, between: [arm.tip, hand], axis: [1, 2, 2], stiffness: 5, rest: 0.3, damping: 0.1}
"""


def audited(stops: bool):
    """The audited mechanism, with or without elastic stops at the shoulder."""
    limits = "limits: {lower: -0.6, upper: 2.0, stiffness: 200}"
    return AUDITED.replace(", STOP", f", {limits}" if stops else "")


FLOATING = """
mechanism: floating
gravity: [0, 0, 0]
parts:
  base: {mass: 3, center: [0.05, -0.02, 0.01], inertia: [0.2, 0.3, 0.25]}
  left: {mass: 1, shape: {type: rod, to: [0, 0.6, 0.1]}, points: {tip: [0, 0.6, 0.1]}}
  right: {mass: 0.8, center: [0.1, -0.3, 0], inertia: [0.05, 0.02, 0.06]}
  hand: {mass: 0.4, center: [0, 0, 0.1], inertia: [0.01, 0.01, 0.015]}
joints:
  flight:
    {type: free, between: [ground, base], position: [1, 2, 3], velocity: [0.3, -0.2, 0.5],
     angular_velocity: [0.4, 0.8, -0.6]}
  a: {type: revolute, between: [left, base], axis: [1, 0, 1], velocity: 1.5, stiffness: 3, damping: 0.1}
  b: {type: revolute, between: [base, right], axis: [0, 0, 1], velocity: -2, stiffness: 5}
  c: {type: revolute, between: [left.tip, hand], axis: [0, 1, 0], velocity: 2}
"""


def accelerations(equations, q, u, efforts=None, t=0.0):
    """u' (nv,) of derived equations, evaluated by CasADi."""
    places = equations.layout
    y = np.concatenate([q, u, np.zeros(3)])
    rates = evaluated(equations.rates, t, y, np.zeros(places.nv) if efforts is None else efforts)
    return rates.ravel()[places.nq : places.nq + places.nv]


def derived(text):
    """The equations of a mechanism given as text."""
    return derive(parse_mechanism(text))


def random_state(mechanism, rng, reach=2.0):
    """Coordinates with unit quaternions, speeds and efforts."""
    q = []
    for joint in mechanism.joints.values():
        quaternion = rng.normal(size=4)
        quaternion /= np.linalg.norm(quaternion)
        if joint.type == "free":
            q += [*rng.uniform(-reach, reach, 3), *quaternion]
        elif joint.type == "spherical":
            q += [*quaternion]
        else:
            q += [*rng.uniform(-reach, reach, len(joint.coordinate_names))]
    nv = len(mechanism.coordinate_names)
    return np.array(q), rng.uniform(-2.0, 2.0, nv), rng.uniform(-5.0, 5.0, nv)


def consistent_state(equations, rng, t=0.0, reach=1.0):
    """Coordinates, speeds and efforts that satisfy the constraints at time t, up to `reach` from the start."""
    constraints, nv = equations.constraints, equations.layout.nv
    for _ in range(20):
        away = constraints.displaced(equations.start.q, constraints.scales * rng.uniform(-reach, reach, nv))
        closing = close_loops(constraints, t, away, np.ones(nv, dtype=bool))
        if closing.closed:
            speeds = nearest_speeds(constraints, t, closing.q, rng.uniform(-2.0, 2.0, nv))
            return closing.q, speeds, rng.uniform(-5.0, 5.0, nv)
        reach *= 0.7
    raise AssertionError("no closed configuration found")


def violation(sim, equations):
    """The largest violation of the constraints at a simulation's state: of positions, m or 1, and of velocities."""
    return float(np.max(np.abs(evaluated(equations.violation, sim.time, sim.state)), initial=0.0))


def _random_inertia(rng, size):
    """An inertia tensor with positive second moments, so that it satisfies the triangle inequality."""
    second = rng.uniform(0.05, 1.0, 3) * size
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    tensor = turn @ np.diag(second.sum() - second) @ turn.T
    names = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    return {name: float(tensor[place]) for name, place in names.items()}


def _random_point(rng):
    return {
        "at": rng.uniform(-0.6, 0.6, 3).tolist(),
        "rotate": {"axis": rng.normal(size=3).tolist(), "angle": float(rng.uniform(-3.0, 3.0))},
    }


def _random_axes(rng, kind, oblique):
    """The axes of a joint type, along coordinate axes or in random directions."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if oblique else np.eye(3)[rng.permutation(3)]
    first, second = (turn[:2] * rng.choice([-1.0, 1.0], (2, 1))).tolist()
    match kind:
        case "revolute" | "prismatic" | "cylindrical":
            return {"axis": first}
        case "screw":
            return {"axis": first, "lead": float(rng.uniform(-1.0, 1.0))}
        case "universal":
            skewed = (np.array(second) + (0.4 * np.array(first) if rng.random() < 0.3 else 0.0)).tolist()
            return {"axes": [first, skewed]}
        case "planar":
            return {"axis": first, "x_axis": second} if rng.random() < 0.7 else {"axis": first}
    return {}


def _random_curve(rng):
    """A nonlinear law: an expression, or a table."""
    if rng.random() < 0.5:
        return {"force": f"{rng.uniform(1, 9)}*x + {rng.uniform(-3, 3)}*x**3 + {rng.uniform(-3, 3)}*sin(2*x)"}
    count = int(rng.integers(2, 6))
    rows = np.column_stack([np.cumsum(rng.uniform(0.1, 0.9, count)) - 1.0, rng.uniform(-9, 9, count)])
    return {"table": rows.tolist()}


def _random_friction(rng):
    coulomb = float(rng.uniform(0.1, 2.0))
    friction = {"coulomb": coulomb, "viscous": float(rng.uniform(0, 1)), "regularization": float(rng.uniform(0.05, 1))}
    if rng.random() < 0.5:
        friction |= {"static": coulomb * float(rng.uniform(1, 2)), "stribeck_velocity": float(rng.uniform(0.1, 1))}
    return friction


def _random_power(rng):
    exponent = float(rng.choice([0.5, 1.0, 1.5, 2.0, 3.0]))
    return {"coefficient": float(rng.uniform(0.1, 3)), "exponent": exponent}


def _random_two_point_element(rng, kind, ends, to_ground):
    """A spring, bar or damper between two points."""
    if kind == "damper":
        return {"type": kind, "between": ends, "along": str(rng.choice(["line", "velocity"])), **_random_power(rng)}
    element = {"type": kind, "between": ends, "length": float(rng.uniform(0.1, 1)), "damping": float(rng.uniform(0, 2))}
    if kind == "elastic_bar":
        return element | {"stiffness": float(rng.uniform(1, 20)), "strain": str(rng.choice(["green", "small"]))}
    element |= {"stiffness": float(rng.uniform(1, 20))} if rng.random() < 0.5 else _random_curve(rng)
    return element | {"mass": float(rng.uniform(0.1, 2))} if to_ground and rng.random() < 0.5 else element


TWO_POINT_ELEMENTS = ("spring", "elastic_bar", "damper")


def _random_forces(rng, kinds, parts):
    """Force elements at the points of the parts."""
    points = [f"{name}.{point}" for name, part in parts.items() for point in part["points"]]
    forces = {}
    for number, kind in enumerate(kinds):
        first, second = rng.choice(points), rng.choice([*points, "ground"])
        vector = [f"{rng.uniform(-3, 3)}*sin({rng.uniform(-3, 3)}*t) + {rng.uniform(-3, 3)}" for _ in range(3)]
        common = {"vector": vector, "axes": str(rng.choice(["ground", "part", *parts, *points]))}
        joined = re.sub(r".*\D", "", first) == re.sub(r".*\D", "", second)  # possibly the two ends of one joint
        if kind in TWO_POINT_ELEMENTS and first.split(".")[0] != second.split(".")[0] and not joined:
            forces[f"f{number}"] = _random_two_point_element(rng, kind, [str(first), str(second)], second == "ground")
        elif kind == "force":
            forces[f"f{number}"] = {"type": "force", "at": str(first), **common}
        elif kind == "couple":
            forces[f"f{number}"] = {"type": "couple", "on": str(first.split(".")[0]), **common}
    return forces


OF_THE_STATE = ("effort", "potential", "line_force", "bushing")


def _random_forces_of_the_state(rng, kinds, parts, joints):
    """Forces that depend on joint coordinates and speeds, and bushings, which have axes at their points."""
    coordinates = [
        (f"{name}{coordinate.label}", JOINT_KINDS[joint["type"]].quaternion is None or not coordinate.rotation)
        for name, joint in joints.items()
        for coordinate in JOINT_KINDS[joint["type"]].coordinates
    ]
    positions, forces = [name for name, has_position in coordinates if has_position], {}
    for number, kind in enumerate(kinds if positions else ()):
        one, other, along = rng.choice(positions), rng.choice(positions), rng.choice([name for name, _ in coordinates])
        law = f"{rng.uniform(-3, 3)}*sin({one}) + {rng.uniform(-3, 3)}*{other}"
        names = list(parts)
        ends = [str(rng.choice(names)), "ground"][:: int(rng.choice([1, -1]))]
        between = [end if end == "ground" else f"{end}.{next(iter(parts[end]['points']))}" for end in ends]
        match kind:
            case "effort":
                forces[f"s{number}"] = {"type": kind, "coordinate": str(along), "effort": f"{law} - {along}.velocity*t"}
            case "potential":
                forces[f"s{number}"] = {"type": kind, "energy": f"{rng.uniform(0.1, 3)}*({law})**2 + {one}*cos(t)"}
            case "line_force":
                forces[f"s{number}"] = {
                    "type": kind,
                    "between": between,
                    "force": f"{law} + x*x.velocity",
                    "length": 0.3,
                }
            case "bushing":
                keys = ("stiffness", "damping", "rotational_stiffness", "rotational_damping")
                numbers = {key: rng.uniform(0.1, 3, 3).tolist() for key in keys}
                forces[f"s{number}"] = {"type": kind, "between": between, **numbers}
    return forces


OTHERS = ("screw", "cylindrical", "universal", "planar", "spherical")
SEVERAL = {"cylindrical": 2, "universal": 2, "planar": 3}


def _random_motion(draw, rng, kind):
    """A drive of a joint, or springs, dampers, friction and limits."""
    joint = {}
    count = SEVERAL.get(kind, 1)
    if kind in (*SEVERAL, "revolute", "prismatic", "screw") and draw(st.integers(0, 3)) == 0:
        drives = [f"{rng.uniform(-1, 1)}*sin({rng.uniform(-3, 3)}*t) + {rng.uniform(-1, 1)}" for _ in range(count)]
        joint["drive"] = drives if count > 1 else drives[0]
    elif kind in SEVERAL:
        joint |= {"stiffness": rng.uniform(1, 20, count).tolist(), "damping": rng.uniform(0, 2, count).tolist()}
    elif kind == "spherical":
        joint["damping"] = float(rng.uniform(0.1, 2.0))
        joint["stiffness"] = rng.uniform(0.1, 5.0, 3).tolist()
    elif kind in ("revolute", "prismatic", "screw"):
        laws = kind != "screw" and draw(st.booleans())
        if draw(st.booleans()):
            spring = {"spring": _random_curve(rng)} if laws else {"stiffness": float(rng.uniform(1.0, 20.0))}
            joint |= {**spring, "rest": float(rng.uniform(-1.0, 1.0))}
        if draw(st.booleans()):
            joint["damping"] = float(rng.uniform(0.1, 2.0))
        if laws and draw(st.booleans()):
            joint |= {"damper": _random_power(rng), "friction": _random_friction(rng)}
        if draw(st.booleans()):
            joint["limits"] = {"lower": -0.8, "upper": 0.9, "stiffness": 30.0}
            if draw(st.booleans()):
                joint["limits"]["damping"] = float(rng.uniform(0.1, 2.0))
    return joint


@st.composite
def random_trees(draw, most=5, fewest=1):
    """The text of a random open chain, and a random generator for its state."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    parts, joints = {}, {}
    ground_points = {}
    names = ["ground"]
    for number in range(draw(st.integers(fewest, most))):
        name, inboard = f"p{number}", draw(st.sampled_from(names))
        mass = float(10.0 ** rng.uniform(-1.0, 1.0))
        points = {f"to{number}": _random_point(rng)}
        parts[name] = {
            "mass": mass,
            "center": rng.uniform(-0.5, 0.5, 3).tolist(),
            "inertia": _random_inertia(rng, 0.2 * mass),
            "points": points,
        }
        kind = draw(st.sampled_from(["revolute", "revolute", "prismatic", "fixed", "free", *OTHERS]))
        ends = [inboard, name]
        if draw(st.booleans()):
            target = ground_points if inboard == "ground" else parts[inboard]["points"]
            target[f"from{number}"] = _random_point(rng)
            ends = [f"{inboard}.from{number}", f"{name}.to{number}"]
        if draw(st.booleans()):
            ends.reverse()
        joint = {"type": kind, "between": ends, **_random_axes(rng, kind, draw(st.booleans()))}
        joint |= _random_motion(draw, rng, kind)
        joints[f"j{number}"] = joint
        names.append(name)
    forces = _random_forces(
        rng, draw(st.lists(st.sampled_from([*TWO_POINT_ELEMENTS, "force", "couple"]), max_size=3)), parts
    )
    forces |= _random_forces_of_the_state(rng, draw(st.lists(st.sampled_from(OF_THE_STATE), max_size=2)), parts, joints)
    order = draw(st.permutations(list(joints)))
    tree = {
        "mechanism": "random",
        "gravity": rng.uniform(-10.0, 10.0, 3).tolist(),
        "ground": {"points": ground_points},
        "parts": parts,
        "joints": {name: joints[name] for name in order},
        "forces": forces,
    }
    return json.dumps(tree), rng
