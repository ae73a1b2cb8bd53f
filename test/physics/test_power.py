"""The power theorem along motions, and the power of constraints and drives: at every step, by exact differentiation.

test/dynamics/recursion/test_reactions.py checks the theorem at random states.
"""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.lagrange import lagrange_equations
from mbd_sim.files.load import load_mechanism
from test.generators.loops import state_near_start
from test.generators.mechanisms import KINDS, accelerations, random_state
from test.oracles import kane

T = 0.05


@functools.cache
def equations(name):
    return derive(load_mechanism(name))


def powers(derived):
    """(t, y, efforts) to dT/dt, dV/dt along y', and the powers of forces and of drives and the dissipated power, W."""
    t, y = ca.SX.sym("t"), ca.SX.sym("y", len(derived.start_state))
    efforts = ca.SX.sym("e", derived.layout.nv)
    rates, energies = derived.rates.call([t, y, efforts])[0], derived.energies(t, y)
    change = ca.jtimes(energies, y, rates) + ca.jtimes(energies, t, ca.SX(1))
    function = ca.Function("powers", [t, y, efforts], [change, rates[-3:]])
    return lambda *state: [np.array(value).ravel() for value in function(*state)]


@pytest.mark.parametrize("name", KINDS[::4])
def test_the_power_theorem_at_every_step(name):
    """d(T + V)/dt is the power of the forces and of the drives less the dissipated power, with varying efforts."""
    sim, rng = Simulation.from_file(name), np.random.default_rng(120)
    function, size, worst = powers(sim.model.equations), 0.0, 0.0
    inertia = np.diag(sim.model.equations.constraints.mass_matrix(0.0, sim.q))
    for step in range(100):
        if step % 20 == 0:
            sim.set_efforts(inertia * rng.uniform(-3.0, 3.0, len(sim.u)))
        sim.step()
        change, (applied, drives, dissipated) = function(sim.time, sim.state, sim.efforts)
        size = max(size, np.abs(change).sum() + abs(applied) + abs(drives) + abs(dissipated))
        worst = max(worst, abs(change.sum() - applied - drives + dissipated) / size)
    assert size > 1e-3
    assert worst < 2e-13


def state_of(derived, mechanism, rng):
    return state_near_start(mechanism, derived, rng, T) if derived.rows else random_state(mechanism, rng)


def multipliers(derived, q, u, efforts):
    return np.array(derived.multipliers(T, np.concatenate([q, u, np.zeros(3)]), efforts)).ravel()


@pytest.mark.parametrize("name", ["knife_edge", "rack_and_pinion", "bennett", "four_bar", "scissor_lift"])
def test_constraint_forces_do_work_only_where_constraints_depend_on_time(name):
    """u·(M u' + h - Q) is the power of Gᵀλ: -λ·b with G u + b = 0, where b is the rate of the constraints by time.

    M, h and Q come from the energies, and b is the velocity of the constraints at u = 0.
    """
    derived, mechanism, rng = equations(name), load_mechanism(name), np.random.default_rng(121)
    lagrange = lagrange_equations(mechanism)
    for _ in range(5):
        q, u, efforts = state_of(derived, mechanism, rng)
        mass, inertial, forces = (np.array(value) for value in lagrange.terms(T, q, u, efforts))
        rates = accelerations(derived, q, u, efforts, T)
        constraint_forces = mass @ rates + (inertial - forces).ravel()
        drift = np.array(derived.violation(T, np.concatenate([q, 0.0 * u, np.zeros(3)])))[:, 1]
        expected = -multipliers(derived, q, u, efforts) @ drift
        size = np.abs(u) @ (np.abs(mass) @ np.abs(rates) + np.abs(inertial).ravel() + np.abs(forces).ravel())
        assert abs(u @ constraint_forces - expected) < 1e-12 * size
        assert (np.abs(drift).max() > 0.0) == (name in ("stewart", "scissor_lift"))


def coupled(derived, mechanism, q, u, efforts):
    """The forces of gears, racks and couplings on the coordinates, by name."""
    found = dict.fromkeys([*mechanism.coordinate_names, *mechanism.driven_names], 0.0)
    for row, force in zip(derived.rows, multipliers(derived, q, u, efforts), strict=True):
        for name, factor in row.factors.items():
            found[name] += factor * force
    return found


def power_across(joint, moving, wrench):
    """The power of a force and moment (6,) on a joint's second part and of their reaction on its first."""

    def twist(part, point):
        if part == kane.GROUND:
            return np.zeros(3), np.zeros(3)
        frame = moving[part]
        arm = frame.rotation.d[0].T @ (point - frame.origin.d[0])
        return frame.origin.d[1] + frame.rotation.d[1] @ arm, frame.rotation.d[0] @ frame.omega

    base = (np.zeros(3), np.eye(3))
    if joint.child != kane.GROUND:
        base = moving[joint.child].origin.d[0], moving[joint.child].rotation.d[0]
    point = base[0] + base[1] @ joint.child_pose.position
    (first_v, first_w), (second_v, second_w) = twist(joint.parent, point), twist(joint.child, point)
    return wrench[:3] @ (second_v - first_v) + wrench[3:] @ (second_w - first_w)


@pytest.mark.parametrize("name", KINDS[::3])
def test_joint_reactions_do_work_only_along_the_joints_coordinates(name):
    """Their power is that of effort, spring, damper, gear and drive, and zero for a joint that closes a loop."""
    derived, mechanism, rng = equations(name), load_mechanism(name), np.random.default_rng(122)
    function, (where, _, _) = derived.reactions, kane.coordinate_slices(mechanism)
    for _ in range(5):
        q, u, efforts = state_of(derived, mechanism, rng)
        y, moving = np.concatenate([q, u, np.zeros(3)]), kane.motions(mechanism, q, u, t=T)
        along = kane.joint_forces(mechanism, q, u, efforts)[0]
        others = coupled(derived, mechanism, q, u, efforts)
        _, speeds, forces = np.array(derived.drives(T, y, efforts)).reshape(3, -1)
        driven = {name: (v, f) for name, v, f in zip(mechanism.driven_names, speeds, forces, strict=True)}
        wrenches = np.array(function(T, y, efforts)).T
        size = np.max(np.abs(wrenches)) * (1.0 + np.max(np.abs(u), initial=0.0))
        for joint, wrench in zip(mechanism.all_joints.values(), wrenches, strict=True):
            expected = 0.0
            if joint.name not in mechanism.closing:
                names, rows = joint.motion_names, range(where[joint.name][1].start, where[joint.name][1].stop)
                expected = sum((along[row] + others[name]) * u[row] for name, row in zip(names, rows, strict=False))
                expected += sum((driven[name][1] + others[name]) * driven[name][0] for name in names if name in driven)
            assert power_across(joint, moving, wrench) == pytest.approx(expected, abs=1e-12 * size)


def test_legs_of_the_stewart_platform_do_work_as_they_extend():
    """A leg of length l that pushes with λ has the power λ l'; the work of the drives is its integral."""
    sim = Simulation.from_file("stewart")
    p, worked, function = sim.mechanism.parameters, [], powers(sim.model.equations)
    for _ in range(20):
        sim.step(100)
        rates = p["s"] * p["w"] * np.cos(p["w"] * sim.time + np.arange(6.0))
        forces = np.concatenate(list(sim.multipliers().values()))
        _, (_, drives, _) = function(sim.time, sim.state, sim.efforts)
        worked.append(drives)
        assert drives == pytest.approx(forces @ rates, rel=1e-12, abs=1e-12)
    assert max(worked) > 0.3 and min(worked) < -0.3
