"""Cams that cannot be followed are refused; those that can are followed at any distance, with the energies right."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mbd_sim import Ensemble, Simulation
from mbd_sim.base.errors import CommandError, MechanismError
from mbd_sim.dynamics.contact.cams import profile_fault
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.values.expression import TimeExpression

LOBES = "0.04 + 0.01*cos(5*angle)"
HOLLOW = 0.03**2 / (25 * 0.01 - 0.03)  # m, the radius of curvature between these lobes: r² / (r'' - r)
MECHANISM = """
mechanism: lobes
parameters: {depth: 0.01}
ground: {points: {cam: {rotate: {axis: [1, 0, 0], angle: 90 deg}}}}
parts:
  cam: {shape: {type: cylinder, mass: 0.5, radius: 0.03, length: 0.01}}
  follower: {shape: {type: cylinder, mass: 0.3, radius: RADIUS, length: 0.01, axis: [0, 1, 0]}}
joints:
  cam: {type: revolute, between: [ground.cam, cam], axis: [0, 0, 1], drive: 20*t}
  follower: {type: prismatic, between: [ground, follower], axis: [0, 0, 1], position: 0.0535, stiffness: 300, rest: 0}
contacts:
  lift: {parts: [follower], cam: cam, profile: 0.04 + depth*cos(5*angle), restitution: 0.5, friction: 0.3}
"""


def lobes(radius):
    return parse_mechanism(MECHANISM.replace("RADIUS", str(radius)))


@pytest.fixture(scope="module")
def simulation():
    return Simulation(lobes(0.003), live=["parameters.depth"], method="tsitouras8")


def fault(text, roller):
    return profile_fault(TimeExpression(text, {"pi": math.pi}), roller)


@pytest.mark.parametrize(
    ("text", "roller", "words"),
    [
        (LOBES, 0.005, f"a concave radius of curvature of {HOLLOW:.4g} m at angle = -180.0 deg"),
        ("0.04 + 0.01*cos(2*angle)", 0.1, "a concave radius of curvature of 0.09 m at angle = -90.0 deg"),
        ("0.04*(1.1 + cos(angle))", 0.03, "does not fit"),
        ("0.04 + 0.01*cos(2*angle)", None, "is not convex at angle = -90.0 deg, where its curvature is -11.11/m"),
        ("0.04 + 0.01*tanh(20*cos(angle))", 0.0, "cannot be followed near angle = -88.0 deg"),
        ("0.0275 - 0.0068/(1 + exp((cos(0.4625) - cos(angle))/0.004))", 0.0, "cannot be followed near angle = -2"),
        ("0.1 + 0.01*angle", 0.01, "does not have the period 2*pi"),
        ("0.01*cos(angle)", 0.01, "is -0.01 m at angle = -180.0 deg"),
        ("0.1 + 0.01*sqrt(sin(angle))", None, "has no finite value or derivative at angle = -180.0 deg"),
    ],
)
def test_profiles_that_cannot_be_followed_are_refused(text, roller, words):
    found = fault(text, roller)
    assert found is not None and words in found[0]
    assert found[1].endswith(".")


@pytest.mark.parametrize(
    ("text", "roller"),
    [
        (LOBES, 0.003),
        ("0.04 + 0.01*cos(2*angle)", 0.08),
        ("0.04 + 0.002*cos(2*angle)", None),
    ],
)
def test_profiles_that_can_be_followed_are_not(text, roller):
    assert fault(text, roller) is None


def test_the_error_names_the_cam_its_roller_and_the_line():
    with pytest.raises(MechanismError, match=r":12: contacts\.lift\.profile: 'follower' and 'cam': the profile has a"):
        derive(lobes(0.005))


def test_a_live_value_that_makes_a_cam_too_concave_is_refused(simulation):
    simulation.set_live({"parameters.depth": 0.009})
    with pytest.raises(CommandError, match="concave radius of curvature"):
        simulation.set_live({"parameters.depth": 0.02})
    assert simulation.live["parameters.depth"] == 0.009


def test_a_member_of_an_ensemble_with_a_cam_that_is_too_concave_is_refused():
    with pytest.raises(MechanismError, match=r"member 1.*concave radius of curvature"):
        Ensemble(lobes(0.003), [{"parameters.depth": 0.009}, {"parameters.depth": 0.02}])


def test_a_roller_hops_on_a_lobed_cam_with_the_right_gaps_and_energies(simulation):
    assert simulation.remarks == ()
    simulation.set_live({"parameters.depth": 0.01})
    simulation.reset()
    angles = np.linspace(0.0, 2.0 * np.pi, 20_001)
    radii = 0.04 + 0.01 * np.cos(5.0 * angles)
    for _ in range(50):
        simulation.step(6)
        polar = 0.5 * np.pi - 20.0 * simulation.time
        x, y = simulation.q[0] * np.cos(polar), simulation.q[0] * np.sin(polar)
        nearest = np.min(np.hypot(radii * np.cos(angles) - x, radii * np.sin(angles) - y)) - 0.003
        gap = simulation.contacts()["lift"].gap
        assert gap == pytest.approx(nearest, abs=1e-6 + 0.03 * nearest)
        assert gap > -1e-12
    assert simulation.contact_events and abs(simulation.energies.residual) < 1e-11
