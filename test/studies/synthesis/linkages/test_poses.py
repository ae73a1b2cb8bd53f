"""Linkages for poses: what is said about their motion is what moving them shows."""

import numpy as np
import pytest

from mbd_sim import InputError, parse_mechanism
from mbd_sim.studies.kinematic_analysis.loads import TransmissionAngle, couplers_and_followers
from mbd_sim.studies.kinematic_analysis.system import KinematicSystem
from mbd_sim.studies.synthesis.linkages import (
    Given,
    PlanePose,
    linkages_for_poses,
    pose_linkage_text,
    verified,
)
from mbd_sim.studies.synthesis.linkages.mechanism_files import DRIVER
from mbd_sim.studies.synthesis.linkages.reports import poses_text
from mbd_sim.studies.synthesis.synthesis import configurations_along
from test.studies.synthesis.linkages.linkages import four_bar_poses, random_poses, slider_crank_poses


def followed(motion, linkage):
    """Whether the body reaches all poses in order, by small steps of the driver from the first pose, without formulas.

    The other link's end is followed as the nearest of its two places; a jump is a dead point.
    """
    far = linkage.follower.point - linkage.driver.point
    u = np.concatenate([np.linspace(*pair, 400) for pair in zip(linkage.drives, linkage.drives[1:], strict=False)])
    arm, wanted = linkage.driver.length, motion.of(linkage.follower.point)
    place = linkage.follower.point
    for step, angle in enumerate(u):
        near = linkage.driver.center + arm * np.exp(1j * angle)
        across = linkage.follower.center - near
        reach, b, c = abs(across), abs(far), linkage.follower.length
        cosine = (b * b + reach**2 - c * c) / (2.0 * b * reach)
        if abs(cosine) > 1.0 + 1e-9:
            return False
        turn = np.arccos(np.clip(cosine, -1.0, 1.0)) * np.array([-1.0, 1.0])
        places = near + b * across / reach * np.exp(1j * turn)
        place = places[np.argmin(np.abs(places - place))]
        if (step + 1) % 400 == 0 and abs(place - wanted[(step + 1) // 400]) > 1e-6:
            return False
    return True


def test_defects_agree_with_following_the_motion_step_by_step():
    """Of random poses and given centers, with all kinds of four-bars."""
    random, kinds, seen = np.random.default_rng(4), set(), set()
    for _ in range(25):
        poses = random_poses(random, 3)
        given = Given(centers=[complex(*random.uniform(-2.0, 2.0, 2)) for _ in range(2)])
        try:
            solutions = linkages_for_poses(poses, given)
        except InputError:
            continue
        for linkage in solutions.linkages:
            kinds.add(linkage.kind)
            seen.add(linkage.defects.partition(":")[0])
            if not linkage.defects:
                assert followed(solutions.motion, linkage)
            elif not linkage.defects.startswith("order"):
                assert not followed(solutions.motion, linkage)
    assert kinds >= {"crank-rocker", "double rocker", "triple rocker", "double crank"}
    assert seen >= {"", "circuit", "branch"}


def test_three_poses_of_a_textbook():
    """Norton, Design of Machinery, the example of three-position motion synthesis: W, Z, U, S and the angles."""
    turns = np.radians([0.0, -45.0, 9.3])
    shifts = np.array([0.0, 2.798, 3.919]) * np.exp(1j * np.radians([0.0, -31.19, -16.34]))
    poses = [PlanePose(shift.real, shift.imag, turn) for shift, turn in zip(shifts, turns, strict=True)]
    published = [(0.055 + 6.832j, 1.179 + 0.940j, (342.3, 324.8)), (-2.628 - 1.825j, -0.109 + 1.487j, (30.9, 80.6))]
    found = linkages_for_poses(poses, Given(points=[-body for _, body, _ in published]))
    dyads = {dyad.point: dyad for linkage in found.linkages for dyad in (linkage.driver, linkage.follower)}
    for link, body, angles in published:
        dyad = dyads[-body]
        arms = found.motion.of(dyad.point) - dyad.center
        assert dyad.center == pytest.approx(-body - link, abs=3e-3)  # the published numbers have three decimals
        assert np.degrees(np.angle(arms[1:] / arms[0])) % 360.0 == pytest.approx(angles, abs=0.03)


@pytest.mark.parametrize("kind", ["four_bar", "slider"])
def test_five_poses_the_linkage_that_made_them_is_found_and_runs(kind):
    theta = [0.1, 0.9, 2.0, 3.1, 4.5]
    poses, *_ = (four_bar_poses if kind == "four_bar" else slider_crank_poses)(theta)
    solutions = linkages_for_poses(poses)
    assert len(solutions.dyads) == 4 and len(solutions.linkages) == 6
    assert solutions.linkages == tuple(sorted(solutions.linkages, key=lambda one: one.rank))
    wanted = "crank-rocker" if kind == "four_bar" else "crank-slider"
    linkage = next(one for one in solutions.linkages if one.kind == wanted and not one.defects)
    mechanism = parse_mechanism(pose_linkage_text("made", poses, linkage))
    trouble, deviation = verified(mechanism, poses, linkage)
    assert trouble == "" and deviation < 1e-12
    system = KinematicSystem(mechanism, [DRIVER])
    angle = TransmissionAngle(system, couplers_and_followers(mechanism, [DRIVER])[0])
    path = np.linspace(linkage.drives[0], linkage.drives[-1], 91)
    least = min(angle(q) for q in configurations_along(system, system.start, path))
    assert linkage.transmission == pytest.approx(least, abs=2e-4)


def test_a_defect_shows_when_the_linkage_is_moved():
    poses, *_ = four_bar_poses([0.1, 0.9, 2.0, 3.1, 4.5])
    linkage = next(one for one in linkages_for_poses(poses).linkages if one.defects)
    trouble, _ = verified(parse_mechanism(pose_linkage_text("wrong", poses, linkage)), poses, linkage)
    assert trouble


def test_a_swinging_block_passes_through_three_poses():
    poses = [PlanePose(0.0, 0.0, 0.0), PlanePose(1.0, 0.5, 0.5), PlanePose(1.8, 1.6, 1.2)]
    solutions = linkages_for_poses(poses, Given(centers=[0.2 - 1.0j], lines=[0.3]))
    (linkage,) = solutions.linkages
    assert linkage.follower.kind == "RP"
    trouble, deviation = verified(parse_mechanism(pose_linkage_text("block", poses, linkage)), poses, linkage)
    assert (trouble == "") == (linkage.defects == "") and (linkage.defects or deviation < 1e-12)


def test_four_poses_have_many_linkages_the_best_first():
    poses = [PlanePose(0, 0, 0), PlanePose(1, 0.5, 0.5), PlanePose(1.8, 1.6, 1.2), PlanePose(1.6, 2.6, 1.9)]
    solutions = linkages_for_poses(poses)
    best = solutions.linkages[0]
    assert len(solutions.linkages) > 100 and not best.defects and best.transmission > np.radians(20)
    assert "the best 3" in poses_text(solutions, 3)


def test_what_does_not_fit_is_refused():
    poses = random_poses(np.random.default_rng(0), 4)
    with pytest.raises(InputError, match="with 4 poses, nothing can be chosen"):
        linkages_for_poses(poses, Given(centers=[1j]))
    with pytest.raises(InputError, match="2 poses cannot be synthesized"):
        linkages_for_poses(poses[:2])
