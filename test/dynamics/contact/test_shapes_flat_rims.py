"""Discs and cylinders that lie flat: the points of their rims that carry them, and their motion against closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.dynamics.contact.shapes import EXACT_TILT, FLAT_TILT, POINTS, protrusion, withdrawn
from mbd_sim.simulation.contact.records import ContactChange

G, RADIUS, MU = 9.81, 0.1, 0.3
DISC, CYLINDER = "disc, radius: 0.1", "cylinder, radius: 0.1, length: 0.2"


def body(shape, position=(0.0, 0.0, 0.0), tilt=0.0, speeds=(0.0,) * 6, **options):
    """A body about to move on ground, tilted about the x axis; equal ones share what they build."""
    sim = Simulation.from_text(
        f"""
mechanism: flat
parts: {{body: {{shape: {{type: {shape}, mass: 2, axis: [0, 0, 1]}}}}}}
joints: {{flight: {{type: free, between: [ground, body], position: [0, 0, 1]}}}}
contacts: {{floor: {{parts: [body], plane: ground, friction: {MU}}}}}
""",
        **options,
    )
    sim.reset([*position, np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0], speeds)
    return sim


def stops(sim):
    """The times at which contacts begin to stick, once each."""
    return sorted({event.time for event in sim.contact_events if event.change is ContactChange.STICKS})


def depths(tilts):
    """The depths below the center, in radii: of the lowest point, and of points 0 and 30 degrees beside it."""
    s = ca.SX.sym("s")
    function = ca.Function("depths", [s], [withdrawn(1.0, s * s), protrusion(1.0, s * s)])
    low, bulge = (np.array([float(function(tilt)[index]) for tilt in tilts]) for index in (0, 1))
    lowest = np.where(tilts < EXACT_TILT, low, tilts)
    return lowest, tilts + bulge, tilts * np.cos(np.pi / POINTS) + bulge


def test_below_a_small_tilt_the_points_of_a_rim_carry_it_and_above_that_its_lowest_point():
    flat = np.linspace(0.0, 1.001 * EXACT_TILT, 1001)
    lowest, _, beside = depths(flat)
    assert np.all(lowest < beside)
    lowest, nearest, _ = depths(np.linspace(1.0001 * FLAT_TILT, 1.0, 1001))
    assert np.all(lowest > nearest)
    assert np.max(depths(np.linspace(0.0, FLAT_TILT, 1001))[1] - np.linspace(0.0, FLAT_TILT, 1001)) < 2e-3
    assert depths(np.zeros(1))[1] == 0.0


def test_the_lowest_point_leaves_the_rim_smoothly():
    s = ca.SX.sym("s")
    value = withdrawn(1.0, s * s)
    slope = ca.jacobian(value, s)
    derivatives = ca.Function("derivatives", [s], [value, slope, ca.jacobian(slope, s)])(EXACT_TILT)
    assert [float(each) for each in derivatives] == pytest.approx([EXACT_TILT, 1.0, 0.0], abs=1e-12)


def test_a_disc_that_lies_flat_stays_where_it_is():
    sim = body(DISC, position=(0.3, 0.0, 0.0), step=1.25e-4)
    sim.run(until=0.1)
    assert sim.q == pytest.approx([0.3, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], abs=2e-18)
    states = sim.contacts()
    assert states.pop("floor.body_on_ground").state == "open"
    assert len(states) == POINTS and {state.state for state in states.values()} == {"sticks"}
    assert sum(state.normal for state in states.values()) == pytest.approx(2 * G, rel=1e-14)
    assert not sim.contact_events


def test_a_disc_that_spins_flat_stops_as_its_rim_rubs():
    """All of the weight rubs at the radius r: (m r² / 2) ω' = -μ m g r."""
    sim = body(DISC, speeds=(0.0, 0.0, 0.0, 0.0, 0.0, 10.0), step=1.25e-4)
    sim.run(until=0.1)
    assert sim.u[5] == pytest.approx(10.0 - 2.0 * MU * G / RADIUS * 0.1, abs=1e-12)
    sim.run(until=0.3)
    assert stops(sim) == pytest.approx([10.0 * RADIUS / (2.0 * MU * G)], abs=1e-10)
    assert np.max(np.abs(sim.u)) < 1e-14 and abs(sim.energies.residual) < 1e-13


def test_a_standing_cylinder_slides_to_rest():
    sim = body(CYLINDER, position=(0.0, 0.0, 0.1), speeds=(1.0, 0.3, 0.0, 0.0, 0.0, 0.0))
    sim.run(until=0.5)
    speed = np.hypot(1.0, 0.3)
    assert np.hypot(*sim.q[:2]) == pytest.approx(speed**2 / (2.0 * MU * G), abs=1e-12)
    assert stops(sim) == pytest.approx([speed / (MU * G)], abs=1e-10)
    assert np.max(np.abs(sim.u)) < 1e-14 and abs(sim.energies.residual) < 1e-13


@pytest.mark.parametrize("turned", [0.0, np.pi])
def test_a_cylinder_stands_on_either_end(turned):
    sim = body(CYLINDER, position=(0.0, 0.0, 0.1), tilt=turned)
    sim.run(until=0.1)
    assert sim.q[2] == pytest.approx(0.1, abs=1e-15) and np.max(np.abs(sim.u)) < 1e-14
    assert [state.gap for state in sim.contacts().values()][1 : 1 + POINTS] == pytest.approx([0.0] * POINTS, abs=1e-15)


def test_a_disc_falls_flat_and_stays():
    sim = body(DISC, position=(0.0, 0.0, 0.04), tilt=0.3, speeds=(0.0, 0.0, 0.0, 0.3, 0.5, 1.0), step=1.25e-4)
    sim.run(until=0.6)
    assert sim.q[[2, 4, 5]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-14) and np.max(np.abs(sim.u)) < 1e-14
    assert sim.energies.dissipated == pytest.approx(sim.start_energy, rel=1e-11)
    assert abs(sim.energies.residual) < 1e-11


def test_a_disc_in_a_plane_mechanism_topples_onto_two_points():
    sim = Simulation.from_text(
        """
mechanism: topple
parts: {body: {shape: {type: disc, mass: 2, radius: 0.1, axis: [1, 0, 0]}}}
joints:
  flight: {type: planar, axis: [0, 1, 0], x_axis: [1, 0, 0], between: [ground, body], position: [0, -0.1, 0.1]}
contacts: {floor: {parts: [body], plane: ground, friction: 0.8}}
"""
    )
    sim.run(until=1.0)
    states = sim.contacts()
    assert list(states) == ["floor.body_on_ground", "floor.body_on_ground_edge_1", "floor.body_on_ground_edge_2"]
    assert [state.normal for state in states.values()] == pytest.approx([0.0, G, G], abs=1e-9)
    assert abs(sim.q[1]) < 1e-14 and abs(abs(sim.q[2]) - np.pi / 2) < 1e-14 and np.max(np.abs(sim.u)) < 1e-14


def test_a_wheel_in_a_plane_mechanism_has_one_contact_point():
    sim = Simulation.from_text(
        """
mechanism: wheel
parts: {body: {shape: {type: disc, mass: 2, radius: 0.1, axis: [0, 1, 0]}}}
joints: {flight: {type: planar, axis: [0, 1, 0], x_axis: [1, 0, 0], between: [ground, body], position: [0, -0.1, 0]}}
contacts: {floor: {parts: [body], plane: ground}}
"""
    )
    assert list(sim.contacts()) == ["floor"]
