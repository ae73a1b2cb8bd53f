"""The scenes of `body_scenes`, described otherwise: their coordinates and speeds have the same values in any of these."""

from __future__ import annotations

import copy

import numpy as np

from mbd_sim.base.geometry import rotation as rot

GRAVITY = [0.0, 0.0, -9.81]


def random_turn(rng: np.random.Generator) -> np.ndarray:
    """Any rotation (3, 3)."""
    turn = rng.normal(size=4)
    return rot.from_quaternion(turn / np.linalg.norm(turn))


def turned_world(data: dict, turn: np.ndarray, shift: np.ndarray) -> dict:
    """Everything that is fixed to ground, and gravity, turned and then shifted."""
    data = copy.deepcopy(data)
    data["gravity"] = (turn @ data.get("gravity", GRAVITY)).tolist()
    points = data.setdefault("ground", {}).setdefault("points", {})
    points |= {name: _frame(shift + turn @ np.array(at), turn) for name, at in points.items()}
    points["world"] = _frame(shift, turn)
    for joint in data["joints"].values():
        joint["between"] = ["ground.world" if name == "ground" else name for name in joint["between"]]
    for contact in data["contacts"].values():
        if contact.get("plane") == "ground":
            contact["plane"] = "ground.world"
    return data


def other_frames(data: dict, rng: np.random.Generator, turns: bool = True) -> dict:
    """Each part in a frame of its own, turned if `turns` and shifted against the one before."""
    data = copy.deepcopy(data)
    for part in data["parts"].values():
        turn, shift = random_turn(rng) if turns else np.eye(3), rng.normal(size=3) * 0.1
        part["points"] = {
            name: _frame(shift + turn @ np.array(at), turn) for name, at in part.get("points", {}).items()
        }
        part["points"]["own"] = _frame(shift, turn)
        if "inertia" in part:
            matrix = turn @ np.diag(part["inertia"]) @ turn.T
            part["inertia"] = {"xyz"[i] + "xyz"[j]: float(matrix[i, j]) for i in range(3) for j in range(i, 3)}
            part["center"] = shift.tolist()
        shape = part["shape"]
        if shape["type"] == "rod":
            shape |= {key: (shift + turn @ np.array(shape.get(key, [0, 0, 0]))).tolist() for key in ("from", "to")}
        else:
            at = _frame(shift + turn @ np.array(shape.get("at", [0, 0, 0])), turn)
            shape |= at
    for joint in data["joints"].values():
        joint["between"] = [f"{name}.own" if name in data["parts"] else name for name in joint["between"]]
    return data


def reversed_order(data: dict) -> dict:
    """Parts, contacts and what they name in the reverse order; joints, whose coordinates are compared, as they are."""
    data = copy.deepcopy(data)
    for section in ("parts", "contacts"):
        data[section] = dict(reversed(data[section].items()))
    for contact in data["contacts"].values():
        for key in ("parts", "among", "between"):
            if key in contact:
                contact[key] = contact[key][::-1]
    return data


def welded(data: dict) -> dict:
    """Each part without mass, welded to another part that has its mass."""
    data = copy.deepcopy(data)
    for name in list(data["parts"]):
        part = data["parts"][name]
        carrier = {key: part.pop(key) for key in ("mass", "inertia", "center") if key in part}
        if not carrier:
            carrier["shape"] = copy.deepcopy(part["shape"])
        part["shape"]["mass"] = 0
        data["parts"][f"{name}_mass"] = carrier
        data["joints"][f"{name}_weld"] = {"type": "fixed", "between": [name, f"{name}_mass"]}
    return data


def _frame(at: np.ndarray, turn: np.ndarray) -> dict:
    return {"at": at.tolist(), "rotate": {"quaternion": rot.to_quaternion(turn).tolist()}}
