"""None"""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.simulation.model.commands import parse_wrench, wrench_labels

PUSHED = """
mechanism: pushed
gravity: [0, 0, 0]
parts:
  body: {mass: 2, inertia: [1, 2, 3], center: [0.1, 0, 0], points: {tip: [0.5, 0.2, 0]}}
joints:
  flight: {type: free, between: [ground, body]}
"""
# The same by the force elements of a file, which the oracles prove.
FORCE = "forces:\n  push: {type: force, at: AT, vector: [0.3, -0.2, 0.1], axes: AXES}\n"
COUPLE = "forces:\n  push: {type: couple, on: AT, vector: [0.3, -0.2, 0.1], axes: AXES}\n"
VECTOR = (0.3, -0.2, 0.1)


@pytest.mark.parametrize("axes", ["ground", "part"])
@pytest.mark.parametrize("at", ["body.tip", "body"])
def test_a_force_from_outside_is_the_same_as_one_in_the_file(at, axes):
    point = "tip" if "tip" in at else (0.0, 0.0, 0.0)
    inside = Simulation.from_text(PUSHED + FORCE.replace("AT", at).replace("AXES", axes))
    outside = Simulation.from_text(PUSHED, wrenches=["body"])
    outside.set_wrench("body", force=VECTOR, at=point, axes=axes)
    inside.run(2.0)
    outside.run(2.0)
    assert outside.state == pytest.approx(inside.state, abs=1e-11)
    assert abs(outside.energies.residual) < 1e-12


@pytest.mark.parametrize("axes", ["ground", "part"])
def test_a_couple_from_outside_is_the_same_as_one_in_the_file(axes):
    inside = Simulation.from_text(PUSHED + COUPLE.replace("AT", "body").replace("AXES", axes))
    outside = Simulation.from_text(PUSHED, wrenches=["body"])
    outside.set_wrench("body", couple=VECTOR, axes=axes)
    inside.run(2.0)
    outside.run(2.0)
    assert outside.state == pytest.approx(inside.state, abs=1e-11)


def test_a_force_acts_at_the_center_of_mass_by_default():
    sim = Simulation.from_text(PUSHED, wrenches=["body"])
    sim.set_wrench("body", force=VECTOR)
    sim.run(1.0)
    assert np.abs(sim.u[3:]).max() < 1e-14
    assert sim.u[:3] == pytest.approx(np.array(VECTOR) / 2.0, rel=1e-12)
    sim.reset()
    sim.run(1.0)
    assert not sim.u.any(), "a reset takes the wrenches away"


def test_closed_mechanisms_feel_wrenches():
    sim = Simulation.from_file("four_bar", wrenches=["coupler"])
    sim.set_wrench(
        "coupler", force=(5.0, 0.0, 2.0), at="tip" if "tip" in sim.mechanism.parts["coupler"].points else None
    )
    sim.run(1.0)
    assert abs(sim.energies.work_applied) > 0.01
    assert abs(sim.energies.residual) < 1e-10


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"part": "bdy", "force": VECTOR}, "no part 'bdy'"),
        ({"part": "body", "force": (1.0, 2.0)}, "three numbers"),
        ({"part": "body", "force": (1.0, 2.0, float("nan"))}, "not finite"),
        ({"part": "body", "couple": "strong"}, "three numbers"),
        ({"part": "body", "force": VECTOR, "at": "top"}, "no point 'top'"),
        ({"part": "body", "force": VECTOR, "axes": "world"}, "'ground' or 'part'"),
    ],
)
def test_a_wrench_that_does_not_fit_is_rejected_whole(arguments, words):
    sim = Simulation.from_text(PUSHED, wrenches=["body"])
    before = sim.inputs.copy()
    with pytest.raises(CommandError, match=words):
        sim.set_wrench(**arguments)
    assert np.array_equal(sim.inputs, before)


def test_only_loaded_parts_take_wrenches():
    with pytest.raises(CommandError, match="wrenches="):
        Simulation.from_text(PUSHED).set_wrench("body", force=VECTOR)
    with pytest.raises(CommandError, match="no part 'boddy'"):
        Simulation.from_text(PUSHED, wrenches=["boddy"])


@pytest.mark.parametrize("part", ["upper", "arm.left"])
@pytest.mark.parametrize("axes", ["ground", "part"])
def test_a_wrench_is_read_back_from_labels_and_numbers(part, axes):
    vectors = np.arange(1.0, 7.0), np.zeros(6)
    numbers = np.concatenate([*(vectors if axes == "ground" else vectors[::-1]), [7.0, 8.0, 9.0]])
    labels = wrench_labels(part)
    assert len(labels) == len(numbers) == 15
    wrench = parse_wrench(labels, numbers)
    assert (wrench.part, wrench.axes) == (part, axes)
    assert (*wrench.force, *wrench.couple, *wrench.point) == tuple(range(1, 10))
