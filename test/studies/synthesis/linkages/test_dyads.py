"""Burmester's dyads: every one satisfies its poses, and known linkages are among them."""

import numpy as np
import pytest

from mbd_sim import InputError
from mbd_sim.studies.synthesis.linkages import PlanePose
from mbd_sim.studies.synthesis.linkages.dyads import (
    center_point,
    circle_point,
    displacements_of,
    dyads_of_five,
    dyads_of_four,
    passing_line,
    poles,
    residual,
    sliders_of_four,
    straight_point,
)
from test.studies.synthesis.linkages.linkages import four_bar_poses, random_poses, slider_crank_poses


def nearest(dyads, center, point):
    return min((abs(one.center - center) + abs(one.point - point) for one in dyads if one.kind == "RR"), default=np.inf)


def test_three_poses_center_and_circle_points_lead_to_each_other():
    """McCarthy & Soh, ch. 5: the three positions of a circle point are on a circle about the center."""
    random = np.random.default_rng(1)
    for _ in range(20):
        motion = displacements_of(random_poses(random, 3))
        link = circle_point(motion, complex(*random.uniform(-1.0, 1.0, 2)))
        places = motion.of(link.point)
        assert np.abs(places - link.center) == pytest.approx(np.full(3, link.length), rel=1e-9)
        assert center_point(motion, link.point).center == pytest.approx(link.center, rel=1e-7, abs=1e-9)
        for slider in (straight_point(motion, 0.6 + 0.8j), passing_line(motion, 0.6 + 0.8j)):
            assert residual(motion, slider) < 1e-10 * max(1.0, abs(slider.point))


def test_four_poses_of_a_four_bar_its_pins_are_on_the_curves():
    poses, pin, other = four_bar_poses([0.1, 0.9, 2.0, 3.1])
    motion = displacements_of(poses)
    for rays in (24,):
        dyads = dyads_of_four(motion, rays)
        assert len(dyads) > 24 and max(residual(motion, one) for one in dyads) < 1e-9
    for center, point in ((0j, pin), (1.4 + 0j, other)):
        ray = point - np.median([one.real for one in [*poles(motion).values(), 0j]])
        assert np.isfinite(abs(ray))
        assert center_point(displacements_of(poses[:3]), point).center == pytest.approx(center, abs=1e-9)


def test_four_poses_have_a_slider_of_each_kind():
    random = np.random.default_rng(2)
    for _ in range(10):
        motion = displacements_of(random_poses(random, 4))
        kinds = [one.kind for one in sliders_of_four(motion)]
        assert kinds == ["PR", "RP"]


def test_five_poses_of_random_four_bars_lead_back_to_them():
    """A generic set of five poses has no, two or four real dyads; those of a four-bar contain its links."""
    random, counts = np.random.default_rng(3), set()
    for _ in range(60):
        theta = np.sort(random.uniform(0.0, 2.0 * np.pi, 5))
        sizes = {"a": random.uniform(0.2, 0.5), "b": random.uniform(1.0, 1.5), "c": random.uniform(0.9, 1.4)}
        poses, pin, other = four_bar_poses(theta, **sizes, d=1.2, mode=random.choice([-1.0, 1.0]))
        if not np.all(np.isfinite([one.x for one in poses])):
            continue
        motion = displacements_of(poses)
        dyads = dyads_of_five(motion)
        counts.add(len(dyads))
        assert nearest(dyads, 0j, pin) < 1e-7 and nearest(dyads, 1.2 + 0j, other) < 1e-7
        assert max(residual(motion, one) for one in dyads) < 1e-9
    assert counts == {2, 4}
    assert {len(dyads_of_five(displacements_of(random_poses(random, 5)))) for _ in range(40)} == {0, 2, 4}


@pytest.mark.parametrize("inverse", [False, True])
def test_five_poses_of_a_slider_crank_contain_its_guide_at_infinity(inverse):
    poses, pin, _ = slider_crank_poses([0.1, 0.9, 2.0, 3.1, 4.5])
    motion = displacements_of(poses)
    dyads = dyads_of_five(motion.inverse if inverse else motion)
    (slider,) = [one for one in dyads if one.kind != "RR"]
    assert slider.kind == ("RP" if inverse else "PR")
    if not inverse:
        assert abs(slider.direction.imag) < 1e-9 and slider.point.imag == pytest.approx(0.1, abs=1e-9)
        assert nearest(dyads, 0j, pin) < 1e-7


def test_poles_do_not_move():
    motion = displacements_of(four_bar_poses([0.1, 0.9, 2.0])[0])
    for (one, other), pole in poles(motion).items():
        first = (pole - motion.shifts[one - 1]) / motion.turns[one - 1]
        assert motion.of(first)[[one - 1, other - 1]] == pytest.approx([pole, pole], abs=1e-12)


def test_poses_that_give_no_motion_are_refused():
    pose = PlanePose(0.0, 0.0, 0.0)
    with pytest.raises(InputError, match="poses 1 and 2 are the same"):
        displacements_of([pose, pose])
    with pytest.raises(InputError, match="1 poses give no motion"):
        displacements_of([pose])
