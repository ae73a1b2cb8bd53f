"""Joints that close loops carry what any joint carries, and no result depends on which joint of a loop is cut."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.load import parse_mechanism

FREEDOMS = {"revolute": 1, "prismatic": 1, "screw": 1, "cylindrical": 2, "universal": 2, "planar": 3, "spherical": 3}
LOOPS = [
    ("revolute", "revolute", "spherical", "prismatic", "cylindrical"),
    ("universal", "screw", "spherical", "revolute"),
    ("revolute", "planar", "revolute", "spherical"),
    ("free", "revolute", "prismatic"),
]
CUTS = ("prismatic", "cylindrical"), ("universal", "screw"), ("planar", "spherical"), ("free", "revolute")
PINS = {"a": ("ground", "crank"), "b": ("crank", "coupler"), "c": ("coupler", "rocker"), "d": ("ground", "rocker")}
LAWS = {
    "a": {"damping": 0.11, "friction": {"coulomb": 0.4, "static": 0.5, "stribeck_velocity": 0.1, "regularization": 0.05}},
    "b": {"stiffness": 3, "rest": -0.9, "limits": {"lower": -0.6, "upper": 0.3, "stiffness": 100, "damping": 0.1}},
    "c": {"friction": {"coulomb": 0.2}, "limits": {"lower": -0.3, "upper": 0.5, "restitution": 0.5}},
    "d": {"spring": {"table": [[-3, -2], [0, 0], [3, 4]]}, "damper": {"coefficient": 0.1, "exponent": 2}, "effort_limit": 5},
}  # fmt: skip


def accelerations(simulation):
    """The accelerations of all coordinates by name."""
    mechanism, model = simulation.mechanism, simulation.model
    names = [*mechanism.coordinate_names, *mechanism.driven_names]
    return dict(zip(names, model.accelerations(0.0, simulation.state, simulation.inputs), strict=True))


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
        cut = {pin: law | ({"cut": True} if pin == name else {}) for pin, law in laws.items()}
        return Simulation(self.file(cut, **further))

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
    for cut in ("a", "b"):
        laws = {name: {"damping": value} for name, value in bar.dampings.items()}
        found = accelerations(bar.cut_at(cut, laws))
        assert {name: found[name] for name in PINS} == pytest.approx(wanted, rel=1e-9), cut


def test_no_result_depends_on_the_joint_that_is_cut():
    """With springs, dampers, friction of both kinds, stops of both kinds, an effort and an actuator."""
    bar = FourBar(1)
    loads = {
        "forces": {"push": {"type": "effort", "coordinate": "c", "effort": "0.3*sin(5*t) + 0.1*a.velocity"}},
        "actuators": {"motor": {"type": "effort", "joint": "c", "command": {"effort": 0.2}}},
        "sensors": {"speed": {"type": "tachometer", "joint": "c"}},
    }
    found = [bar.cut_at(cut, LAWS, **loads) for cut in ("a", "b", "c")]
    states = [state_after(one, 0.4) for one in found]
    reactions = [np.concatenate([[*load.force, *load.moment] for load in one.reactions().values()]) for one in found]
    for state, reaction in zip(states[1:], reactions[1:], strict=True):
        assert state == pytest.approx(states[0], abs=1e-9)
        assert reaction == pytest.approx(reactions[0], abs=1e-7)
    assert found[0].poses().keys() == {"crank", "coupler", "rocker"}
    assert all(one.mechanism.mass == found[0].mechanism.mass for one in found)


@pytest.mark.parametrize(
    "drive", [{"drive": "0.2*sin(3*t)"}, {"drive": {"command": "position", "bandwidth": "20 rad/s"}}]
)
def test_a_drive_at_a_joint_that_is_cut(drive):
    bar = FourBar(2)
    laws = {name: {"damping": value} for name, value in bar.dampings.items()} | {"c": drive}
    states = []
    for cut in (None, "b"):
        given = {name: law | ({"cut": True} if name == cut else {}) for name, law in laws.items()}
        simulation = Simulation(bar.file(given))
        if "command" in str(drive):
            simulation.set_commands({"c": 0.1})
        simulation.run(until=0.3)
        states.append(simulation.poses()["coupler"].position)
    assert all(state == pytest.approx(states[0], abs=1e-9) for state in states)


def random_loop(kinds, rng, cut=None, loads=True):
    """A loop of joints of these kinds through parts in random places, closed at the start, where all coordinates are 0."""
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
            joint |= {"damping": [damping] * FREEDOMS[kind]} if FREEDOMS.get(kind, 6) in (2, 3) else {}
            joint |= {"damping": damping, "stiffness": stiffness} if FREEDOMS.get(kind) == 1 else {}
            joint |= {"damping": [damping] * 6, "stiffness": [stiffness] * 6} if kind == "free" else {}
        joints[f"j{number}"] = joint | ({"cut": True} if number == cut else {})
    parts = {
        name: {"mass": float(rng.uniform(0.5, 2)), "inertia": [float(rng.uniform(0.05, 0.2))] * 3,
               "points": points[name]}
        for name in names[1:]
    }  # fmt: skip
    return {"mechanism": "loop", "ground": {"points": points["ground"]}, "parts": parts, "joints": joints}


@pytest.mark.parametrize(("kinds", "cuts"), [*zip(LOOPS, CUTS, strict=True)], ids=map("-".join, LOOPS))
def test_each_kind_of_joint_may_be_cut(kinds, cuts):
    """The same motion of all parts, whichever joint is cut: also where it has several coordinates, or a quaternion."""
    states = []
    for cut in map(kinds.index, cuts):
        simulation = Simulation(parse_mechanism(json.dumps(random_loop(kinds, np.random.default_rng(7), cut))))
        assert not simulation.mechanism.closing
        simulation.run(until=0.2)
        poses = simulation.poses()
        states.append(
            np.concatenate([np.r_[poses[name].position, poses[name].rotation.ravel()] for name in sorted(poses)])
        )
        assert abs(simulation.energies.residual) < 1e-9
    assert all(state == pytest.approx(states[0], abs=1e-9) for state in states)


def test_a_split_part_moves_as_one_that_is_not():
    """Beside the loop with a closing joint that carries nothing: its damping tends to 0 in the other one."""
    data = random_loop(LOOPS[1], np.random.default_rng(3), loads=False)
    plain = Simulation(parse_mechanism(json.dumps(data)))
    (closing,) = plain.mechanism.closing
    data["joints"][closing]["cut"] = True
    count = FREEDOMS[data["joints"][closing]["type"]]
    data["joints"][closing]["damping"] = 1e-30 if count == 1 else [1e-30] * count
    split = Simulation(parse_mechanism(json.dumps(data)))
    assert not split.mechanism.closing
    for one in (plain, split):
        one.run(until=0.3)
    for name, pose in plain.poses().items():
        assert split.poses()[name].position == pytest.approx(pose.position, abs=1e-10)
    assert split.energies.total == pytest.approx(plain.energies.total, abs=1e-10)


def test_a_part_without_mass_is_not_the_one_that_is_split():
    """Of a massless coupler no piece has inertia: the crank, which has some, is split in its place."""
    bar = FourBar(4)
    data = json.loads(bar.file().source.text)
    data["parts"]["coupler"] |= {"mass": 0, "inertia": [0, 0, 0]}
    light = Simulation(parse_mechanism(json.dumps(data)))
    data["parts"]["coupler"] |= {"mass": 1e-9, "inertia": [1e-9, 1e-9, 1e-9]}
    nearly = Simulation(parse_mechanism(json.dumps(data)))
    assert accelerations(light)["a"] == pytest.approx(accelerations(nearly)["a"], rel=1e-6)
