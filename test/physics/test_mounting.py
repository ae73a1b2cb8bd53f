"""Shipped mechanisms on a base that is rotated, displaced, and accelerated.

In a frame that moves with acceleration a and does not rotate, bodies move as if gravity were g - a. With g + a in place
of g nothing in the mechanism changes: q, u and all forces are the same numbers, although every joint, constraint and
force element is now attached to a part that a drive moves.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry.rotation import from_quaternion, unit
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.loops import state_near_start
from test.generators.mechanisms import accelerations, random_state

QUATERNION = unit(np.array([0.7, -0.2, 0.5, 0.4]))
ALONG = unit(np.array([1.0, -2.0, 0.5]))
AT, SPEED, ACCELERATION = np.array([0.7, -1.1, 0.4]), 1.3, 2.7
T = 0.3

# Keys that refer to ground unless the file says otherwise.
CARRIERS = {"on_plane": "plane", "on_line": "line", "on_surface": "frame", "on_curve": "frame"}
CARRIERS |= {"rolling": "plane", "knife_edge": "plane", "force": "axes", "couple": "axes"}


def carried(name):
    """The mechanism on a base that a drive moves by v t + a t²/2, with gravity adjusted accordingly."""
    mechanism = load_mechanism(name)
    data = dict(mechanism.source.data)

    def renamed(value):
        if isinstance(value, str) and (value == "ground" or value.startswith("ground.")):
            return value.replace("ground", "world", 1)
        if isinstance(value, list):
            return [renamed(item) for item in value]
        return {key: renamed(item) for key, item in value.items()} if isinstance(value, dict) else value

    for section in ("joints", "constraints", "forces"):
        data[section] = renamed(data.get(section, {}))
        for record in data[section].values():
            if record["type"] in CARRIERS:
                record.setdefault(CARRIERS[record["type"]], "world")
                if record[CARRIERS[record["type"]]] == "ground":
                    record[CARRIERS[record["type"]]] = "world"
    rail = {"mass": 0, "points": {"turned": {"rotate": {"quaternion": QUATERNION.tolist()}}}}
    data["parts"] = {**data["parts"], "rail": rail, "world": {"mass": 3, **data.get("ground", {})}}
    data["ground"] = {"points": {"start": AT.tolist()}}
    data["joints"]["track"] = {
        "type": "prismatic",
        "between": ["ground.start", "rail"],
        "axis": ALONG.tolist(),
        "drive": f"{SPEED}*t + {ACCELERATION / 2}*t^2",
    }
    data["joints"]["mount"] = {"type": "fixed", "between": ["rail.turned", "world"]}
    data["gravity"] = (from_quaternion(QUATERNION) @ mechanism.gravity + ACCELERATION * ALONG).tolist()
    return json.dumps(data, default=str)


# A spring with mass must have one end on ground; these mechanisms keep theirs there.
MOUNTED = ["upright_wheel", "quadratic_drag", "insect_on_sphere", "follower_force", "four_bar"]


def reactions(mechanism, derived, q, u, efforts):
    """Force and moment (2, 3) through each joint, by name."""
    columns = np.array(derived.reactions(T, np.concatenate([q, u, np.zeros(3)]), efforts)).T
    return dict(zip(mechanism.all_joints, columns.reshape(-1, 2, 3), strict=True))


@pytest.mark.parametrize("name", MOUNTED)
def test_accelerations_and_reactions_are_the_same(name):
    mechanism, mounted = load_mechanism(name), parse_mechanism(carried(name))
    fixed, moving, rng = derive(mechanism), derive(mounted), np.random.default_rng(130)
    assert [row.name for row in moving.rows] == [row.name for row in fixed.rows]
    turn = from_quaternion(QUATERNION)
    for _ in range(3):
        q, u, efforts = state_near_start(mechanism, fixed, rng, T) if fixed.rows else random_state(mechanism, rng)
        expected = accelerations(fixed, q, u, efforts, T)
        scale = np.sqrt(np.diag(fixed.constraints.mass_matrix(T, q)))
        error = scale * (accelerations(moving, q, u, efforts, T) - expected)
        assert np.linalg.norm(error) <= 1e-12 * max(np.linalg.norm(scale * expected), 1.0)
        if len(fixed.start.independent) < len(fixed.rows):
            continue  # statics does not say how joints share their load
        forces = reactions(mechanism, fixed, q, u, efforts)
        found = reactions(mounted, moving, q, u, efforts)
        size = max(1.0, *(np.max(np.abs(force)) for force in found.values()))
        for joint, force in forces.items():
            assert found[joint] == pytest.approx(force @ turn.T, abs=1e-12 * size)


@pytest.mark.parametrize("name", ["rolling_disc"])
def test_the_motion_is_the_same(name):
    """All parts have the same poses relative to the base, and the audit closes despite the larger energies.

    Steps of `tsitouras8` have the same truncation error in both, which for tops is some 1e-12; `adams11` divides its
    steps only where the equations are longer.
    """
    fixed = Simulation.from_file(name, method="tsitouras8")
    moving = Simulation.from_text(carried(name), method="tsitouras8")
    for sim in (fixed, moving):
        sim.run(until=1.0)
    assert moving.q == pytest.approx(fixed.q, abs=1e-12)
    assert moving.u == pytest.approx(fixed.u, abs=1e-12)
    turn, world = from_quaternion(QUATERNION), AT + (SPEED + ACCELERATION / 2.0) * ALONG
    poses = moving.poses()
    for part, pose in fixed.poses().items():
        assert poses[part].position == pytest.approx(world + turn @ pose.position, abs=1e-12)
        assert poses[part].rotation == pytest.approx(turn @ pose.rotation, abs=1e-12)
    assert abs(moving.energies.residual) < 1e-11
