"""Constraint rows: velocities are the rates of positions, and forces on bodies are what G says (d'Alembert)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings

from mbd_sim.dynamics import equations as engine
from mbd_sim.dynamics.constraint_equations import State, constraints_of
from mbd_sim.dynamics.kinematics import link_motions, part_poses
from mbd_sim.dynamics.links import layout, links
from mbd_sim.errors import MechanismError
from mbd_sim.load import load_mechanism, parse_mechanism
from test.generators.loops import random_mechanisms, state_near_start
from test.generators.mechanisms import SHIPPED


@dataclass
class Traced:
    """Φ, G, G u + b, γ, Σ Jᵀ w of all rows, and q', as functions of t, q, u."""

    names: tuple[str, ...]
    holonomic: np.ndarray
    values: ca.Function


def traced(mechanism):
    places, chain = layout(mechanism), links(mechanism)
    t, q, u = ca.SX.sym("t"), ca.SX.sym("q", places.nq), ca.SX.sym("u", places.nv)
    motions, poses = link_motions(chain, t, q, u), part_poses(chain, t, q)
    q_rates = engine._q_rates(chain, motions, places.nq)
    found = constraints_of(mechanism, chain, places, State(t, q, u, q_rates), motions, poses)
    forces = ca.SX(places.nv, len(found.rows))
    for motion, wrench in zip(motions, found.wrenches, strict=True):
        forces += ca.jacobian(motion.velocity, u).T @ wrench
    for column, row in enumerate(found.rows):
        for name, factor in row.factors.items():
            if name in mechanism.coordinate_names:
                forces[mechanism.coordinate_names.index(name), column] += factor
    outputs = [found.position, found.gradient, found.velocity, found.bias, forces.T, q_rates]
    holonomic = np.array([row.position is not None for row in found.rows], dtype=bool)
    function = ca.Function("rows", [t, q, u], [ca.densify(output) for output in outputs])
    return Traced(tuple(row.name for row in found.rows), holonomic, function)


def check(mechanism, rng, t=0.05):
    derived = engine.derive(mechanism)
    if not derived.rows or (state := state_near_start(mechanism, derived, rng, t)) is None:
        return
    rows, (q, u, _) = traced(mechanism), state
    position, gradient, velocity, bias, forces, q_rates = (np.array(x) for x in rows.values(t, q, u))
    assert forces == pytest.approx(gradient, rel=1e-12, abs=1e-13 * max(1.0, np.max(np.abs(gradient))))
    assert position == pytest.approx(np.zeros_like(position), abs=1e-10 * derived.conditions.size)
    assert velocity == pytest.approx(np.zeros_like(velocity), abs=1e-12 * max(1.0, np.max(np.abs(gradient))))

    def along_the_motion(output, h):
        """Where the speeds lead in a time h, with a small step's error of second order in q, which cancels."""
        return np.array(rows.values(t + h, q + h * q_rates.ravel(), u)[output]).ravel()

    h = 1e-3
    for output, expected in ((0, velocity), (2, bias)):
        ahead, further = (along_the_motion(output, k * h) - along_the_motion(output, -k * h) for k in (1, 2))
        rate = (8.0 * ahead - further) / (12.0 * h)
        known = rows.holonomic if output == 0 else slice(None)
        size = max(1.0, np.max(np.abs(expected)), np.max(np.abs(gradient)))
        assert rate[known] == pytest.approx(expected.ravel()[known], abs=1e-6 * size)


@settings(max_examples=15)
@given(random_mechanisms())
def test_rows_of_random_mechanisms(drawn):
    text, rng = drawn
    try:
        check(parse_mechanism(text), rng)
    except MechanismError:
        return  # contradicts its drives


@pytest.mark.parametrize("name", SHIPPED)
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
NUMBERS = {"revolute": 5, "prismatic": 5, "screw": 5, "cylindrical": 4, "universal": 4, "planar": 3, "spherical": 3}


@pytest.mark.parametrize(("kind", "count"), NUMBERS.items())
def test_a_joint_that_closes_a_loop_leaves_its_own_freedoms(kind, count):
    axis = AXES.get(kind, ", axis: [0, 0, 1]") + (", lead: 0.5" if kind == "screw" else "")
    derived = engine.derive(parse_mechanism(LOOP.replace("KIND", kind + axis)))
    assert len(derived.rows) >= count
    assert derived.start.rank == count == len(derived.start.keep)


def test_rows_are_named_after_what_they_constrain():
    names = [row.name for row in engine.derive(load_mechanism("four_bar")).rows]
    assert names == [
        "rocker_pin: displacement along x",
        "rocker_pin: displacement along y",
        "rocker_pin: displacement along z",
        "rocker_pin: tilt of the axis, 1",
        "rocker_pin: tilt of the axis, 2",
    ]


def test_a_screw_that_closes_a_loop_knows_no_whole_turns():
    """Its nut has turned several times and advanced as much: the loop is closed there as well."""
    text = LOOP.replace("KIND", "screw, axis: [0, 0, 1], lead: 0.5").replace("[-0.2, 0.2, 0.2]", "[-0.2, 0.2, 1.7]")
    derived = engine.derive(parse_mechanism(text))
    position = np.array(derived.violation(0.0, derived.start_state))[:, 0]
    assert position == pytest.approx(np.zeros(len(position)), abs=1e-14)
    assert derived.start.q[:3] == pytest.approx([-0.2, 0.2, 1.7], abs=1e-14)


def test_a_screw_that_closes_a_loop_knows_half_turns():
    """A nut half a lead further on must have turned half-way; held as it is, it does not fit."""
    text = LOOP.replace("KIND", "screw, axis: [0, 0, 1], lead: 0.5").replace("[-0.2, 0.2, 0.2]", "[-0.2, 0.2, 0.45]")
    with pytest.raises(MechanismError, match="axis turned over"):
        engine.derive(parse_mechanism(text.replace("0.45]", "0.45], orientation: {rpy: [0, 0, 0]}")))
