"""Designs under conditions agree with closed forms of the slider-crank: x = r cos(a) + sqrt(l² - r² sin²(a))."""

import numpy as np
import pytest
from scipy.optimize import brentq, minimize, minimize_scalar

from mbd_sim import InputError, parse_mechanism
from mbd_sim.studies.synthesis import Condition, EffortGoal, FunctionGoal, synthesize
from mbd_sim.studies.synthesis.candidates import PENALTY, candidates_of
from mbd_sim.studies.synthesis.conditions import conditions_of, measured
from mbd_sim.studies.synthesis.minimizers import least_squares
from mbd_sim.studies.synthesis.synthesis import design_problem, design_text

ANGLES = np.linspace(0.1, 3.0, 9)  # the slider is at its ends at the ends
SLIDER_CRANK = parse_mechanism("""
mechanism: slider_crank
parameters: {r: 0.12, l: 0.4}
parts:
  crank: {mass: 1 kg, inertia: [0, 0, 0], points: {end: [r, 0, 0]}}
  rod: {mass: 1 kg, inertia: [0, 0, 0], points: {end: [l, 0, 0]}}
  ram: {mass: 1 kg, inertia: [0, 0, 0]}
joints:
  motor: {type: revolute, between: [ground, crank], axis: [0, 0, 1], position: 0.1}
  pin: {type: revolute, between: [crank.end, rod], axis: [0, 0, 1], guess: true, position: -0.13}
  slide: {type: prismatic, between: [ground, ram], axis: [1, 0, 0], guess: true, position: 0.52}
  wrist: {type: revolute, between: [rod.end, ram], axis: [0, 0, 1]}
gravity: [0, 0, 0]
forces: {press: {type: force, at: ram, vector: [-1000, 0, 0]}}
""")


def position(r, rod):
    return r * np.cos(ANGLES) + np.sqrt(rod * rod - (r * np.sin(ANGLES)) ** 2)


WANTED = position(0.1, 0.25) + 0.004 * np.sin(ANGLES)  # no slider-crank does that
BOUNDS = {"r": (0.05, 0.2), "l": (0.2, 0.6)}
NORMS = {"rms": lambda values: np.sqrt(np.mean(values**2)), "peak": lambda values: np.max(np.abs(values))}


def crank_for(stroke, rod):
    return brentq(lambda r: np.ptp(position(r, rod)) - stroke, 0.05, 0.19, xtol=1e-15)


def test_of_all_linkages_with_a_stroke_the_best_one_is_found():
    norm = "peak"
    goal, keep = FunctionGoal("slide", WANTED, ANGLES), conditions_of(["stroke(slide) = 180mm"], SLIDER_CRANK)
    design = synthesize(SLIDER_CRANK, "motor", goal, BOUNDS, norm=norm, conditions=keep)
    best = minimize_scalar(
        lambda rod: NORMS[norm](position(crank_for(0.18, rod), rod) - WANTED),
        bounds=(0.2, 0.6),
        options={"xatol": 1e-12},
    )
    assert design.converged and design.keeps_conditions
    assert design.values["r"] == pytest.approx(crank_for(0.18, design.values["l"]), rel=1e-8)
    assert design.values["l"] == pytest.approx(best.x, rel=1e-4)
    assert NORMS[norm](design.deviations) == pytest.approx(best.fun, rel=1e-6)
    assert "stroke(slide)" in design_text(SLIDER_CRANK, design, goal, norm)


def test_of_two_limits_the_one_that_acts_is_reached_and_the_other_changes_nothing():
    keep = conditions_of(["max(slide) <= 0.33", "min(slide) >= 0.1"], SLIDER_CRANK)
    goal = FunctionGoal("slide", WANTED, ANGLES)
    design = synthesize(SLIDER_CRANK, "motor", goal, BOUNDS, conditions=keep)
    other = minimize(
        lambda x: 1e3 * np.sum((position(*x) - WANTED) ** 2),
        [0.1, 0.22],
        bounds=list(BOUNDS.values()),
        constraints={"type": "ineq", "fun": lambda x: 0.33 - np.max(position(*x))},
        options={"ftol": 1e-15},
    )
    assert design.keeps_conditions and design.conditions[0].end == pytest.approx(0.33, rel=1e-8)
    assert list(design.values.values()) == pytest.approx(other.x, rel=1e-3)


def test_the_least_torque_at_the_same_stroke_takes_the_longest_rod():
    """Without the condition the shortest crank would be best: torque = force times dx/da."""
    keep = conditions_of(["stroke(slide) = 0.2"], SLIDER_CRANK)
    goal = EffortGoal(ANGLES, 0.0)
    design = synthesize(SLIDER_CRANK, "motor", goal, BOUNDS, norm="peak", conditions=keep)
    assert design.keeps_conditions
    r = crank_for(0.2, 0.6)
    assert design.values == pytest.approx({"r": r, "l": 0.6}, rel=1e-7)
    root = np.sqrt(0.6**2 - (r * np.sin(ANGLES)) ** 2)
    slope = -r * np.sin(ANGLES) - r * r * np.sin(ANGLES) * np.cos(ANGLES) / root
    assert design.peak == pytest.approx(1000.0 * np.max(np.abs(slope)), rel=1e-6)


def test_a_global_search_adds_violations_to_the_losses_of_its_candidates():
    keep = conditions_of(["stroke(slide) = 0.2", "max(crank.end.y) <= 0.3"], SLIDER_CRANK)
    problem = design_problem(SLIDER_CRANK, "motor", FunctionGoal("slide", WANTED, ANGLES), BOUNDS, "rms", keep)
    sizes = np.array([[0.1, 0.3], [0.15, 0.5]])
    places = np.array([position(*each) for each in sizes])
    expected = [NORMS["rms"](each - WANTED) + PENALTY * 2.0 * abs(np.ptp(each) - 0.2) / 0.2 for each in places]
    assert candidates_of(problem, "rms", 2.0).losses(sizes) == pytest.approx(expected, rel=1e-6)


def test_a_condition_that_cannot_be_kept_is_said():
    keep = conditions_of(["stroke(slide) >= 2"], SLIDER_CRANK)
    goal = FunctionGoal("slide", WANTED, ANGLES)
    design = synthesize(SLIDER_CRANK, "motor", goal, BOUNDS, conditions=keep)
    assert not design.keeps_conditions
    assert "(>= 2 m: NOT KEPT" in design_text(SLIDER_CRANK, design, goal, "rms")


@pytest.mark.parametrize("measure", ["stroke", "max", "min"])
def test_the_slopes_of_what_is_measured_are_those_of_differences(measure):
    random = np.random.default_rng(3)
    angles = np.linspace(0.0, 6.0, 41)
    values, slopes = np.sin(angles), random.normal(size=(len(angles), 2))
    condition = Condition(measure, "slide", "=", 1.0, "m")
    value, found = measured(condition, values, slopes)
    assert value == pytest.approx({"stroke": 2.0, "max": 1.0, "min": -1.0}[measure], abs=1e-4)
    for column, slope in enumerate(found):
        step = 1e-7 * slopes[:, column]
        ends = [measured(condition, values + sign * step, slopes)[0] for sign in (1.0, -1.0)]
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("stroke slide = 1", "is not a condition.*stroke"),
        ("mean(slide) = 1", "is not a condition"),
        ("max(slid) <= 1", "slid"),
        ("max(slide) <= 10deg", "max.slide.*"),
        ("stroke(slide) = -1", "a stroke is positive"),
    ],
)
def test_mistakes_are_named(text, said):
    with pytest.raises(InputError, match=said):
        conditions_of([text], SLIDER_CRANK)


def test_conditions_of_least_squares_take_few_evaluations():
    """Rounds of the augmented Lagrangian that are exact long before their multipliers are: 74 evaluations."""
    calls = []

    def deviations(x):
        calls.append(x)
        return np.array([np.exp(x[0]) - 3 * x[1], x[1] ** 2 - x[2], x[2] * x[0] - 2, np.sin(x[0] * x[2])])

    def jacobian(x):
        turned = np.cos(x[0] * x[2])
        return np.array([[np.exp(x[0]), -3, 0], [0, 2 * x[1], -1], [x[2], 0, x[0]], [x[2] * turned, 0, x[0] * turned]])

    def excess(x):
        return np.array([x @ x - 2.0, 0.3 - x[1]]), np.array([2 * x, [0, -1, 0]])

    bounds = np.full(3, -3.0), np.full(3, 3.0)
    x, _, converged = least_squares(
        deviations, jacobian, np.full(3, 0.5), bounds, 1000, excess=excess, equal=np.array([True, False])
    )
    assert converged and len(calls) < 60
    assert x @ x == pytest.approx(2.0, rel=1e-9)
    slope = jacobian(x).T @ deviations(x)  # only the sphere holds it back
    assert np.linalg.norm(np.cross(slope, x)) < 1e-6
