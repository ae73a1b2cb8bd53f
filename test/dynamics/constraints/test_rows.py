"""Constraint rows: velocities are the rates of positions, and the forces on bodies correspond to G (d'Alembert)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from hypothesis import given

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.constraints.equations import constraint_equations
from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.kinematics.tracing import trace
from mbd_sim.dynamics.layouts.vectors import AUDIT_STATES
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.loops import random_mechanisms, state_near_start, with_same_mechanisms


@dataclass
class RowFunctions:
    """Φ, G, G u + b, γ, Σ Jᵀ w of all rows, and q', as functions of t, q, u."""

    holonomic: np.ndarray
    values: Callable[..., list[ca.DM]]


def row_functions(mechanism):
    traced = trace(mechanism)
    state, equations = traced.state, constraint_equations(traced)
    forces = ca.SX(traced.layout.nv, len(equations.rows))
    for motion, wrench in zip(traced.motions, equations.wrenches, strict=True):
        forces += ca.jacobian(motion.V_WL, state.u).T @ wrench
    for column, row in enumerate(equations.rows):
        for name, factor in row.factors.items():
            if name in mechanism.coordinate_names:
                forces[mechanism.coordinate_names.index(name), column] += factor
    position, gradient, velocity, bias = equations.position, equations.gradient, equations.velocity, equations.bias
    outputs = [position, gradient, velocity, bias, forces.T, state.q_rates]
    function = ca.Function("rows", [traced.y, state.t], [ca.densify(output) for output in outputs])

    def values(t, q, u):
        return function(np.concatenate([q, u, np.zeros(len(AUDIT_STATES))]), t)

    holonomic = np.array([row.position is not None for row in equations.rows], dtype=bool)
    return RowFunctions(holonomic, values)


def check(mechanism, rng, t=0.05):
    derived = derive(mechanism)
    if not derived.rows or (state := state_near_start(mechanism, derived, rng, t)) is None:
        return
    rows, (q, u, _) = row_functions(mechanism), state
    position, gradient, velocity, bias, forces, q_rates = (np.array(x) for x in rows.values(t, q, u))
    assert forces == pytest.approx(gradient, rel=1e-12, abs=1e-13 * max(1.0, np.max(np.abs(gradient))))
    assert position == pytest.approx(np.zeros_like(position), abs=1e-10 * derived.constraints.size)
    assert velocity == pytest.approx(np.zeros_like(velocity), abs=1e-12 * max(1.0, np.max(np.abs(gradient))))

    def after(output, h):
        """An output after a time h at constant speeds; the error of second order in q cancels in differences."""
        return np.array(rows.values(t + h, q + h * q_rates.ravel(), u)[output]).ravel()

    h = 1e-3
    for output, expected in ((0, velocity), (2, bias)):
        ahead, further = (after(output, k * h) - after(output, -k * h) for k in (1, 2))
        rate = (8.0 * ahead - further) / (12.0 * h)
        known = rows.holonomic if output == 0 else slice(None)
        size = max(1.0, np.max(np.abs(expected)), np.max(np.abs(gradient)))
        assert rate[known] == pytest.approx(expected.ravel()[known], abs=1e-6 * size)


@with_same_mechanisms
@given(random_mechanisms())
def test_rows_of_random_mechanisms(drawn):
    text, rng = drawn
    try:
        check(parse_mechanism(text), rng)
    except MechanismError:
        return  # contradicts its drives


@pytest.mark.parametrize("name", ["knife_edge", "insect_on_sphere", "bennett", "scissor_lift"])
def test_rows_of_shipped_mechanisms(name):
    check(load_mechanism(name), np.random.default_rng(4))


LOOP = """
mechanism: loop
ground: {points: {o: {at: [0.1, 0.2, 0.3]}}}
parts:
  body: {mass: 1, inertia: [1, 1, 1], points: {p: {at: [0.3, 0, 0.1]}}}
joints:
  flight: {type: free, between: [ground, body], position: [-0.2, 0.2, 0.2]}
  closing: {type: KIND, between: [ground.o, body.p], cut: true}
"""
AXES = {"universal": ", axes: [[1, 0, 0], [0, 1, 0]]", "spherical": "", "fixed": ""}
NUMBERS = {"screw": 5, "cylindrical": 4, "universal": 4, "planar": 3, "spherical": 3}


@pytest.mark.parametrize(("kind", "count"), NUMBERS.items())
def test_a_closing_joint_leaves_the_freedoms_of_its_type(kind, count):
    axis = AXES.get(kind, ", axis: [0, 0, 1]") + (", lead: 0.5" if kind == "screw" else "")
    derived = derive(parse_mechanism(LOOP.replace("KIND", kind + axis)))
    assert len(derived.rows) >= count
    assert derived.start.rank == count == len(derived.start.independent)


def test_rows_are_named_after_what_they_constrain():
    names = [row.name for row in derive(load_mechanism("four_bar")).rows]
    assert names == [
        "rocker_pin: displacement along x",
        "rocker_pin: displacement along y",
        "rocker_pin: displacement along z",
        "rocker_pin: tilt of the axis, 1",
        "rocker_pin: tilt of the axis, 2",
    ]


def test_whole_turns_of_a_closing_screw_make_no_difference():
    """The loop is also closed if the nut has made several turns and advanced accordingly."""
    text = LOOP.replace("KIND", "screw, axis: [0, 0, 1], lead: 0.5").replace("[-0.2, 0.2, 0.2]", "[-0.2, 0.2, 1.7]")
    derived = derive(parse_mechanism(text))
    position = np.array(derived.violation(0.0, derived.start_state))[:, 0]
    assert position == pytest.approx(np.zeros(len(position)), abs=1e-14)
    assert derived.start.q[:3] == pytest.approx([-0.2, 0.2, 1.7], abs=1e-14)


def test_half_a_turn_of_a_closing_screw_makes_a_difference():
    """A nut that is displaced by half a lead must have made half a turn; with a fixed orientation it does not fit."""
    text = LOOP.replace("KIND", "screw, axis: [0, 0, 1], lead: 0.5").replace("[-0.2, 0.2, 0.2]", "[-0.2, 0.2, 0.45]")
    with pytest.raises(MechanismError, match="wrong assembly mode"):
        derive(parse_mechanism(text.replace("0.45]", "0.45], orientation: {rpy: [0, 0, 0]}")))


def test_equations_of_no_rows_are_like_none_chosen_of_those_of_loops():
    """So a chain, for which they are not derived, has the shapes of a mechanism for which they are."""
    loops, chain = trace(load_mechanism("four_bar")), trace(load_mechanism("moving_support_pendulum"))
    none, chosen = constraint_equations(chain), constraint_equations(loops).select(())
    assert len(none.rows) == len(chosen.rows) == 0
    for name in ("position", "velocity", "bias", "own_rate"):
        assert getattr(none, name).shape == getattr(chosen, name).shape == (0, 1), name
    for traced, equations in ((chain, none), (loops, chosen)):
        assert equations.gradient.shape == (0, traced.layout.nv)
        assert [wrench.shape for wrench in equations.wrenches] == [(6, 0)] * len(traced.links)
        assert {name: factors.shape for name, factors in equations.driven_factors.items()} == dict.fromkeys(
            traced.mechanism.driven_names, (0, 1)
        )
    assert none.driven_factors and none.branch_checks.shape == (0, 1)
