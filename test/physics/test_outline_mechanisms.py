"""Mechanisms of outlines: gear teeth, a latch, a ratchet, a Geneva drive, a detent."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mbd_sim import Simulation


def test_involute_teeth_keep_the_ratio_of_their_numbers_and_cross_their_play():
    simulation = Simulation.from_file("gear_teeth", method="tsitouras8")
    r1, r2, play = 0.002 * 17, 0.002 * 23, 1e-4
    pitch_arcs = []
    for _ in range(15):
        simulation.step(40)
        if any(contact.state == "closed" for contact in simulation.contacts().values()):
            u1, u2 = simulation.u
            assert abs(u1 * 17 + u2 * 23) <= 1e-12 * max(abs(u1) * 17, 1.0)
            pitch_arcs.append(r1 * simulation.q[0] + r2 * (simulation.q[1] - math.pi - math.pi / 23))
    forward, backward = np.array(pitch_arcs[:2]), np.array(pitch_arcs[-2:])
    np.testing.assert_allclose(forward, 0.5 * play, rtol=1e-8)  # they start in the middle of the play
    np.testing.assert_allclose(backward, -0.5 * play, rtol=1e-8)
    assert simulation.energies.residual == pytest.approx(0.0, abs=1e-12)


def test_the_pin_of_a_latch_rests_on_the_catch_with_the_force_of_the_seal():
    simulation = Simulation.from_file("snap_latch", method="tsitouras8")
    ramp = np.array([-0.047 + 0.056, -0.003 - 0.009])
    ramp /= np.hypot(*ramp)
    normal = np.array([ramp[1], -ramp[0]])  # of the ramp, away from the hook
    start, rail = np.array([-0.056, 0.009]), 0.001
    touch = start[0] + ((0.003 - (rail - start[1]) * normal[1]) / normal[0])  # where the pin touches it
    time = -math.log(1.0 - (touch + 0.1) / (1.2 * 0.4)) * 0.4  # damping 1 N s/m
    simulation.step(300)
    first = next(event for event in simulation.contact_events if event.name.startswith("catch"))
    assert first.change.value == "impact"
    assert first.time == pytest.approx(time, rel=1e-11)
    assert simulation.q == pytest.approx([0.0, -0.043 + 0.003], abs=1e-12)
    assert simulation.u == pytest.approx([0.0, 0.0], abs=1e-12)
    held = simulation.contacts()
    pressing = [contact for name, contact in held.items() if name.startswith("catch") and contact.state != "open"]
    assert len(pressing) == 1
    assert pressing[0].normal == pytest.approx(1500.0 * (0.05 - 0.04), rel=1e-9)
    assert max(event.impulse for event in simulation.contact_events) > 0.0


def test_a_ratchet_stops_at_one_angle_but_for_whole_teeth():
    """The nose rests on the steep side of a tooth and on the back of the next one: two equations for two angles."""
    simulation = Simulation.from_file("ratchet_teeth", method="tsitouras8")
    rests = []
    for _ in range(2):
        simulation.step(2000)
        assert np.max(np.abs(simulation.u)) < 1e-9
        rests.append(simulation.q.copy())
    teeth = (rests[1][0] - rests[0][0]) / (math.pi / 6.0)
    assert teeth == pytest.approx(round(teeth), abs=1e-9) and round(teeth) >= 1
    assert rests[1][1] == pytest.approx(rests[0][1], abs=1e-10)
    angle, lift = rests[1]
    nose = np.array([0.06 - 0.06 * math.cos(lift), 0.056 - 0.06 * math.sin(lift)])
    corners = [
        (radius * math.cos(angle + turn), radius * math.sin(angle + turn))
        for tooth in range(12)
        for radius, turn in ((0.044, tooth * math.pi / 6.0), (0.05, tooth * math.pi / 6.0 + math.radians(1.0)))
    ]
    sides = []
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        along = np.array([bx - ax, by - ay]) / math.hypot(bx - ax, by - ay)
        way = along @ (nose - (ax, ay))
        if 0.0 < way < math.hypot(bx - ax, by - ay):
            sides.append(float(np.array([along[1], -along[0]]) @ (nose - (ax, ay))))
    near = [side for side in sides if abs(side) < 2e-3]
    assert near == pytest.approx([1e-3, 1e-3], abs=1e-12)


def test_a_geneva_drive_follows_its_pin_within_the_play():
    simulation = Simulation.from_file("geneva_slots", method="tsitouras8")
    radius, play = 0.04, 2e-5
    distance = math.sqrt(2.0) * radius
    for steps, alpha in ((450, -0.1 * math.pi), (50, 0.0), (100, 0.2 * math.pi)):
        simulation.step(steps)
        ideal = -math.atan2(math.sin(alpha), math.sqrt(2.0) - math.cos(alpha))
        arm = math.sqrt(distance**2 + radius**2 - 2.0 * distance * radius * math.cos(alpha))
        side = math.copysign(1.0, simulation.q[0] - ideal)
        assert side * (simulation.q[0] - ideal) == pytest.approx(math.asin(play / arm), abs=1e-10)
    simulation.step(400)
    assert simulation.time == pytest.approx(1.0)
    assert simulation.q[0] == pytest.approx(-0.25 * math.pi, abs=2.0 * play / radius * 2.0)
    assert simulation.u[0] == 0.0


def test_a_detent_rests_with_its_roller_in_the_middle_of_a_notch():
    simulation = Simulation.from_file("detent", method="tsitouras8")
    simulation.step(1200)
    notches = simulation.q[0] / (math.pi / 6.0)
    assert notches == pytest.approx(round(notches), abs=1e-9) and round(notches) >= 1
    assert np.max(np.abs(simulation.u)) < 1e-12
    forces = [
        contact.normal for contact in simulation.contacts().values() if contact.state != "open" and contact.normal
    ]
    assert len(forces) == 2
    assert forces[0] == pytest.approx(forces[1], rel=1e-6)
    start = np.array([0.028, 0.0])
    turn = math.pi / 12.0 - 0.08
    flank = 0.03 * np.array([math.cos(turn), math.sin(turn)]) - start
    slope = math.atan2(flank[1], flank[0])  # from the radius; the spring is balanced by both flanks
    press = 400.0 * (simulation.q[1] - (0.03 + 0.002 - 0.01))
    assert sum(forces) * math.sin(slope) == pytest.approx(press, rel=1e-6)


@pytest.fixture(scope="module")
def cam_lock():
    return Simulation.from_file("cam_lock", live=["mu"], method="tsitouras8")


def test_a_cam_lock_holds_any_pull_with_a_force_in_proportion(cam_lock):
    """On the lever, friction F and force N have the moment of its spring and weight: F h - N a + M = 0."""
    simulation = cam_lock
    simulation.reset()
    simulation.set_live({"mu": 0.2})
    arm, height = 0.004, 0.03
    simulation.run(until=0.05)  # the strip slides
    moment = (arm + 0.2 * height) * simulation.contacts()["clamp.lever_on_strip_1"].normal
    place = None
    for time in (0.3, 0.6, 0.9):
        simulation.run(until=time)
        pull = 40.0 * (simulation.time - 0.1)
        assert simulation.contacts()["clamp.lever_on_strip_1"].normal == pytest.approx((moment + pull * height) / arm)
        place = simulation.q[1] if place is None else place
        assert simulation.q[1] == pytest.approx(place, abs=1e-15)
    assert simulation.energies.residual == pytest.approx(0.0, abs=1e-15)


def test_a_cam_lock_slips_below_the_angle_of_friction_at_a_force_in_closed_form(cam_lock):
    """At tan a = μ this force N = M/(a - μ h) is infinite."""
    simulation, friction, forces = cam_lock, 0.1, []
    simulation.reset()
    simulation.set_live({"mu": friction})
    for time in (0.05, 0.25):
        simulation.run(until=time)
        forces.append(simulation.contacts()["clamp.lever_on_strip_1"].normal)
    moment = (0.004 + friction * 0.03) * forces[0]
    assert simulation.u[1] < -0.5
    assert forces[1] == pytest.approx(moment / (0.004 - friction * 0.03), rel=1e-12)
