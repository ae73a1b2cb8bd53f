"""One-sided elements as LaTeX: the conditions are stated, their formulas parse, and they evaluate to the engine's numbers."""

import functools
import re

import numpy as np
import pytest
import sympy as sp

from mbd_sim import Simulation
from mbd_sim.base.errors import MbdSimError
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.studies.symbolic import symbolic_equations, to_latex
from test.studies.symbolic.test_latex import parse

CASES = re.compile(r"\\begin\{cases\}(.*?)\\end\{cases\}")
NAMES = ("bounce", "elbow_stop", "belt", "freewheel", "spinning_ball", "slider_crank_friction")

PUCK = """
mechanism: puck
parts: {puck: {shape: {type: sphere, mass: 1, radius: 0.1}}}
joints: {puck: {type: free, between: [ground, puck], velocity: [1, 2, 0]}}
constraints: {ice: {type: on_plane, point: puck, bound: at_least, friction: 0.1, static_friction: 0.15, restitution: 1}}
"""


@functools.cache
def text_of(name):
    return to_latex(symbolic_equations(load_mechanism(name)))


def formulas(text):
    """The sides of all lines of the document that are aligned, and the cases within them."""
    for block in re.findall(r"\\begin\{align\*\}(.*?)\\end\{align\*\}", text, re.DOTALL):
        for cases in CASES.findall(block):
            yield from (side for line in cases.split(r"\\") for side in line.split("&"))
        for line in CASES.sub("1", block).split("\\\\\n"):
            yield from (re.sub(r"^ *= *|\\quad \{\}", "", side) for side in line.split("&"))


@pytest.mark.parametrize("name", NAMES)
def test_every_formula_parses(name):
    text = text_of(name)
    for formula in formulas(text):
        if formula.strip():
            parse(formula.strip().removeprefix(r"\perp ").removeprefix(r"\in "))
    for delimiter in ("align*", "cases", "itemize"):
        assert text.count(rf"\begin{{{delimiter}}}") == text.count(rf"\end{{{delimiter}}}")
    assert text.count("{") == text.count("}") and text.count(r"\left") == text.count(r"\right")


def test_a_gap_has_complementarity_and_a_law_of_impact():
    text = text_of("bounce")
    assert r"\ddot{q}_{\mathrm{height}} &= \tau_{\mathrm{height}} - 9.81 + \lambda_{\mathrm{floor}}" in text
    assert r"g_{\mathrm{floor}} &= q_{\mathrm{height}}" in text
    assert r"0 \leq g_{\mathrm{floor}} & \perp \lambda_{\mathrm{floor}} \geq 0" in text
    assert r"At an impact, $M \left(u^{+} - u^{-}\right) = G^{T} \Lambda$, where all closed gaps satisfy" in text
    impact = (
        r"0 \leq \dot{g}_{\mathrm{floor}}^{+} + 0.8\, \dot{g}_{\mathrm{floor}}^{-} & \perp \Lambda_{\mathrm{floor}}"
    )
    assert impact in text


def test_friction_is_a_set_valued_law_in_motion_and_in_impacts():
    text, slip = text_of("spinning_ball"), r"v_{\mathrm{floor}}"
    assert rf"{slip} &= \dot{{q}}_{{\mathrm{{ball,x}}}} -0.1\, \dot{{q}}_{{\mathrm{{ball,angle}}}}" in text
    sliding = rf"\left\{{- 0.2\, \lambda_{{\mathrm{{floor}}}}\, {slip} / \left|{slip}\right|\right\}} & {slip} \neq 0"
    sticking = (
        rf"\left\{{x \in \mathbb{{R}} : \left|x\right| \leq 0.2\, \lambda_{{\mathrm{{floor}}}}\right\}} & {slip} = 0"
    )
    law = rf"\lambda_{{\mathrm{{floor}},T}} & \in \begin{{cases}} {sliding} \\ {sticking} \end{{cases}}"
    assert law in text
    in_impact = law.replace(r"\lambda", r"\Lambda").replace(slip, slip + "^{+}")
    assert in_impact in text


def test_friction_in_a_plane_has_a_disc_of_forces_with_its_own_size_at_rest():
    text = to_latex(symbolic_equations(parse_mechanism(PUCK)))
    slip = r"\left(v_{\mathrm{ice},1}, v_{\mathrm{ice},2}\right)"
    assert rf"\left\{{- 0.1\, \lambda_{{\mathrm{{ice}}}}\, {slip} / \left|{slip}\right|\right\}}" in text
    assert r"\left\{x \in \mathbb{R}^{2} : \left|x\right| \leq 0.15\, \lambda_{\mathrm{ice}}\right\}" in text
    assert r"0 \leq \dot{g}_{\mathrm{ice}}^{+} + \dot{g}_{\mathrm{ice}}^{-} & \perp" in text


def test_clutches_and_loaded_joints_have_laws_without_a_gap():
    clutch, guide = text_of("freewheel"), text_of("slider_crank_friction")
    assert r"0 \leq w_{\mathrm{clutch}} & \perp \lambda_{\mathrm{clutch}} \geq 0" in clutch
    assert "At an impact" not in clutch + guide
    assert r"\leq 0.2\, N_{\mathrm{guide}}" in guide
    assert r"$N_{\mathrm{guide}}$ is the force that the joint transmits across its axis" in guide
    assert "and the friction" in guide  # after its two-sided constraint


@pytest.mark.parametrize("name", ["rope", "spinning_ball"])
def test_gaps_slips_and_what_their_forces_do_are_those_of_the_engine(name):
    found = symbolic_equations(load_mechanism(name))
    sim = Simulation.from_file(name)
    sim.run(until=0.17)
    values = dict(zip((*found.q, *found.u), (*sim.q, *sim.u), strict=True))

    def rate(row):
        speeds = sum(sp.sympify(factor) * u for factor, u in zip(row.gradient, found.u, strict=True))
        return float((speeds + row.drift).subs(values))

    states = list(sim.contacts().values())
    assert len(states) == len(found.contacts)
    for contact, state in zip(found.contacts, states, strict=True):
        assert float(contact.gap.position.subs(values)) == pytest.approx(state.gap, abs=1e-13)
        assert rate(contact.gap) == pytest.approx(state.rate, abs=1e-12)
        assert [rate(row) for row in contact.slip] == pytest.approx(list(state.slip), abs=1e-12)
    values |= {**dict.fromkeys(found.efforts, 0.0), found.time: sim.time}
    terms = (found.mass, found.inertial, found.forces)
    mass, h, forces = (np.array(sp.Matrix(term).subs(values), dtype=float) for term in terms)
    for contact, state in zip(found.contacts, states, strict=True):
        for row, force in zip(contact.rows, (state.normal, *state.friction), strict=True):
            forces += force * np.array(sp.Matrix(row.gradient).subs(values), dtype=float)
    assert np.linalg.solve(mass, forces - h).ravel() == pytest.approx(sim.u_rates, abs=1e-11)


def test_a_cam_is_refused_because_its_gap_is_found_by_iteration():
    with pytest.raises(MbdSimError, match="the gap of cam has no formula"):
        symbolic_equations(load_mechanism("cam_lift_off"))
