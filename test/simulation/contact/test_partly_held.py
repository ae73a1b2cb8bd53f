"""Friction at its limit that other contacts hold along one direction only: it cannot slide against its force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from mbd_sim import Simulation

BODY, LEG, BALL = 5.0, 0.3, 0.5  # kg
SPOTS = ((0.4, 0.25), (0.4, -0.25), (-0.4, 0.25), (-0.4, -0.25))  # m


@pytest.fixture(scope="module")
def cart():
    """A cart on four balls that roll along x only, whose legs slide on rough guides, pushed ever harder from rest."""
    parts = {"body": {"shape": {"type": "block", "size": [0.8, 0.5, 0.1], "mass": BODY}, "points": {}}}
    joints = {"body": {"type": "free", "between": ["ground", "body"], "position": [0, 0, 0.3]}}
    contacts = {}
    for k, (x, y) in enumerate(SPOTS):
        parts["body"]["points"][f"p{k}"] = [x, y, -0.2]
        parts[f"leg{k}"] = {"shape": {"type": "sphere", "radius": 0.03, "mass": LEG}}
        parts[f"ball{k}"] = {"shape": {"type": "sphere", "radius": 0.1, "mass": BALL}}
        guide = {"coefficient": "slider"}, {"lower": -0.1, "upper": 0.1}
        joints[f"s{k}"] = {
            "type": "prismatic",
            "between": [f"body.p{k}", f"leg{k}"],
            "axis": [0, 1, 0] if k % 2 else [1, 0, 0],
            "friction": guide[0],
            "limits": guide[1],
        }
        joints[f"a{k}"] = {"type": "revolute", "between": [f"leg{k}", f"ball{k}"], "axis": [0, 1, 0]}
        law = {"friction": "friction", "static_friction": "static"}
        contacts[f"c{k}"] = {"parts": [f"ball{k}"], "plane": "ground", "normal": [0, 0, 1], **law}
    values = {"slider": 0.3, "friction": 0.4, "static": 0.5, "push": 10, "turn": 2}
    data = {
        "mechanism": "cart",
        "integrator": {"step": 0.002},
        "parameters": values,
        "parts": parts,
        "joints": joints,
        "contacts": contacts,
        "forces": {"push": {"type": "force", "at": "body", "vector": ["push*t*cos(turn*t)", "push*t*sin(turn*t)", 0]}},
    }
    return Simulation.from_text(str(data), live=[f"parameters.{name}" for name in values])


@pytest.mark.parametrize(
    ("slider", "friction", "static", "push", "turn", "until"),
    [(0.266, 0.403, 0.403, 8.19, 2.2, 3.0), (0.422, 0.396, 0.475, 13.18, 1.65, 2.45), (0.48, 0.616, 0.616, 10.68, 1.95, 3.0)],
)  # fmt: skip
def test_a_cart_rolls_on_while_its_sideways_friction_can_be_shared(cart, slider, friction, static, push, turn, until):
    """Elastic supports bring one ball to its limit, sideways; it stuck and slid a thousand times within a step.

    The cart then still rolls along x as one body with the balls, since others bear what the ball cannot.
    """
    sim = cart
    sim.reset()
    sim.set_live({"slider": slider, "friction": friction, "static": static, "push": push, "turn": turn})
    sim.run(until=until)
    mass = BODY + len(SPOTS) * (LEG + 1.4 * BALL)  # a ball of inertia 2/5 m r² that rolls counts 7/5 m
    speed = quad(lambda t: push * t * np.cos(turn * t) / mass, 0.0, until, epsabs=1e-13)[0]
    assert not sim.contact_events
    assert sim.u[:6] == pytest.approx([speed, 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-11)
    for k in range(len(SPOTS)):
        contact = sim.contacts()[f"c{k}"]
        assert contact.state == "sticks"
        assert np.hypot(*contact.friction) <= static * contact.normal * (1.0 + 1e-9)
    assert abs(sim.energies.residual) < 1e-12
