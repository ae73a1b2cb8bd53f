"""Bodies that leave an edge, tip over a corner, roll on their side and slip out of a grip, beside closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot

G = 9.81


def built(text, **options):
    return Simulation.from_text(text, method="tsitouras8", **options)


DISC = """
mechanism: ball_on_disc
parts:
  table: {shape: {type: disc, radius: 0.3, mass: 1}}
  ball: {shape: {type: sphere, radius: 0.05, mass: 0.4}}
joints:
  table: {type: fixed, between: [ground, table]}
  ball: {type: free, between: [ground, ball], position: [0, 0, 0.05]}
contacts: {c: {between: [ball, table], friction: 9}}
"""


def ball_on_disc(text, y, speed, spin, **options):
    """A ball at (0.1, y) that moves and turns over the table."""
    sim = built(text, **options)
    sim.reset(q=[0.1, y, 0.05, 1, 0, 0, 0], u=[speed, 0, 0, 0, spin, 0])
    return sim


def test_a_ball_that_rolls_fast_over_the_edge_of_a_disc_flies():
    """With v² cos² ψ > g r, where ψ is between its path and the radius, it does not follow the edge."""
    speed = 1.2
    sim = ball_on_disc(DISC, 0.12, speed, speed / 0.05, step=2e-3)
    left = (math.sqrt(0.3**2 - 0.12**2) - 0.1) / speed
    sim.step(150)
    opened = [event.time for event in sim.contact_events if event.change == "opened"]
    assert opened == [pytest.approx(left, abs=1e-10)]
    flown = 0.3 - left
    assert sim.q[:3] == pytest.approx([0.1 + 0.3 * speed, 0.12, 0.05 - 0.5 * G * flown**2], abs=1e-12)
    assert sim.u == pytest.approx([speed, 0, -G * flown, 0, speed / 0.05, 0], abs=1e-11)


@pytest.mark.parametrize(("spin", "share"), [(0.0, 1.0), (1.0, 5.0 / 7.0)])
def test_a_slow_ball_follows_the_edge_of_a_disc(spin, share):
    """Sliding without friction, or rolling: v² = v0² + 2 c g r (1 - cos θ) about the edge, c = 1 or 5/7.

    Without friction it leaves where v² = g r cos θ.
    """
    speed, radius, until = 0.2, 0.05, 0.5
    sim = ball_on_disc(DISC.replace("9}", f"{9 * spin:g}}}"), 0.0, speed, spin * speed / radius, step=2e-3)
    start = (0.3 - 0.1) / speed

    def time(angle):
        rate = lambda a: math.sqrt(speed**2 + 2.0 * share * G * radius * (1.0 - math.cos(a))) / radius  # noqa: E731
        return start + quad(lambda a: 1.0 / rate(a), 0.0, angle, epsabs=1e-14, epsrel=1e-13)[0]

    if not spin:
        leaves = math.acos((2.0 + speed**2 / (G * radius)) / 3.0)
        sim.run(start + until)
        assert [event.time for event in sim.contact_events] == [pytest.approx(time(leaves), abs=1e-11)]
    else:
        sim.run(start + 0.1)
        angle = math.atan2(sim.q[0] - 0.3, sim.q[2])
        assert angle > 0.4
        assert time(angle) == pytest.approx(sim.time, abs=1e-11)
    assert abs(sim.energies.residual) < 1e-13


CONE_TABLE = DISC.replace("type: disc, radius: 0.3", "type: cone, radius: 0.3, length: 0.2, axis: [0, 0, -1]")


def test_a_ball_rolls_over_the_rim_of_a_cone_and_back():
    """On the base at a constant speed, and about the rim at v² = v0² + 10/7 g r (1 - cos θ), from where it returns."""
    sim, radius = (
        built(CONE_TABLE),
        0.05,
    )
    chance = np.random.default_rng(3)
    for speed, around in zip(chance.uniform(0.05, 0.4, 3), chance.uniform(-3.0, 3.0, 3), strict=True):
        outward = np.array([math.cos(around), math.sin(around), 0.0])
        start, across = (0.3 - chance.uniform(0.28, 0.299)) / speed, np.array([-outward[1], outward[0], 0.0])
        sim.reset(
            q=[*((0.3 - start * speed) * outward + [0, 0, radius]), 1, 0, 0, 0],
            u=[*speed * outward, *speed / radius * across],
        )
        rate = lambda a: math.sqrt(speed**2 + 10 / 7 * G * radius * (1 - math.cos(a))) / radius  # noqa: E731, B023
        sim.run(start + 0.3 * radius / speed)
        angle = math.atan2(sim.q[:3] @ outward - 0.3, sim.q[2])
        turned = quad(lambda a: 1.0 / rate(a), 0.0, angle, epsabs=1e-14, epsrel=1e-13)[0]  # noqa: B023
        assert angle > 0.1
        assert start + turned == pytest.approx(sim.time, abs=1e-11)
        assert list(sim.u[3:6]) == pytest.approx(list(rate(angle) * across), abs=1e-9)
        sim.reset(q=sim.q, u=-sim.u)
        sim.run(turned + start)
        assert sim.q[:3] @ outward == pytest.approx(0.3 - start * speed, abs=1e-11)
        assert list(sim.u) == pytest.approx([*-speed * outward, *-speed / radius * across], abs=1e-9)
        assert abs(sim.energies.residual) < 1e-13
        assert sim.contacts()["c"].state == "sticks"


BALL_AND_CYLINDER = """
mechanism: ball_and_cylinder
parts:
  table: {shape: {type: cylinder, radius: 0.3, length: 0.2, mass: 2, axis: [1, 0, 0]}}
  ball: {shape: {type: sphere, radius: 0.05, mass: 0.4}}
joints:
  table: {type: revolute, between: [ground, table], axis: [0.3, 1, 0.2], stiffness: 40, damping: 0.2}
  ball: {type: free, between: [ground, ball], position: [0, 0, UP]}
contacts: {c: {between: [ball, table], friction: FRICTION, restitution: 0.6INSIDE}}
"""


@pytest.mark.parametrize(("inside", "friction"), [(True, 0.0), (False, 0.3)])
def test_balls_pass_edges_of_moving_cylinders_and_tubes_without_loss_of_energy(inside, friction):
    """They slide, roll or bounce on its side, and fall over an end. Without friction the step does not matter."""
    text = BALL_AND_CYLINDER.replace("UP", "0" if inside else "0.4").replace("FRICTION", str(friction))
    text = text.replace("INSIDE", ", inside: true" if inside else "")
    simulations = [built(text, step=step) for step in ((2e-3,) if friction else (2e-3, 1e-3))]
    chance, passed = np.random.default_rng(5), 0
    for _ in range(4):
        lateral, up, height = chance.uniform(-0.02, 0.02), chance.uniform(0.0, 0.01), 0.25 if inside else 0.35
        z = (up - math.sqrt(height**2 - lateral**2)) if inside else up + math.sqrt(height**2 - lateral**2)
        q = [0.0, 0.05, lateral, z, 1.0, 0.0, 0.0, 0.0]
        u = [chance.normal(), chance.uniform(0.3, 0.8), 0.1, 0.0, *(3.0 * chance.normal(size=3))]
        ends = []
        for sim in simulations:
            sim.reset(q=q, u=u)
            sim.run(0.3)
            assert abs(sim.energies.residual) < 1e-12
            ends.append(sim.q)
        assert ends[-1] == pytest.approx(ends[0], abs=1e-11)
        passed += bool(ends[0][1] > 0.105)
    assert passed >= 3


POINT_AND_CYLINDER = """
mechanism: point_and_cylinder
parts:
  table: {shape: {type: cylinder, radius: 0.3, length: 0.2, mass: 2, axis: [1, 0, 0]}}
  point: {shape: {type: particle, mass: 0}, mass: 0.4, inertia: [0.1, 0.1, 0.1]}
joints:
  table: {type: fixed, between: [ground, table]}
  point: {type: free, between: [ground, point], position: [0, 0, 0.3]}
contacts: {c: {between: [point, table]}}
"""


def test_points_slide_past_the_end_of_a_cylinder_and_fall():
    """Without friction they keep their speed along its axis, so that they leave as they reach the end."""
    sim, chance = built(POINT_AND_CYLINDER), np.random.default_rng(21)
    for _ in range(4):
        lateral, speed, start = chance.uniform(-0.03, 0.03), chance.uniform(0.5, 2.0), chance.uniform(-0.09, 0.09)
        up, side = math.sqrt(0.3**2 - lateral**2), chance.uniform(-0.2, 0.2)
        direction = chance.choice([-1.0, 1.0])
        leaves = (0.1 - direction * start) / speed
        sim.reset(
            q=[start, lateral, up, 1, 0, 0, 0],
            u=[direction * speed, side, -side * lateral / up, *np.zeros(3)],
        )
        sim.step(math.floor(leaves / sim.step_size))
        assert sim.contacts()["c"].state != "open"
        assert math.hypot(sim.q[1], sim.q[2]) == pytest.approx(0.3, abs=1e-12)
        sim.step()
        (opened,) = (event.time for event in sim.contact_events if event.change == "opened")
        assert opened == pytest.approx(leaves, abs=1e-12)
        flown, at, speeds = 0.05, sim.q[:3].copy(), sim.u[:3].copy()
        assert speeds[0] == pytest.approx(direction * speed, abs=1e-13)
        sim.step(round(flown / sim.step_size))
        assert sim.q[:3] == pytest.approx(at + flown * speeds - [0, 0, 0.5 * G * flown**2], abs=1e-12)
        assert abs(sim.energies.residual) < 1e-13


CORNER = """
mechanism: rod_on_corner
parts:
  table: {shape: {type: block, size: [0.4, 0.2, 0.1], at: [-0.2, 0, -0.05], mass: 1}}
  rod: {shape: {type: rod, from: [-0.25, 0, 0], to: [0.25, 0, 0], mass: 0.3}}
joints:
  table: {type: fixed, between: [ground, table]}
  rod: {type: planar, between: [ground, rod], axis: [0, 1, 0], x_axis: [1, 0, 0], position: [0.04, 0, 0]}
contacts: {c: {between: [rod, table], friction: 2}}
"""


def test_a_rod_that_lies_too_far_over_a_corner_tips_about_it():
    """Its angle follows from the energy, ω² = 2 g d sin θ / (l²/12 + d²), as long as the corner holds it."""
    sim, arm = built(CORNER), 0.04
    inertia = 0.5**2 / 12.0 + arm**2
    sim.step(250)
    angle = sim.q[2]

    def time(upper):  # with θ = s², where the rate is not zero
        rate = lambda s: math.sqrt(2.0 * G * arm / inertia * math.sin(s * s)) / s  # noqa: E731
        return quad(lambda s: 2.0 / rate(s), 0.0, math.sqrt(upper), epsabs=1e-14)[0]

    assert 0.1 < angle < 0.6
    assert time(angle) == pytest.approx(0.25, abs=1e-10)
    assert sim.q[:2] == pytest.approx([arm * math.cos(angle), arm * math.sin(angle)], abs=1e-10)  # y is down
    assert sim.u[2] == pytest.approx(math.sqrt(2.0 * G * arm * math.sin(angle) / inertia), abs=1e-9)
    assert [state.state for state in sim.contacts().values()].count("sticks") == 1


CONE = """
mechanism: rolling_cone
gravity: [GX, 0, GZ]
parts:
  cone: {shape: {type: cone, radius: 0.1, length: 0.2, mass: 2, at: [0, 0, -0.2]}}
joints:
  cone: {type: free, between: [ground, cone], orientation: {quaternion: TURN}}
contacts: {c: {parts: [cone], plane: ground, friction: 3}}
"""


def test_a_cone_rolls_on_its_side_on_an_incline_as_a_pendulum():
    """It touches along a line from its tip, about which it turns by φ' cot α as that line turns by φ'."""
    radius, height, slope, start = 0.1, 0.2, 0.1, 0.5
    alpha = math.atan2(radius, height)
    toward = np.array([math.cos(alpha) * math.cos(start), math.cos(alpha) * math.sin(start), math.sin(alpha)])
    across = np.array([-math.sin(start), math.cos(start), 0.0])
    turn = rot.to_quaternion(np.column_stack([np.cross(across, -toward), across, -toward]))
    text = CONE.replace("GX", str(G * math.sin(slope))).replace("GZ", str(-G * math.cos(slope)))
    sim = built(text.replace("TURN", str(turn.tolist())))
    along, beside = 0.3 * radius**2, 0.6 * height**2 + 0.15 * radius**2  # moments over the mass, at the tip
    inertia = (along * math.cos(alpha) ** 2 + beside * math.sin(alpha) ** 2) / math.tan(alpha) ** 2
    rate = G * math.sin(slope) * 0.75 * height * math.cos(alpha) / inertia
    swing = solve_ivp(
        lambda _, y: [y[1], -rate * math.sin(y[0])], (0.0, 0.4), [start, 0.0], method="DOP853", rtol=1e-13, atol=1e-14
    )
    sim.step(400)
    axis = -sim.poses()["cone"].rotation[:, 2]
    assert swing.y[0, -1] < 0.4
    assert math.atan2(axis[1], axis[0]) == pytest.approx(swing.y[0, -1], abs=1e-9)
    assert sim.poses()["cone"].position == pytest.approx([0, 0, 0], abs=1e-11)
    assert abs(sim.energies.residual) < 1e-11
