"""Joints that close loops carry what any joint carries, and no result depends on which joint of a loop is cut."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from test.generators.mechanisms import accelerations

FREEDOMS = {"revolute": 1, "prismatic": 1, "screw": 1, "cylindrical": 2, "universal": 2, "planar": 3, "spherical": 3}
LOOPS = {  # with one degree of freedom each, and the joints at which they are cut
    ("prismatic", "cylindrical", "spherical", "revolute"): ("prismatic", "cylindrical", "spherical"),
    ("screw", "planar", "universal", "revolute"): ("screw", "planar", "universal"),
    ("prismatic", "free"): ("prismatic", "free"),
}
PINS = {"a": ("ground", "crank"), "b": ("crank", "coupler"), "c": ("coupler", "rocker"), "d": ("ground", "rocker")}
LAWS = {
    "a": {"damping": 0.11, "friction": {"coulomb": 0.4, "static": 0.5, "stribeck_velocity": 0.1, "regularization": 0.05}},
    "b": {"stiffness": 3, "rest": -0.9, "limits": {"lower": -0.6, "upper": 0.3, "stiffness": 100, "damping": 0.1}},
    "c": {"friction": {"coulomb": 0.2}, "limits": {"lower": -0.3, "upper": 0.5, "restitution": 0.5}},
    "d": {"spring": {"table": [[-3, -2], [0, 0], [3, 4]]}, "damper": {"coefficient": 0.1, "exponent": 2}, "effort_limit": 5},
}  # fmt: skip


def accelerations_at_start(mechanism):
    """The accelerations of all coordinates by name."""
    equations = derive(mechanism)
    found = accelerations(equations, equations.start.q, equations.start.u)
    return dict(zip(mechanism.coordinate_names, found, strict=True))


def state_after(simulation, time):
    simulation.run(until=time)
    return np.concatenate([simulation.q, simulation.u])


class FourBar:
    """A random four-bar linkage in a plane of any direction, with its poses at the start."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.axes = rot.from_quaternion(rot.unit(rng.normal(size=4)))  # x and y in the plane, z its normal
        self.places = {"a": np.zeros(2), "b": rng.uniform(0.3, 0.6, 2), "d": np.array([1.0, 0.1])}
        self.places["c"] = self.places["d"] + rng.uniform(0.2, 0.7, 2)
        self.centers = {n: np.mean([self.places[p] for p in PINS if n in PINS[p]], 0) for n in PINS["b"] + ("rocker",)}
        self.masses = {name: float(rng.uniform(0.5, 2.0)) for name in self.centers}
        self.inertias = {name: float(rng.uniform(0.05, 0.2)) for name in self.centers}
        self.dampings = dict(zip(PINS, rng.uniform(0.1, 2.0, 4).tolist(), strict=True))
        self.speed = float(rng.uniform(1.0, 3.0))

    def file(self, laws=None, **further):
        """The mechanism file, all parts with ground's axes at the start, where all angles are 0."""
        laws = laws or {name: {"damping": value} for name, value in self.dampings.items()}
        in_space = {name: (self.axes[:, :2] @ place).tolist() for name, place in self.places.items()}
        parts = {
            name: {
                "mass": self.masses[name],
                "center": (self.axes[:, :2] @ self.centers[name]).tolist(),
                "inertia": [self.inertias[name]] * 3,
                "points": in_space,
            }
            for name in self.centers
        }
        joints = {
            name: {
                "type": "revolute",
                "between": [f"{part}.{name}" for part in PINS[name]],
                "axis": self.axes[:, 2].tolist(),
                **laws.get(name, {}),
            }
            for name in PINS
        }
        if not any("drive" in law for law in laws.values()):
            joints["a"]["velocity"] = self.speed
        data = {"mechanism": "loop", "ground": {"points": in_space}, "parts": parts, "joints": joints, **further}
        return parse_mechanism(json.dumps(data))

    def cut_at(self, name, laws, **further):
        return self.file({pin: law | ({"cut": True} if pin == name else {}) for pin, law in laws.items()}, **further)

    def relative_accelerations(self):
        """Those of the pins, from Newton-Euler equations of the free bodies in the plane with multipliers."""
        names = ["ground", *self.centers]
        gravity = self.axes[:, :2].T @ np.array([0.0, 0.0, -9.81])
        mass = np.diag([v for n in self.centers for v in (self.masses[n], self.masses[n], self.inertias[n])])
        relative = np.zeros((4, 9))  # the speeds of the pins by those of the bodies
        rows, offsets = np.zeros((8, 9)), np.zeros((8, 9))
        for number, (pin, ends) in enumerate(PINS.items()):
            for sign, name in zip((-1.0, 1.0), ends, strict=True):
                if name == "ground":
                    continue
                at, arm = 3 * (names.index(name) - 1), self.places[pin] - self.centers[name]
                relative[number, at + 2] = sign
                pair = slice(2 * number, 2 * number + 2)
                rows[pair, at : at + 2] = sign * np.eye(2)
                rows[pair, at + 2] = sign * np.array([-arm[1], arm[0]])
                offsets[pair, at + 2] = sign * arm
        speeds = np.linalg.lstsq(np.vstack([rows, relative[:1]]), np.r_[np.zeros(8), self.speed], rcond=None)[0]
        loads = np.concatenate([[*(self.masses[n] * gravity), 0.0] for n in self.centers])
        loads -= relative.T @ (np.array(list(self.dampings.values())) * (relative @ speeds))
        matrix = np.block([[mass, rows.T], [rows, np.zeros((8, 8))]])
        found = np.linalg.solve(matrix, np.r_[loads, offsets @ speeds**2])[:9]
        return dict(zip(PINS, relative @ found, strict=True))


def test_dampers_in_all_pins_of_a_loop():
    """Beside the Newton-Euler equations of the bodies: a load that is left out, or acts on the wrong side, shows."""
    bar = FourBar(1)
    wanted = bar.relative_accelerations()
    laws = {name: {"damping": value} for name, value in bar.dampings.items()}
    found = accelerations_at_start(bar.cut_at("b", laws))
    assert {name: found[name] for name in PINS} == pytest.approx(wanted, rel=1e-9)


def test_no_result_depends_on_the_joint_that_is_cut():
    """With springs, dampers, friction of both kinds, stops of both kinds, an effort and an actuator."""
    bar = FourBar(1)
    loads = {
        "forces": {"push": {"type": "effort", "coordinate": "c", "effort": "0.3*sin(5*t) + 0.1*a.velocity"}},
        "actuators": {"motor": {"type": "effort", "joint": "c", "command": {"effort": 0.2}}},
        "sensors": {"speed": {"type": "tachometer", "joint": "c"}},
    }
    found = [Simulation(bar.cut_at(cut, LAWS, **loads), method="tsitouras8") for cut in ("a", "c")]
    states = [state_after(one, 0.4) for one in found]
    reactions = [np.concatenate([[*load.force, *load.moment] for load in one.reactions().values()]) for one in found]
    for state, reaction in zip(states[1:], reactions[1:], strict=True):
        assert state == pytest.approx(states[0], abs=1e-9)
        assert reaction == pytest.approx(reactions[0], abs=1e-7)
    assert found[0].poses().keys() == {"crank", "coupler", "rocker"}
    assert all(one.mechanism.mass == found[0].mechanism.mass for one in found)


def test_a_drive_in_a_loop_that_is_cut():
    bar = FourBar(2)
    laws = {name: {"damping": value} for name, value in bar.dampings.items()} | {"c": {"drive": "0.2*sin(3*t)"}}
    found = accelerations_at_start(bar.cut_at("b", laws))
    for name, acceleration in accelerations_at_start(bar.file(laws)).items():
        assert found[name] == pytest.approx(acceleration, rel=1e-9)


def random_loop(kinds, rng, cut=None, loads=True):
    """A loop of joints of these kinds through parts in random places, closed at the start, where all coordinates are 0.

    The first joint has a speed.
    """
    count = len(kinds)
    poses = [Pose(np.zeros(3), np.eye(3))]
    poses += [Pose(rng.uniform(-1, 1, 3), rot.from_quaternion(rot.unit(rng.normal(size=4)))) for _ in kinds[1:]]
    names = ["ground", *(f"p{n}" for n in range(1, count))]
    points = {name: {} for name in names}
    joints = {}
    for number, kind in enumerate(kinds):
        frame = Pose(rng.uniform(-1, 1, 3), rot.from_quaternion(rot.unit(rng.normal(size=4))))
        ends = [number, (number + 1) % count]
        for end in ends:
            local = poses[end].inverse() @ frame
            quaternion = rot.to_quaternion(local.rotation).tolist()
            points[names[end]][f"j{number}"] = {"at": local.position.tolist(), "rotate": {"quaternion": quaternion}}
        joint = {"type": kind, "between": [f"{names[end]}.j{number}" for end in ends]}
        if kind == "universal":
            joint["axes"] = [[0, 0, 1], [1, 0, 0]]
        elif kind not in ("spherical", "free"):
            joint["axis"] = [0, 0, 1]
        if kind == "screw":
            joint["lead"] = 0.4
        damping, stiffness = rng.uniform(0.1, 1.0, 2).tolist()
        if loads:
            joint |= (
                {"damping": [damping, 2 * damping, 3 * damping][: FREEDOMS[kind]]}
                if FREEDOMS.get(kind, 6) in (2, 3)
                else {}
            )
            joint |= {"damping": damping, "stiffness": stiffness, "rest": 0.3} if FREEDOMS.get(kind) == 1 else {}
            joint |= {"damping": [damping] * 6, "stiffness": [stiffness] * 6} if kind == "free" else {}
        if number == 0:
            joint["velocity"] = 0.7
        joints[f"j{number}"] = joint | ({"cut": True} if number == cut else {})
    parts = {
        name: {"mass": float(rng.uniform(0.5, 2)), "inertia": [float(rng.uniform(0.05, 0.2))] * 3,
               "points": points[name]}
        for name in names[1:]
    }  # fmt: skip
    return {"mechanism": "loop", "ground": {"points": points["ground"]}, "parts": parts, "joints": joints}


@pytest.mark.parametrize(("kinds", "cuts"), LOOPS.items(), ids=map("-".join, LOOPS))
def test_each_kind_of_joint_may_be_cut(kinds, cuts):
    """The same accelerations, whichever joint is cut: also where it has several coordinates, or a quaternion."""
    found = []
    for cut in map(kinds.index, cuts):
        mechanism = parse_mechanism(json.dumps(random_loop(kinds, np.random.default_rng(7), cut)))
        assert not mechanism.closing
        found.append(accelerations_at_start(mechanism))
    assert max(map(abs, found[0].values())) > 0.1
    assert all(each == pytest.approx(found[0], rel=1e-9, abs=1e-9) for each in found[1:])


def test_a_split_part_moves_as_one_that_is_not():
    """Beside the loop with a closing joint that carries nothing: its damping tends to 0 in the other one."""
    data = random_loop(("screw", "planar", "universal", "revolute"), np.random.default_rng(3), loads=False)
    plain = parse_mechanism(json.dumps(data))
    (closing,) = plain.closing
    data["joints"][closing]["cut"] = True
    count = FREEDOMS[data["joints"][closing]["type"]]
    data["joints"][closing]["damping"] = 1e-30 if count == 1 else [1e-30] * count
    split = parse_mechanism(json.dumps(data))
    assert not split.closing
    found = accelerations_at_start(split)
    for name, acceleration in accelerations_at_start(plain).items():
        assert found[name] == pytest.approx(acceleration, rel=1e-9, abs=1e-9)


def test_a_part_without_mass_is_not_the_one_that_is_split():
    """Of a massless coupler no piece has inertia: the crank, which has some, is split in its place."""
    bar = FourBar(4)
    data = json.loads(bar.file().source.text)
    data["parts"]["coupler"] |= {"mass": 0, "inertia": [0, 0, 0]}
    light = accelerations_at_start(parse_mechanism(json.dumps(data)))
    data["parts"]["coupler"] |= {"mass": 1e-9, "inertia": [1e-9, 1e-9, 1e-9]}
    nearly = accelerations_at_start(parse_mechanism(json.dumps(data)))
    assert light["a"] == pytest.approx(nearly["a"], rel=1e-6)
