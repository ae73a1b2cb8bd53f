"""Forces that depend on joint coordinates and speeds: three derivations, linearization, and what is differentiated."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from test.dynamics.test_against_oracles import check

FORCES_OF_THE_STATE = """
mechanism: forces_of_the_state
parameters: {k: 40, c: 2, wheel: 0.3}
functions: {saturated(a): 5*tanh(a)}
tables:
  gas: {points: [[0, 0], [1, 12], [2.5, 3], [4, -4]], period: 2*pi}
  map: {x: [-1, 0, 1], y: [-2, 0, 1, 2], values: [[1, 2, 0, -1], [0, 3, 1, 1], [2, -2, 4, 0]]}
ground: {points: {wall: [2, 0.3, 0.2]}}
parts:
  cart: {mass: 2, points: {hook: [0.1, 0, 0.2]}}
  arm: {mass: 1, shape: {type: rod, to: [0, 0, -0.7]}, points: {tip: [0, 0, -0.7]}}
  top: {mass: 0.5, center: [0.1, 0.02, -0.2], inertia: [0.02, 0.03, 0.015]}
  wheel: {mass: 1, inertia: [0.1, 0.2, 0.1]}
  drone: {mass: 1.5, inertia: [0.1, 0.2, 0.15], center: [0.02, 0, 0.1]}
joints:
  rail:
    {type: prismatic, between: [ground, cart], axis: [1, 0, 0],
     spring: {force: k*x + c*x.velocity*abs(x.velocity) + swing}, rest: 0.1}
  swing: {type: revolute, between: [arm, cart], axis: [0, 1, 0], position: 0.9}
  wrist: {type: spherical, between: [arm.tip, top]}
  wheel: {type: revolute, between: [cart, wheel], axis: [0, 1, 0], drive: 0.3*t + 0.2*sin(2*t)}
  fly: {type: free, between: [ground, drone], position: [1, 2, 3]}
forces:
  gas: {type: effort, coordinate: swing, effort: "table(gas, swing)*(1 + 0.1*rail.velocity)"}
  spin: {type: effort, coordinate: wrist.rz, effort: -0.2*wrist.rz.velocity*wrist.rx.velocity}
  lift: {type: effort, coordinate: fly.z, effort: "saturated(2 - fly.z) + 14.7 - where(fly.z.velocity > 0, 0.3*fly.z.velocity**2, 0)"}
  push: {type: force, at: cart.hook, vector: ["table(map, rail, swing.velocity)", wheel.position*t, -rail.velocity], axes: arm}
  drag: {type: force, at: drone, vector: ["-0.3*fly.x.velocity*hypot(fly.x.velocity + 1, 1)", sin(t), wheel.velocity], axes: part}
  twist: {type: couple, on: top, vector: [0, 0.1*wrist.ry.velocity, -0.3*sign(swing)]}
  belt: {type: potential, energy: 10*(rail - 0.3*swing)**2 + 0.1*fly.x**3*wheel.position + 0.2*exp(-swing)*cos(t)}
  slip: {type: effort, coordinate: wheel, effort: -0.4*wheel.velocity - 0.3*swing.velocity}
  cylinder: {type: spring, between: [ground.wall, drone], force: "clip(30*x, -5, 20) + 3*x.velocity*(1 + rail**2)", length: 1}
"""


def test_all_forms_agree_in_three_derivations():
    assert check(parse_mechanism(FORCES_OF_THE_STATE), np.random.default_rng(5), states=6)


def rates_at(equations, y, inputs=None):
    given = equations.inputs_without_commands if inputs is None else inputs
    return np.array(equations.rates.call([0.3, y, given])[0]).ravel()


def test_what_the_energy_gains_is_applied_and_what_it_loses_is_dissipated():
    """T + V changes by the difference of the two powers, neither of which is negative here."""
    mechanism = parse_mechanism(
        FORCES_OF_THE_STATE.replace("sin(t)", "0").replace("cos(t)", "1").replace("*t, -rail", "*swing, -rail")
    )
    equations, rng = derive(mechanism), np.random.default_rng(6)
    for _ in range(5):
        y = equations.start_state.copy()
        nq = equations.layout.nq
        y[nq:-3] += rng.uniform(-2.0, 2.0, len(y) - nq - 3)
        rates = rates_at(equations, y)
        gained, drives, lost = rates[-3:]
        assert gained >= 0.0 and lost >= 0.0 and gained + lost > 0.0
        size, values = 1e-6, []
        for side in (1.0, -1.0):
            values.append(float(sum(np.array(equations.energies(0.3 + side * size, y + side * size * rates)))[0]))
        assert (values[0] - values[1]) / (2.0 * size) == pytest.approx(gained + drives - lost, abs=1e-6)


PAIR = """
mechanism: pair
gravity: [0, 0, 0]
parts: {a: {mass: 1}, b: {mass: 2}}
joints:
  one: {type: prismatic, between: [ground, a], axis: [1, 0, 0], position: 0.4}
  two: {type: prismatic, between: [ground, b], axis: [1, 0, 0], velocity: 0.7}
forces:
  f: {type: effort, coordinate: one, effort: "-3*one + 2*two - 0.5*two.velocity*one.velocity"}
  g: {type: effort, coordinate: two, effort: "where(one > 0, -sqrt(one)*two, log(one + 1)/one)"}
"""


def test_linearization_has_the_derivatives_of_forces_in_all_coordinates():
    a = Simulation.from_text(PAIR).linearize().a
    one, two_velocity = 0.4, 0.7
    exact = [
        [0, 0, 1, 0],
        [0, 0, 0, 1],
        [-3, 2, -0.5 * two_velocity, 0],
        [0, -0.5 * np.sqrt(one), 0, 0],
    ]
    assert a == pytest.approx(np.array(exact), abs=1e-14)


def test_the_branch_that_is_not_taken_has_no_part_in_the_derivatives():
    """At one = 0 the other branch divides by zero, and for one < 0 this one has no root."""
    for position, slope in ((0.0, 0.0), (-0.5, 0.0)):
        text = PAIR.replace("position: 0.4", f"position: {position}").replace(
            "one > 0, -sqrt(one)*two", "one < 0, 0*two"
        )
        text = text.replace("log(one + 1)/one", "sqrt(one + 1)") if position == 0.0 else text
        a = Simulation.from_text(text).linearize().a
        assert np.all(np.isfinite(a)) and a[3, 1] == pytest.approx(slope / 2.0)


def test_the_method_for_stiff_joints_uses_only_the_slopes_of_own_coordinates():
    equations = derive(parse_mechanism(PAIR))
    damping, stiffness = (
        np.array(value) for value in equations.joint_linearization.slopes(0.0, equations.start_state, np.zeros(2))
    )
    assert damping.ravel() == pytest.approx([0.5 * 0.7, 0.0])
    assert stiffness == pytest.approx(np.diag([3.0, 0.5 * np.sqrt(0.4) * 2.0]))


BELT = """
mechanism: belt
gravity: [0, 0, 0]
parameters: {k: 400, r: 0.2, s: 0.1, c: 0.3}
parts: {motor: {mass: 1, inertia: [1, 1, 0.02]}, load: {mass: 1, inertia: [1, 1, 0.05]}}
joints:
  motor: {type: revolute, between: [ground, motor], axis: [0, 0, 1], DRIVE}
  load: {type: revolute, between: [ground, load], axis: [0, 0, 1], velocity: 3}
forces:
  belt: {type: potential, energy: 0.5*k*(r*motor - s*load.position)**2}
  bearing: {type: effort, coordinate: motor, effort: -c*motor.velocity}
"""


def test_a_belt_has_a_potential_and_turns_both_pulleys():
    """With I₁, I₂ the relative motion has ω² = k (r²/I₁ + s²/I₂), and s p₁ + r p₂ is conserved."""
    sim = Simulation.from_text(BELT.replace("DRIVE", "velocity: 0").replace("c: 0.3", "c: 0"))
    for t in (0.3, 1.7):
        sim.run(until=t)
        frequency = np.sqrt(400.0 * (0.2**2 / 0.02 + 0.1**2 / 0.05))
        stretch = -0.1 * 3.0 / frequency * np.sin(frequency * t)
        assert 0.2 * sim.q[0] - 0.1 * sim.q[1] == pytest.approx(stretch, abs=1e-12)
        assert 0.1 * 0.02 * sim.u[0] + 0.2 * 0.05 * sim.u[1] == pytest.approx(0.2 * 0.05 * 3.0, abs=1e-13)
        assert abs(sim.energies.residual) < 1e-12 and sim.energies.work_applied == 0.0 == sim.energies.dissipated


def test_forces_on_a_driven_coordinate_are_taken_up_by_its_drive():
    sim = Simulation.from_text(BELT.replace("DRIVE", "drive: 2*t + 0.1*t**2"))
    sim.run(until=1.3)
    motor, load, speed = 2.0 * 1.3 + 0.1 * 1.3**2, sim.q[0], 2.0 + 0.2 * 1.3
    force = 0.02 * 0.2 + 0.3 * speed + 400.0 * 0.2 * (0.2 * motor - 0.1 * load)
    assert sim.drives()["motor"].force == pytest.approx(force, rel=1e-12)
    assert sim.energies.dissipated == pytest.approx(0.3 * (4 * 1.3 + 0.4 * 1.3**2 + 0.04 * 1.3**3 / 3), rel=1e-12)
    assert abs(sim.energies.residual) < 1e-11
