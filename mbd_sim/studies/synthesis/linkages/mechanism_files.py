"""Linkages as mechanism files that run, and their check by moving them through the poses.

The plane of a linkage is the x-z plane, with angles from +x toward +z, as in the shipped four-bar. The driver moves
from the first pose to the last one and back, or turns steadily where it can.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.text.yaml_text import yaml_text
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.kinematic_analysis.motion import PointFunctions
from mbd_sim.studies.kinematic_analysis.system import KinematicSystem
from mbd_sim.studies.synthesis.linkages.dead_centers import DeadCenterSlider
from mbd_sim.studies.synthesis.linkages.dyads import Dyad, PlanePose
from mbd_sim.studies.synthesis.linkages.four_bars import DrivenLinkage, PoseLinkage
from mbd_sim.studies.synthesis.synthesis import configurations_along

AXIS = [0, -1, 0]  # of revolute joints: positive angles turn x toward z
DRIVER = "driver"  # the driven joint
PERIOD = 4.0  # s, of a full turn, or to the last pose and back
BODY = "body"


def at(point: complex) -> list[float]:
    """A point of the plane as a vector of a file."""
    return [float(point.real), 0.0, float(point.imag)]


def link(length: float) -> dict[str, Any]:
    """A bar of 1 kg along x with a point `tip` at its end."""
    return {"mass": 1.0, "shape": {"type": "rod", "to": at(complex(length))}, "points": {"tip": at(complex(length))}}


def revolute(first: str, second: str, angle: float | None = None) -> dict[str, Any]:
    """A revolute joint; without an angle it closes a loop."""
    joint: dict[str, Any] = {"type": "revolute", "between": [first, second], "axis": AXIS}
    return joint | ({"cut": True} if angle is None else {"position": angle, "guess": True})


def pose_linkage_text(name: str, poses: Sequence[PlanePose], linkage: PoseLinkage) -> str:
    """The mechanism file of a linkage for poses."""
    return yaml_text(pose_linkage_data(name, poses, linkage), _heading(poses, linkage))


def _heading(poses: Sequence[PlanePose], linkage: PoseLinkage) -> list[str]:
    angle, trouble = np.degrees(linkage.transmission), f" Defect: {linkage.defects}." if linkage.defects else ""
    return [
        f"A {linkage.kind} for {len(poses)} poses of its body, least transmission angle {angle:.4g} deg.{trouble}",
        "Watch: the frame of the body passes through the marks.",
    ]


def pose_linkage_data(name: str, poses: Sequence[PlanePose], linkage: PoseLinkage) -> dict[str, Any]:
    """The same as data: parts `body`, `driver_link` or `driver_block`, `follower_…`, and `marks` of the poses."""
    first, driver, follower = poses[0], linkage.driver, linkage.follower

    def in_body(point: complex) -> complex:
        return (point - first.origin) / first.turn

    size = linkage.size
    pins = {
        "driver_pin": in_body(driver.point),
        "follower_pin": in_body(follower.point),
        "heading": complex(0.3 * size),
    }
    ends = [pins["driver_pin"], pins["follower_pin"], 0j]
    shapes = [{"type": "rod", "from": at(one), "to": at(other)} for one, other in _edges(ends)]
    parts: dict[str, Any] = {
        BODY: {"mass": 1.0, "shapes": shapes, "points": {key: at(value) for key, value in pins.items()}},
        "marks": _marks(poses, size),
    }
    joints: dict[str, Any] = {"marks": {"type": "fixed", "between": ["ground", "marks"]}}
    start = float(linkage.drives[0])
    if driver.kind == "RR":
        parts["driver_link"] = link(driver.length)
        joints[DRIVER] = {"type": "revolute", "between": ["ground.driver", "driver_link"], "axis": AXIS}
        joints[DRIVER]["drive"] = _drive(linkage)
        joints["driver_pin"] = revolute("driver_link.tip", "body.driver_pin", first.angle - start)
    else:
        parts["driver_block"] = _block(size, driver.direction)
        joints[DRIVER] = _guide("ground.driver", "driver_block", driver.direction) | {"drive": _drive(linkage)}
        joints["driver_pin"] = revolute("driver_block", "body.driver_pin", first.angle)
    pivots = {"driver": at(driver.center), "follower": at(follower.center)}
    _add_follower(parts, joints, follower, first, size)
    return {"mechanism": name, "ground": {"points": pivots}, "parts": parts, "joints": joints}


def _add_follower(parts: dict[str, Any], joints: dict[str, Any], follower: Dyad, first: PlanePose, size: float) -> None:
    match follower.kind:
        case "RR":
            parts["follower_link"] = link(follower.length)
            angle = float(np.angle(follower.point - follower.center))
            joints["follower"] = revolute("ground.follower", "follower_link", angle)
            joints["follower_pin"] = revolute("follower_link.tip", "body.follower_pin")
        case "PR":
            parts["follower_block"] = _block(size, follower.direction)
            joints["follower"] = _guide("ground.follower", "follower_block", follower.direction) | {
                "position": 0.0,
                "guess": True,
            }
            joints["follower_pin"] = revolute("follower_block", "body.follower_pin")
        case _:
            along = follower.direction / first.turn
            parts["follower_block"] = _block(size, along)
            joints["follower"] = revolute("ground.follower", "follower_block", first.angle)
            joints["follower_slide"] = _guide("body.follower_pin", "follower_block", along) | {"cut": True}


def _edges(ends: Sequence[complex]) -> list[tuple[complex, complex]]:
    """The sides of a triangle that have a length."""
    pairs = [(ends[0], ends[1]), (ends[1], ends[2]), (ends[2], ends[0])]
    return [pair for pair in pairs if abs(pair[0] - pair[1]) > 0.0]


def _block(size: float, direction: complex) -> dict[str, Any]:
    turned = {"axis": AXIS, "angle": float(np.angle(direction))}
    shape = {"type": "block", "size": [float(share * size) for share in (0.12, 0.06, 0.06)], "rotate": turned}
    return {"mass": 1.0, "shape": shape}


def _guide(first: str, second: str, direction: complex) -> dict[str, Any]:
    return {"type": "prismatic", "between": [first, second], "axis": at(direction)}


def _marks(poses: Sequence[PlanePose], size: float) -> dict[str, Any]:
    """A part without mass that shows the origin and the x axis of the body in each pose."""
    points, shapes = dict[str, Any](), list[dict[str, Any]]()
    for number, pose in enumerate(poses, 1):
        tip = pose.origin + 0.3 * size * pose.turn
        points |= {f"pose_{number}": at(pose.origin), f"heading_{number}": at(tip)}
        shapes.append({"type": "rod", "from": at(pose.origin), "to": at(tip), "mass": 0})
    return {"shapes": shapes, "points": points}


def _drive(linkage: PoseLinkage) -> str:
    first, last = float(linkage.drives[0]), float(linkage.drives[-1])
    rotates = (
        linkage.driver.kind == "RR" and DrivenLinkage(linkage.motion, linkage.driver, linkage.follower).turns_fully
    )
    if rotates and not linkage.defects:
        return f"{first!r} {'+' if last > first else '-'} 2*pi*t/{PERIOD!r}"
    return f"{first!r} + {0.5 * (last - first)!r}*(1 - cos(2*pi*t/{PERIOD!r}))"


def pose_deviations(mechanism: Mechanism, poses: Sequence[PlanePose], drives: Array) -> Array:
    """The deviations (n, 2) in m and rad of the body of a pose linkage from its poses, in the motion of its driver.

    :raises MbdSimError: the driver cannot move through all poses.
    """
    system = KinematicSystem(mechanism, [DRIVER])
    frame = PointFunctions(system, BODY)
    found = []
    for pose, q in zip(poses, configurations_along(system, system.start, drives), strict=True):
        place = frame.pose(q)
        origin = complex(place.position[0], place.position[2])
        turn = complex(place.rotation[0, 0], place.rotation[2, 0])
        found.append((abs(origin - pose.origin), abs(np.angle(turn / pose.turn))))
    return np.array(found)


def verified(mechanism: Mechanism, poses: Sequence[PlanePose], linkage: PoseLinkage) -> tuple[str, float]:
    """What moving a pose linkage shows: "" if it passes through all poses, else why not; and its largest deviation."""
    try:
        deviations = pose_deviations(mechanism, poses, linkage.drives)
    except MbdSimError as error:
        return str(error), np.inf
    largest = float(np.max(deviations / [max(linkage.size, 1e-300), 1.0]))
    return ("" if largest < 1e-6 else "it moves through another branch"), largest


def four_bar_text(name: str, lengths: tuple[float, float, float, float], drives: Array, mode: float, about: str) -> str:
    """The mechanism file of a four-bar (crank, coupler, rocker, base) in m.

    :param drives: angles of the crank in rad, the first of which is the start; it moves from there to the last one and
        back, or turns steadily if there is only one.
    :param mode: the sign of the side of the coupler on which the rocker's pin is, 1 or -1.
    """
    a, b, c, base = lengths
    across = base - a * np.exp(1j * drives[0])
    angle = mode * np.arccos((b * b + abs(across) ** 2 - c * c) / (2.0 * b * abs(across)))
    coupler = float(np.angle(across) + angle)
    rocker = float(np.angle(b * np.exp(1j * coupler) - across))
    joints: dict[str, Any] = {
        DRIVER: {"type": "revolute", "between": ["ground", "crank"], "axis": AXIS, "drive": _crank_drive(drives)},
        "crank_pin": revolute("crank.tip", "coupler", coupler - float(drives[0])),
        "rocker": revolute("ground.right", "rocker", rocker),
        "rocker_pin": revolute("coupler.tip", "rocker.tip"),
    }
    parts = {"crank": link(a), "coupler": link(b), "rocker": link(c)}
    data = {"mechanism": name, "ground": {"points": {"right": at(complex(base))}}, "parts": parts, "joints": joints}
    return yaml_text(data, [about, "Watch: the crank drives the rocker."])


def slider_crank_text(name: str, linkage: DeadCenterSlider, about: str) -> str:
    """The mechanism file of a slider-crank; its guide is parallel to x, below the crank's pivot by the offset."""
    a, b, offset = linkage.crank, linkage.coupler, linkage.offset
    coupler = float(np.arcsin(-offset / b))
    reach = a + float(np.sqrt(b * b - offset * offset))
    joints: dict[str, Any] = {
        DRIVER: {"type": "revolute", "between": ["ground", "crank"], "axis": AXIS, "drive": _crank_drive(np.zeros(1))},
        "crank_pin": revolute("crank.tip", "coupler", coupler),
        "slider": _guide("ground.guide", "slider", 1.0 + 0j) | {"position": reach, "guess": True},
        "slider_pin": revolute("coupler.tip", "slider"),
    }
    parts = {"crank": link(a), "coupler": link(b), "slider": _block(b, 1.0 + 0j)}
    ground = {"points": {"guide": at(complex(0.0, -offset))}}
    data = {"mechanism": name, "ground": ground, "parts": parts, "joints": joints}
    return yaml_text(data, [about, "Watch: one stroke takes longer than the other."])


def _crank_drive(drives: Array) -> str:
    first = float(drives[0])
    if len(drives) == 1:
        return f"{first!r} + 2*pi*t/{PERIOD!r}"
    return f"{first!r} + {0.5 * float(drives[-1] - first)!r}*(1 - cos(2*pi*t/{PERIOD!r}))"
