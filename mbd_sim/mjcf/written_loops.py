"""Loops and constraints of a mechanism as the equalities of an MJCF."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import assert_never

import numpy as np

from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.constraints import (
    Cable,
    Clutch,
    Constraint,
    Coupling,
    Distance,
    Flat,
    KnifeEdge,
    Rolling,
    Surface,
)
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.records import Attachment, Joint
from mbd_sim.mjcf.mjcf_document import Document, Element, add_element, number, text
from mbd_sim.mjcf.written_bodies import lead_per_radian

ARM = 0.1  # m, from one point of a hinge that closes a loop to the other
UNBOUNDED = 1e10  # the other end of a one-sided range


def add_loops(document: Document) -> None:
    """Write the joints that close loops, and the screws in the tree."""
    for joint in document.mechanism.closures.values():
        poses = (joint.parent_pose, joint.child_pose)
        match joint.type:
            case "fixed":
                _equality(document, "weld", joint.name, _sites(document, joint, poses, joint.name))
            case "spherical":
                _equality(document, "connect", joint.name, _sites(document, joint, poses, joint.name))
            case "revolute":
                for name, arm in ((joint.name, 0.0), (f"{joint.name}.axis", ARM)):
                    shift = Pose(arm * joint.axis, np.eye(3))
                    ends = [pose @ shift for pose in poses]
                    _equality(document, "connect", name, _sites(document, joint, (ends[0], ends[1]), name))
            case _:
                document.leave_out(f"{joint.type} joints that close loops", joint.name)
    for name, written in document.joints.items():
        if written.joint.type == "screw" and written.kind == "slide":
            angle, law = written.joint.name, f"0 {number(lead_per_radian(written.joint))} 0 0 0"
            _equality(document, "joint", f"{angle}.lead", {"joint1": name, "joint2": angle, "polycoef": law})


def _sites(document: Document, joint: Joint, poses: tuple[Pose, Pose], name: str) -> dict[str, str]:
    first = document.site(joint.parent, poses[0], f"{name}.first")
    return {"site1": first, "site2": document.site(joint.child, poses[1], f"{name}.second")}


def _equality(document: Document, tag: str, name: str, attributes: Mapping[str, str]) -> None:
    hard = {"solref": f"{number(2.0 * document.mechanism.step)} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
    add_element(document.section("equality"), tag, {"name": name, **attributes, **hard})


def add_constraints(document: Document) -> None:
    """Write the constraints that MuJoCo can express."""
    for constraint in document.mechanism.constraints:
        if not _add_constraint(document, constraint):
            document.leave_out("constraints", constraint.name)


def _add_constraint(document: Document, constraint: Constraint) -> bool:
    """Whether a constraint could be written."""
    match constraint:
        case Coupling():
            return _add_coupling(document, constraint)
        case Distance(first=first, second=second):
            return _add_line(document, constraint, (first, second))
        case Cable(points=points):
            return _add_line(document, constraint, points)
        case Clutch(capacity=TimeExpression() as capacity) if not capacity.variables and constraint.static == 1.0:
            if (tendon := fixed_tendon(document, constraint.name, constraint.factors)) is None:
                return False
            tendon.set("frictionloss", number(capacity.at(0.0)))
            return True
        case Clutch() | Flat() | Surface() | Rolling() | KnifeEdge():
            return False
        case _:
            assert_never(constraint)


def _add_coupling(document: Document, coupling: Coupling) -> bool:
    factors = dict(coupling.factors)
    if coupling.value.variables or coupling.slip or not factors.keys() <= document.joints.keys():
        return False
    value = coupling.value.at(0.0)
    if coupling.bound is None and coupling.play is None and len(factors) == 2:
        (own, factor), (other, follows) = sorted(factors.items(), key=lambda one: one[0] != coupling.follower)
        law = f"{number(value / factor)} {number(-follows / factor)} 0 0 0"
        _equality(document, "joint", coupling.name, {"joint1": own, "joint2": other, "polycoef": law})
        return True
    tendon = fixed_tendon(document, coupling.name, factors)
    if tendon is None:
        return False
    if coupling.play is not None:
        _set_range(document, tendon, value - coupling.play.half, value + coupling.play.half)
    elif coupling.bound is not None:
        _bound(document, tendon, coupling.bound, value)
    else:
        law = f"{number(value)} 0 0 0 0"
        _equality(document, "tendon", coupling.name, {"tendon1": coupling.name, "polycoef": law})
    return True


def fixed_tendon(document: Document, name: str, factors: Mapping[str, float]) -> Element | None:
    """A tendon that is a sum of coordinates; None if one of them is no joint of the file."""
    if not factors.keys() <= document.joints.keys():
        return None
    tendon = add_element(document.section("tendon"), "fixed", {"name": name})
    for coordinate, factor in factors.items():
        add_element(tendon, "joint", {"joint": coordinate, "coef": number(factor)})
    return tendon


def _add_line(document: Document, constraint: Distance | Cable, points: tuple[Attachment, ...]) -> bool:
    if constraint.length.variables:
        return False
    length, name = constraint.length.at(0.0), constraint.name
    tendon = spatial_tendon(document, name, points)
    if constraint.bound is not None:
        _bound(document, tendon, constraint.bound, length)
        return True
    places = [document.start(point.part, Pose(point.point, np.eye(3))).position for point in points]
    at_zero = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(places))
    law = f"{number(length - at_zero)} 0 0 0 0"
    _equality(document, "tendon", name, {"tendon1": name, "polycoef": law})
    return True


def spatial_tendon(document: Document, name: str, points: tuple[Attachment, ...]) -> Element:
    """A tendon along straight lines from point to point."""
    tendon = add_element(document.section("tendon"), "spatial", {"name": name})
    for index, point in enumerate(points, start=1):
        add_element(tendon, "site", {"site": document.end(point, f"{name}.{index}")})
    return tendon


def _bound(document: Document, tendon: Element, bound: str, value: float) -> None:
    lower, upper = (value, UNBOUNDED) if bound == "at_least" else (-UNBOUNDED, value)
    _set_range(document, tendon, max(lower, 0.0) if tendon.tag == "spatial" else lower, upper)


def _set_range(document: Document, tendon: Element, lower: float, upper: float) -> None:
    tendon.set("limited", "true")
    tendon.set("range", text(np.array([lower, upper])))
    document.leave_out("restitution of constraints", tendon.attrib["name"])
