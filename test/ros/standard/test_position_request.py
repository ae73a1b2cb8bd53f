"""Requests to ~/compute_ik: what they ask for, and each reason to refuse them, with the code of the standard."""

import math
import random
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Transform, Vector3
from sensor_msgs.msg import JointState, MultiDOFJointState
from std_msgs.msg import Header

from mbd_sim.base.geometry.rotation import from_quaternion, of_vector
from mbd_sim.files.load import parse_mechanism
from mbd_sim.ros.standard.position_request import TIME, PresentPositions, RefusedError, RequestReader

FILE = """
mechanism: hanging
parts:
  base: {mass: 1, inertia: [1, 1, 1]}
  arm: {mass: 1, inertia: [1, 1, 1], points: {tip: [1, 0, 0]}}
joints:
  float: {type: free, between: [ground, base]}
  hinge: {type: revolute, between: [base, arm], axis: [0, 0, 1]}
"""
PRESENT = PresentPositions(0, 2.5, {}, np.zeros(8))


@pytest.fixture(scope="module")
def model():
    """What a reader needs of a model, without its equations."""
    mechanism = parse_mechanism(FILE)
    names = tuple(name for joint in mechanism.joints.values() for name in joint.motion_names)
    return SimpleNamespace(mechanism=mechanism, coordinate_names=names, driven_names=())


def request(**changes):
    """A `PositionIKRequest`, of which the fields that are read; the definitions need not be installed."""
    constraints = {f"{kind}_constraints": [] for kind in ("joint", "position", "orientation", "visibility")}
    state = SimpleNamespace(joint_state=JointState(), multi_dof_joint_state=MultiDOFJointState())
    fields = {
        "group_name": "", "robot_state": state, "constraints": SimpleNamespace(**constraints), "timeout": Duration(),
        "avoid_collisions": False, "ik_link_name": "arm", "pose_stamped": PoseStamped(), "ik_link_names": [],
        "pose_stamped_vector": [],
    }  # fmt: skip
    for name, value in changes.items():
        if name in ("joint_state", "multi_dof_joint_state"):
            setattr(state, name, value)
        elif name.endswith("constraints"):
            setattr(fields["constraints"], name, value)
        else:
            fields[name] = value
    return SimpleNamespace(**fields)


def read(model, position_only=False, **changes):
    return RequestReader(model, "left/", position_only=position_only).search(request(**changes), PRESENT)


def at(frame="", **pose):
    return PoseStamped(header=Header(frame_id=frame), pose=Pose(**pose))


def test_an_empty_request_for_a_part_begins_at_the_present_state(model):
    search = read(model)
    assert (search.frame, search.relative_to, dict(search.seed), search.limit) == ("arm", None, {}, TIME)
    assert (search.time, search.q is PRESENT.q, search.rotation.tolist()) == (2.5, True, np.eye(3).tolist())


@pytest.mark.parametrize("seed", range(5))
def test_random_requests_are_read_as_they_were_meant(model, seed):
    rng, numbers = random.Random(seed), np.random.default_rng(seed)
    link, frame = rng.choice(["arm", "arm.tip", "left/arm.tip"]), rng.choice(["", "world", "left/ground", "left/base"])
    (x, y, z), turn = numbers.normal(size=3), of_vector(numbers.normal(size=3))
    w, qx, qy, qz = turn * (1.0 + rng.uniform(-1e-4, 1e-4))  # rounded
    pose = at(frame, position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=w))
    given = {"pose_stamped": pose, "ik_link_name": link}
    if rng.random() < 0.5:
        given = {"pose_stamped_vector": [pose], "ik_link_names": [link], "ik_link_name": "unused"}
    base = numbers.uniform(-1.5, 1.5, 6)
    bw, bx, by, bz = of_vector(base[3:])
    place = Transform(
        translation=Vector3(**dict(zip("xyz", base[:3].tolist(), strict=True))),
        rotation=Quaternion(w=float(bw), x=float(bx), y=float(by), z=float(bz)),
    )
    hinge = float(numbers.normal())
    search = read(
        model,
        **given,
        joint_state=JointState(name=["hinge"], position=[hinge]),
        multi_dof_joint_state=MultiDOFJointState(joint_names=["float"], transforms=[place]),
        timeout=Duration(sec=rng.randint(0, 3), nanosec=250_000_000),
    )
    assert search.frame == link.removeprefix("left/")
    assert search.relative_to == ("base" if frame == "left/base" else None)
    assert search.position == pytest.approx([x, y, z]) and search.limit % 1.0 == pytest.approx(0.25)
    assert np.max(np.abs(search.rotation - from_quaternion(turn))) < 1e-12
    expected = {"hinge": hinge, **dict(zip(model.coordinate_names, base.tolist(), strict=False))}
    assert search.seed == pytest.approx(expected)


NAN, UNIT = math.nan, Quaternion(w=1.0)


@pytest.mark.parametrize(
    ("code", "words", "changes"),
    [
        ("INVALID_GROUP_NAME", "Leave group_name empty", {"group_name": "arm"}),
        ("COLLISION_CHECKING_UNAVAILABLE", "false", {"avoid_collisions": True}),
        ("INVALID_GOAL_CONSTRAINTS", "joint constraints", {"joint_constraints": [1]}),
        ("INVALID_GOAL_CONSTRAINTS", "visibility", {"visibility_constraints": [1]}),
        ("INVALID_GOAL_CONSTRAINTS", "one link", {"pose_stamped_vector": [PoseStamped()] * 2}),
        ("INVALID_GOAL_CONSTRAINTS", "needs", {"ik_link_names": ["arm"]}),
        ("INVALID_LINK_NAME", "'arm'", {"ik_link_name": "amr"}),
        ("INVALID_LINK_NAME", "no ik_link_name", {"ik_link_name": ""}),
        ("INVALID_LINK_NAME", "part", {"ik_link_name": "ground"}),
        ("FRAME_TRANSFORM_FAILURE", "'base'", {"pose_stamped": at("bsae")}),
        ("INVALID_GOAL_CONSTRAINTS", "finite", {"pose_stamped": at(position=Point(x=NAN))}),
        ("INVALID_GOAL_CONSTRAINTS", "norm is 0", {"pose_stamped": at(orientation=Quaternion(w=0.0))}),
        ("INVALID_GOAL_CONSTRAINTS", "norm is nan", {"pose_stamped": at(orientation=Quaternion(x=NAN))}),
        ("INVALID_GOAL_CONSTRAINTS", "norm is 2", {"pose_stamped": at(orientation=Quaternion(w=2.0))}),
        ("FAILURE", "negative", {"timeout": Duration(sec=-1)}),
        ("INVALID_ROBOT_STATE", "'hinge'", {"joint_state": JointState(name=["hing"], position=[0.0])}),
        ("INVALID_ROBOT_STATE", "finite", {"joint_state": JointState(name=["hinge"], position=[NAN])}),
        ("INVALID_ROBOT_STATE", "length: 1 and 2", {"joint_state": JointState(name=["hinge"], position=[0.0, 1.0])}),
        ("INVALID_ROBOT_STATE", "twice", {"joint_state": JointState(name=["hinge"] * 2, position=[0.0, 1.0])}),
        ("INVALID_ROBOT_STATE", "Valid: float", {"multi_dof_joint_state": MultiDOFJointState(joint_names=["hinge"], transforms=[Transform()])}),
        ("INVALID_ROBOT_STATE", "1 and 0", {"multi_dof_joint_state": MultiDOFJointState(joint_names=["float"])}),
        ("INVALID_ROBOT_STATE", "norm is 0", {"multi_dof_joint_state": MultiDOFJointState(joint_names=["float"], transforms=[Transform(rotation=Quaternion(w=0.0))])}),
    ],
)  # fmt: skip
def test_a_request_that_cannot_be_searched_for_is_refused_with_code_and_remedy(model, code, words, changes):
    with pytest.raises(RefusedError, match=words) as refused:
        read(model, **changes)
    assert refused.value.code == code


def test_with_positions_only_the_orientation_does_not_matter(model):
    assert read(model, position_only=True, pose_stamped=at(orientation=Quaternion(w=0.0))).rotation is None
    with pytest.raises(RefusedError, match="finite"):
        read(model, position_only=True, pose_stamped=at(position=Point(z=math.inf)))


def test_a_search_is_limited_in_time_whatever_is_asked_for(model):
    assert read(model, timeout=Duration(sec=10**9)).limit == 60.0
