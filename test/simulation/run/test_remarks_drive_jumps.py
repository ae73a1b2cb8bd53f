"""Prescribed motions that jump are found, located and said; those that are smooth are not."""

import numpy as np
import pytest

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.simulation.run.remarks import jumps


def found(text):
    return [(jump.quantity, jump.amount, jump.time) for jump in jumps(TimeExpression(text, {}), 1e-3, 5.0)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("where(t < 0.50007, 0, t - 0.50007)", [("speed", 1.0, 0.50007)]),
        ("where(t < 2, 0, 1e-6)", [("position", 1e-6, 2.0)]),
        ("max(0, 2*t - 6)", [("speed", 2.0, 3.0)]),
        ("abs(sin(2*t))", [("speed", 2.0, 0.0), *(("speed", 4.0, n * np.pi / 2) for n in (1, 2, 3))]),
        ("mod(3*t, 6) ", [("position", -6.0, 2.0), ("position", -6.0, 4.0)]),
        ("100*floor(t/3)", [("position", 100.0, 3.0)]),
    ],
)
def test_jumps_are_located(text, expected):
    got = found(text)
    assert [jump[0] for jump in got] == [jump[0] for jump in expected]
    assert [jump[1:] for jump in got] == [pytest.approx(jump[1:], rel=1e-9, abs=1e-11) for jump in expected]


@pytest.mark.parametrize(
    "text",
    [
        "sin(3*t)",
        "where(t < 1, 0, (t - 1)**2)",
        "where(t < 1, 0, where(t < 2, (t - 1)**2*(3 - 2*(t - 1)), 1))",
        "0*abs(t) + tanh(1e4*(t - 1))",
        "clip(0.1*t, -1, 1)",
        "0.3 + 0*max(t, 1)",
    ],
)
def test_smooth_motions_have_none(text):
    assert found(text) == []


CART = """
mechanism: cart
parts: {{cart: {{mass: 2}}, bob: {{mass: 1, inertia: [0.1, 0.1, 0.1]}}}}
joints:
  rail: {{type: prismatic, between: [ground, cart], axis: [1, 0, 0], drive: "{drive}"}}
  slide: {{type: prismatic, between: [cart, bob], axis: [0, 0, 1]}}
"""


def test_a_drive_that_jumps_is_a_remark_and_a_smooth_one_is_none():
    """The kinetic energy of cart and bob changes by 1.5 J without work, which was a residual without a word."""
    simulation = Simulation(parse_mechanism(CART.format(drive="where(t < 0.5, 0, t - 0.5)")))
    simulation.run(until=1.0)
    assert simulation.energies.residual == pytest.approx(1.5)
    (said,) = simulation.remarks
    assert said.startswith("the drive of 'rail' jumps in speed by 1 m/s at t = 0.5 s. The impulse")
    before = Simulation(parse_mechanism(CART.format(drive="where(t < 0.5, 0, t - 0.5)")))
    before.run(until=0.25)
    assert before.remarks == ()
    assert Simulation(parse_mechanism(CART.format(drive="0.1*sin(t)"))).remarks == ()


def test_a_prescribed_length_that_jumps_is_a_remark():
    text = """
mechanism: rope
parts: {bob: {mass: 1, inertia: [1, 1, 1]}}
joints: {free: {type: free, between: [ground, bob], position: [0, 0, -1]}}
constraints: {rope: {type: distance, between: [ground, bob], length: "where(t < 0.4, 1, 1 - 0.5*(t - 0.4))"}}
"""
    (said,) = Simulation(parse_mechanism(text)).remarks
    assert said.startswith("the constraint 'rope' jumps in speed by -0.5 m/s at t = 0.4 s.")
