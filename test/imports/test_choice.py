"""What a user picks of the joints that are offered, and what holds the other parts."""

import re

import numpy as np
import pytest

from mbd_sim import InputError, Simulation, parse_mechanism
from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.imports.assembly import Body, CadAssembly, ImportedPart, PlacedBody
from mbd_sim.imports.choice import choose
from mbd_sim.imports.joints import Candidate
from mbd_sim.imports.masses import mass_table
from mbd_sim.imports.written import written
from mbd_sim.mechanism.mass_properties import MassProperties
from test.files.text.test_mesh_files import block


def assembly():
    """Three parts at places of their own, of which the first is the largest."""
    parts = []
    for number, name in enumerate(["frame", "arm.left", "Ω"]):
        size = np.array([3.0, 2.0, 1.0]) / (number + 1)
        volume = MassProperties(1.0, np.zeros(3), np.eye(3))
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) if number else np.eye(3)
        placed = PlacedBody(Body(volume, block(size)), identity_pose(), (name,))
        parts.append(ImportedPart(name, Pose(np.array([float(number), 0.0, 0.0]), turn), (placed,)))
    return CadAssembly("m", tuple(parts))


def candidates():
    x = np.array([1.0, 0.0, 0.0])
    return [
        Candidate(1, "frame_arm.left", ("frame", "arm.left"), "revolute", x, x, "share an axis"),
        Candidate(2, "arm.left_Ω", ("arm.left", "Ω"), "spherical", 2.0 * x, None, "share a ball"),
        Candidate(3, "frame_Ω", ("frame", "Ω"), None, x, None, "share 2 axes"),
    ]


def choice(*picks, every=False, ground=None):
    return choose(assembly(), candidates(), every, picks, ground)


def test_picks_by_number_and_name_replace_what_is_offered():
    assert choice(every=True).types == {1: "revolute", 2: "spherical"}
    assert choice("1=slider", "'arm.left_Ω'=weld").types == {1: "prismatic", 2: "fixed"}
    assert choice("1=none", every=True).types == {2: "spherical"}


def test_parts_without_a_joint_are_held():
    assert choice().held == ("frame", "arm.left", "Ω")
    assert choice("2").held == ("frame", "arm.left")
    assert choice(every=True, ground="Ω").held == ("Ω",)


@pytest.mark.parametrize(
    ("picks", "ground", "said"),
    [
        (["7"], None, "no joint '7' is offered. They are numbered 1 to 3."),
        (["frame_arm=hinge"], None, "no joint 'frame_arm' is offered. Did you mean 'frame_arm.left'?"),
        (["1=hing"], None, "unknown joint 'hing'. Did you mean 'hinge'?"),
        (["2=hinge"], None, "arm.left, Ω share no axis. Choose ball, fixed or none for joint 2."),
        (["3"], None, "no joint has the freedom that the faces of frame, Ω leave. Choose one: --joint 3=hinge."),
        ([], "fram", "--ground fram: no part is called so. Did you mean 'frame'?"),
    ],
)
def test_wrong_picks_are_refused(picks, ground, said):
    with pytest.raises(InputError) as error:
        choice(*picks, ground=ground)
    assert said in str(error.value)


@pytest.mark.parametrize("ground", [None, "none", "Ω"])
@pytest.mark.parametrize("picks", [[], ["1"], ["1", "2"], ["1", "2", "3=weld"]])
def test_what_is_written_loads_and_its_comments_are_joints(tmp_path, picks, ground):
    """All parts start where they are in the assembly, whichever joints are taken and whatever is ground."""
    table, out = mass_table(["1"], [], None), tmp_path / "m.yaml"
    text = written(assembly(), table, candidates(), choice(*picks, ground=ground), out, "-y").text
    mechanism = parse_mechanism(text, str(out))
    assert mechanism.gravity == pytest.approx([0.0, 9.81, 0.0])
    assert len([name for name in mechanism.all_joints if not name.endswith("_mount")]) == len(picks)
    if ground != "Ω" and len(picks) == 2:  # a kernel is compiled
        poses = Simulation(mechanism).poses()
        for part in assembly().parts:
            assert poses[part.name].position == pytest.approx(part.pose.position, abs=1e-12)
            assert poses[part.name].rotation == pytest.approx(part.pose.rotation, abs=1e-12)
    joints = text.partition("joints:\n")[2]
    uncommented = re.sub(r"(?m)^  # (?=\S+:$|  )", "  ", joints)
    every = parse_mechanism(text.partition("joints:\n")[0] + "joints:\n" + uncommented, str(out))
    assert {candidate.name for candidate in candidates()} <= every.all_joints.keys()
