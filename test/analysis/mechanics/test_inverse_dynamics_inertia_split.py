"""The split of the inertia forces against Lagrange's equations, against drives that stand still, and against its power."""

from __future__ import annotations

import json
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings

from mbd_sim import Simulation
from mbd_sim.analysis.mechanics.inverse_dynamics import inertia_split
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.studies.report.mechanism_report import report
from mbd_sim.studies.report.text import report_text
from test.generators.mechanisms import KINDS, random_state, random_trees

T = 0.7


def states(mechanism, number=20):
    """Times, states and u' at random."""
    rng = np.random.default_rng(110)
    for _ in range(number):
        q, u, _ = random_state(mechanism, rng)
        yield rng.uniform(-3.0, 3.0), q, u, rng.uniform(-5.0, 5.0, len(u))


def near(expected):
    return pytest.approx(np.asarray(expected, dtype=float), rel=1e-13, abs=1e-13)


ARM = """
mechanism: arm
gravity: [0, 0, 0]
parts:
  arm: {mass: 1, inertia: [0.1, 0.1, 0.2]}
  bead: {mass: 0.5}
joints:
  turn: {type: revolute, between: [ground, arm], axis: [0, 0, 1]}
  rail: {type: prismatic, between: [arm, bead], axis: [1, 0, 0], drive: 0.4 + 0.1*sin(3*t)}
"""


def test_a_drive_that_changes_the_inertia_makes_a_coriolis_force_that_works():
    """(I + m x²) θ'' + 2 m x x' θ' with x(t) given: the second term is unsteady, and brakes or drives the arm."""
    mechanism = parse_mechanism(ARM)
    split = inertia_split(derive(mechanism))
    for t, q, u, u_rates in states(mechanism):
        x, v = 0.4 + 0.1 * np.sin(3.0 * t), 0.3 * np.cos(3.0 * t)
        found = split.at(t, q, u, u_rates)
        assert found.relative == near((0.2 + 0.5 * x**2) * u_rates)
        assert found.unsteady == near(2.0 * 0.5 * x * v * u)
        assert [*found.transport, *found.gyroscopic] == near([0.0, 0.0])


def standing_still(mechanism, t):
    """The mechanism with its drives fixed at their positions at time t."""
    joints = {
        name: replace(joint, drive=tuple(TimeExpression(repr(expression.at(t)), {}) for expression in joint.drive))
        for name, joint in mechanism.joints.items()
    }
    return replace(mechanism, joints=joints)


def inertia(lagrange, t, q, u, u_rates):
    """M u' + h (nv,), from the energies by differentiation."""
    mass, inertial, _ = (np.array(value) for value in lagrange.terms(t, q, u, np.zeros(len(u))))
    return mass @ u_rates + inertial.ravel()


def changing_mass(lagrange, t, q, u):
    """(∂M/∂t) u (nv,)."""
    time, at_q, at_u = (ca.SX.sym(name, size) for name, size in (("t", 1), ("q", len(q)), ("u", len(u))))
    mass = lagrange.terms.call([time, at_q, at_u, ca.SX.zeros(len(u))])[0]
    rate = ca.Function("rate", [time, at_q, at_u], [ca.jtimes(mass @ at_u, time, ca.SX(1))])
    return np.array(rate(t, q, u)).ravel()


def check(mechanism, rng):
    """Compare the split with Lagrange's equations, also with drives or speeds at rest.

    Returns the largest entry of G, and of the unsteady terms.
    """
    q, u, _ = random_state(mechanism, rng)
    u_rates, split, lagrange = (
        rng.uniform(-5.0, 5.0, len(u)),
        inertia_split(derive(mechanism)),
        lagrange_equations(mechanism),
    )
    found, total = split.at(T, q, u, u_rates), inertia(lagrange, T, q, u, u_rates)
    assert found.total.shape == u.shape
    close = pytest.approx(0.0, abs=1e-12 * max(1.0, *(np.max(np.abs(term), initial=0.0) for term in found)))
    assert np.max(np.abs(found.total - total), initial=0.0) == close
    with_drives_at_rest = inertia(lagrange_equations(standing_still(mechanism, T)), T, q, u, u_rates)
    assert np.max(np.abs(found.relative - with_drives_at_rest), initial=0.0) == close
    assert np.max(np.abs(found.transport - inertia(lagrange, T, q, 0.0 * u, 0.0 * u)), initial=0.0) == close
    assert np.max(np.abs(found.unsteady - changing_mass(lagrange, T, q, u)), initial=0.0) == close
    gyroscopic = split.gyroscopic_matrix(T, q)
    largest = float(np.max(np.abs(gyroscopic), initial=0.0))
    assert np.all(gyroscopic == -gyroscopic.T)
    assert np.max(np.abs(gyroscopic @ u - found.gyroscopic), initial=0.0) == close
    assert abs(u @ found.gyroscopic) <= 1e-14 * np.abs(u) @ np.abs(gyroscopic) @ np.abs(u) + 1e-15
    energies = [float(value) for value in lagrange.energies(T, q, u)[:3]]
    assert split.kinetic_parts(T, q, u) == pytest.approx(
        energies, rel=1e-12, abs=1e-12 * (1.0 + sum(map(abs, energies)))
    )
    return largest, float(np.max(np.abs(found.unsteady), initial=0.0))


def chain(rng):
    """Four bodies in a row on joints of all kinds, some of them hinges that are driven; the joint to ground may be."""
    kinds = ["revolute", "prismatic", "cylindrical", "universal", "spherical", "free"]
    parts, joints = {}, {}
    for number in range(4):
        moments = rng.uniform(0.5, 1.0, 3)
        parts[f"p{number}"] = {
            "mass": rng.uniform(0.5, 2.0),
            "center": rng.uniform(-0.5, 0.5, 3).tolist(),
            "inertia": (moments.sum() - moments).tolist(),
            "points": {"tip": rng.uniform(-1.0, 1.0, 3).tolist()},
        }
        ends = [f"p{number - 1}.tip" if number else "ground", f"p{number}"]
        first, second = rng.normal(size=(2, 3)).tolist()
        kind, joint = str(rng.choice(kinds)), {"between": ends[:: int(rng.choice([-1, 1]))]}
        if rng.random() < 0.5:
            drive = f"{rng.uniform(1, 3)}*t + {rng.uniform(-1, 1)}*sin({rng.uniform(1, 3)}*t)"
            joint |= {"type": "revolute", "axis": first, "drive": drive}
        elif kind == "universal":
            joint |= {"type": kind, "axes": [first, second]}
        else:
            joint |= {"type": kind} if kind in ("spherical", "free") else {"type": kind, "axis": first}
        joints[f"j{number}"] = joint
    return parse_mechanism(json.dumps({"mechanism": "chain", "parts": parts, "joints": joints}))


def test_random_chains_with_drives():
    rng = np.random.default_rng(112)
    found = np.array([check(chain(rng), rng) for _ in range(2)])
    assert np.all(np.max(found, axis=0) > 0.1)


@settings(max_examples=3)
@given(random_trees(fewest=2))
def test_random_trees(drawn):
    """Some of them with drives, springs with mass, all types of joints, and nothing that moves."""
    check(parse_mechanism(drawn[0]), drawn[1])


@pytest.mark.parametrize("name", KINDS[::5])
def test_shipped_mechanisms(name):
    """Without drives all is relative; only the rotating frame has more than one coordinate to couple."""
    gyroscopic, unsteady = check(load_mechanism(name), np.random.default_rng(111))
    assert unsteady == 0.0
    assert (gyroscopic != 0.0) == (name == "rotating_frame_mass")


@pytest.mark.parametrize("name", ["rotating_frame_mass", "moving_support_pendulum", "spun_tube_particle"])
def test_powers_of_the_parts(name):
    """Of the relative part dT2/dt with time at rest, and of all d(T2 - T0)/dt + ∂T/∂t (Jacobi's integral)."""
    mechanism = load_mechanism(name)
    split = inertia_split(derive(mechanism))
    for t, q, u, u_rates in states(mechanism):
        symbols = ca.SX.sym("t"), ca.SX.sym("q", len(q)), ca.SX.sym("u", len(u))
        t2, t1, t0 = ca.vertsplit(split.kinetic(*symbols))
        along = ca.vertcat(*symbols), ca.DM([1.0, *u, *u_rates])
        frozen = ca.DM([0.0, *u, *u_rates])
        rates = [
            ca.jtimes(t2, along[0], frozen),
            ca.jtimes(t2 - t0, *along) + ca.jtimes(t2 + t1 + t0, symbols[0], ca.SX(1)),
        ]
        expected = ca.Function("rates", list(symbols), rates)(t, q, u)
        found = split.at(t, q, u, u_rates)
        assert [u @ found.relative, u @ found.total] == near([float(value) for value in expected])


def test_the_report_shows_what_the_drives_add():
    found = report(Simulation.from_file("rotating_frame_mass"))
    assert found["inertia_forces"]["gyroscopic_matrix"] == near([[0.0, -6.0], [6.0, 0.0]])
    text = report_text(found)
    assert "relative [-9.1, 0], transport [-0.9, 0], Coriolis [0, 0]" in text
    assert "gyroscopic matrix [[0, -6], [6, 0]]: skew-symmetric, does no work" in text
    found = report(Simulation.from_file("double_rod"))
    assert found["inertia_forces"] is None and "gyroscopic" not in report_text(found)
