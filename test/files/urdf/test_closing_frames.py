"""The pairs of frames with which onshape-to-robot describes loops."""

import numpy as np
import pytest

from mbd_sim import Kinematics
from mbd_sim.files.load import parse_mechanism


def frame(name, link, xyz):
    return (
        f'<link name="{name}"><inertial><mass value="0"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>'
        f'<joint name="{name}_frame" type="fixed"><origin xyz="{xyz}" rpy="1.5707963267948966 0 0"/>'
        f'<parent link="{link}"/><child link="{name}"/></joint>'
    )


def five_bar(hinge):
    """Two cranks and two rods in the plane y = 0, whose rods end at (0, 0, -0.3): 3-4-5 triangles."""
    bar = '<link name="{0}"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial></link>'
    hinged = (
        '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/>'
        '<axis xyz="0 -1 0"/></joint>'
    )
    ends = [("left_rod", "0.4 0 -0.3"), ("right_rod", "-0.4 0 -0.3")]
    frames = [frame(f"closing_foot_{number}", link, xyz) for number, (link, xyz) in enumerate(ends, start=1)]
    if hinge:
        frames += [
            frame(f"closing_foot_{number}_z", link, xyz.replace(" 0 ", " 0.1 "))
            for number, (link, xyz) in enumerate(ends, start=1)
        ]
    links = ("left", "left_rod", "right", "right_rod")
    return (
        '<robot name="five_bar"><link name="world"/>' + "".join(map(bar.format, links))
        + hinged.format("left_hip", "world", "left", "-0.4 0 0.4") + hinged.format("right_hip", "world", "right", "0.4 0 0.4")
        + hinged.format("left_knee", "left", "left_rod", "0 0 -0.4") + hinged.format("right_knee", "right", "right_rod", "0 0 -0.4")
        + "".join(frames) + "</robot>"
    )  # fmt: skip


@pytest.mark.parametrize(("hinge", "kind"), [(True, "revolute"), (False, "spherical")])
def test_a_pair_of_frames_closes_the_loop_by_the_joint_that_it_says(hinge, kind):
    mechanism = parse_mechanism(five_bar(hinge), "five_bar.urdf")
    joint = mechanism.all_joints["closing_foot"]
    assert joint.type == kind
    if hinge:  # the axis, as the hinges at the knees
        turned = Kinematics(mechanism).poses()["closing_foot_1"].rotation @ joint.axis
        assert np.allclose(np.abs(turned), [0, 1, 0], atol=1e-12)
    kinematics = Kinematics(mechanism)
    moved = kinematics.closed(kinematics.start + 0.1 * np.cos(np.arange(len(kinematics.start))))
    poses = kinematics.poses(moved)
    assert np.allclose(poses["closing_foot_1"].position, poses["closing_foot_2"].position, atol=1e-10)
    assert any("frames of exporters that close loops" in note for note in mechanism.source.notes)
