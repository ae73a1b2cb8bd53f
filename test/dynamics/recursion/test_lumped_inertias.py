"""Regrouped inertias: fewer numbers, the same motion."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.kinematics.links import build_links
from mbd_sim.dynamics.kinematics.parameters import equation_data, varying_parameters, with_symbols
from mbd_sim.dynamics.kinematics.tracing import trace
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.dynamics.recursion import articulated_body
from mbd_sim.dynamics.recursion.articulated_body import FactorizedMassMatrix
from mbd_sim.dynamics.recursion.lumped_inertias import lumped_inertias
from mbd_sim.files.load import parse_mechanism

PART = "{mass: 2, center: [0.1, -0.2, 0.3], inertia: {xx: 0.3, yy: 0.4, zz: 0.5, xy: 0.02, xz: -0.03, yz: 0.04}, points: {at: [0.3, 0.2, 0.1]}}"
# One joint of each type that moves something inboard; the axes of some are no coordinate axes of the file.
KINDS = {
    "hinge": "{type: revolute, between: [ground, hinge], axis: [1, 2, 2]}",
    "slider": "{type: prismatic, between: [hinge, slider], axis: [0, 1, 1]}",
    "screw": "{type: screw, between: [slider, screw], axis: [0, 0, 1], lead: 0.3}",
    "collar": "{type: cylindrical, between: [hinge, collar], axis: [1, 0, 0]}",
    "ball": "{type: spherical, between: [collar, ball]}",
    "puck": "{type: planar, between: [ball, puck], axis: [0, 1, 1]}",
    "plate": "{type: fixed, between: [puck.at, plate]}",
    "back": "{type: revolute, between: [back, plate], axis: [0, -1, 0], position: 0.2}",
}
MECHANISM = "mechanism: kinds\nparts:\n"
MECHANISM += "".join(f"  {name}: {PART}\n" for name in KINDS)
MECHANISM += "joints:\n" + "".join(f"  {name}_joint: {text}\n" for name, text in KINDS.items())


def plain_inertias(links):
    return [constant(link.inertia) for link in links]


def test_the_motion_is_that_of_the_links_as_they_are(monkeypatch):
    """Accelerations and reactions, for every type of joint with something to move."""
    regrouped = derive(parse_mechanism(MECHANISM))
    monkeypatch.setattr(articulated_body, "lumped_inertias", plain_inertias)
    plain = derive(parse_mechanism(MECHANISM.replace("kinds", "plain")))  # another name: tests share what they derive
    assert regrouped.rates.n_instructions() < plain.rates.n_instructions()
    rng, layout = np.random.default_rng(4), plain.layout
    inputs = plain.inputs_without_commands
    for _ in range(4):
        y = plain.start_state + 0.5 * rng.uniform(-1.0, 1.0, len(plain.start_state))
        y = np.array(plain.project(0.0, y)).ravel()  # whose quaternions are of unit length
        inputs[: layout.nv] = rng.uniform(-1.0, 1.0, layout.nv)
        for one, other in ((regrouped.rates, plain.rates), (regrouped.reactions, plain.reactions)):
            found, expected = (np.array(function(0.3, y, inputs)) for function in (one, other))
            assert found == pytest.approx(expected, abs=1e-13 * np.max(np.abs(expected)))


def test_what_does_not_count_is_zero_and_counts_inboard():
    """The entries of a link's inertia after its own share and those of the links outboard of it were moved."""
    links = build_links(parse_mechanism(MECHANISM))
    lumped = zip(links, lumped_inertias(links), strict=True)
    inertia = {link.joint.outboard: np.array(ca.DM(one)) for link, one in lumped}
    masses = {name: one[3, 3] for name, one in inertia.items()}
    # The puck carries the plate and, along the axis of its hinge, the last part. Masses leave hinges and balls.
    expected = {"hinge": 0, "slider": 2, "screw": 2, "collar": 4, "ball": 0, "puck": 6, "plate": 0, "back": 0}
    assert masses == pytest.approx(expected, abs=1e-14)
    assert not np.any(inertia["plate"])
    k = 1  # the axis of the last hinge
    assert inertia["back"][2, 2] == 0.0 != inertia["back"][k, k]
    assert [inertia["back"][2, 4] == 0.0, inertia["back"][0, 5] == 0.0, inertia["back"][1, 3] == 0.0].count(True) == 1
    assert inertia["screw"][0, 0] == 0.0 != inertia["screw"][1, 1]


def test_symbols_stay_where_they_are():
    mechanism, other = (
        parse_mechanism(MECHANISM),
        parse_mechanism(MECHANISM.replace("back: {mass: 2", "back: {mass: 3")),
    )
    parameters = varying_parameters(equation_data(mechanism), [equation_data(other)])
    _, links = with_symbols(mechanism, parameters)
    index = next(number for number, link in enumerate(links) if link.joint.outboard == "back")
    assert ca.is_equal(lumped_inertias(links)[index], constant(links[index].inertia), 9)
    values = [derive(mechanism, parameters=parameters), derive(other)]
    y = values[1].start_state
    inputs = np.concatenate([np.zeros(values[1].layout.nv), parameters.checked_values_in(equation_data(other))])
    found, expected = values[0].rates(0.0, y, inputs), values[1].rates(0.0, y, inputs[: values[1].layout.nv])
    assert np.array(found) == pytest.approx(np.array(expected), abs=1e-12)


def test_the_mass_matrix_of_one_hinge_is_its_moment_about_the_axis():
    mechanism = parse_mechanism(
        f"mechanism: one\nparts: {{a: {PART}}}\njoints:\n  j: " + KINDS["hinge"].replace("ground, hinge", "ground, a")
    )
    traced = trace(mechanism)
    pivots = FactorizedMassMatrix(traced.links, traced.motions, 1).pivots
    axis, part = np.array([1.0, 2.0, 2.0]) / 3.0, mechanism.parts["a"]
    arm = np.cross(axis, part.center)
    assert float(ca.DM(pivots)) == pytest.approx(axis @ part.inertia @ axis + part.mass * arm @ arm, rel=1e-15)


def test_a_weld_still_transmits_the_weight_of_what_it_carries():
    text = f"mechanism: two\nparts: {{a: {PART}, b: {PART}}}\njoints:\n"
    text += (
        "  guide: {type: prismatic, between: [ground, a], axis: [1, 0, 0]}\n  weld: {type: fixed, between: [a, b]}\n"
    )
    derived = derive(parse_mechanism(text))
    weld = np.array(derived.reactions(0.0, derived.start_state, [0.0]))[:, 1]
    weight = 2.0 * 9.81
    assert weld == pytest.approx([0.0, 0.0, weight, -0.2 * weight, -0.1 * weight, 0.0], rel=1e-14, abs=1e-14)
