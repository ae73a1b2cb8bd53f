"""Synthesis for paths, functions and efforts: known linkages are found again, and optima agree with other optimizers."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from mbd_sim import InputError, MbdSimError, MechanismError, parse_mechanism
from mbd_sim.files.checks.override import with_values
from mbd_sim.studies.kinematic_analysis import UnreachableError, drive_loads, driven_motion
from mbd_sim.studies.synthesis import EffortGoal, FunctionGoal, PathGoal, synthesize
from mbd_sim.studies.synthesis.problem import DesignProblem
from mbd_sim.studies.synthesis.synthesis import _require_movable, design_text
from test.studies.kinematic_analysis.linkages import few_starts, four_bar, rocker_angles, tracer

SIZES = {"a": 0.5, "b": 1.4, "c": 1.2, "d": 1.5, "px": 0.7, "py": 0.4}
POOR = {"a": 0.4, "b": 1.6, "c": 1.0, "d": 1.4, "px": 0.5, "py": 0.6}
BOUNDS = {key: (0.3 * value, 3.0 * value) for key, value in SIZES.items()}
ANGLES = np.linspace(0.2, 6.0, 12)


def in_plane(path):
    return np.column_stack([path.real, path.imag, np.full(len(path), np.nan)])


def test_a_coupler_curve_leads_back_to_its_linkage():
    """The timing is free, and the first guesses of the crank angle are wrong by 0.1 rad."""
    goal = PathGoal("coupler.tracer", in_plane(tracer(ANGLES)), ANGLES + 0.1, True)
    design = synthesize(with_values(four_bar(), POOR), "motor", goal, BOUNDS)
    assert design.converged and design.start_rms > 0.1 and design.rms < 1e-14
    assert design.values == pytest.approx(SIZES, abs=1e-10)
    assert design.drives == pytest.approx(ANGLES, abs=1e-10)
    motion = driven_motion(design.mechanism, {"motor": (0.2, 6.0)}, 12)
    assert motion.point("coupler.tracer").position @ [1, 1j, 0] == pytest.approx(tracer(ANGLES), abs=1e-10)


def test_a_range_that_leaves_out_the_start():
    """The crank starts at 60°; it is led to the range first."""
    angles = np.linspace(10.0, 8.0, 9)
    goal = PathGoal("coupler.tracer", in_plane(tracer(angles)), angles)
    design = synthesize(with_values(four_bar(), POOR), "motor", goal, BOUNDS)
    assert design.converged and design.start_rms > 0.05 and design.rms < 1e-13
    assert design.values == pytest.approx(SIZES, abs=1e-9)


def freudenstein(theta, phi):
    """Crank, coupler and rocker, on pivots 1 apart, for three pairs of angles: linear in K1, K2, K3."""
    k1, k2, k3 = np.linalg.solve(np.column_stack([np.cos(phi), -np.cos(theta), np.ones(3)]), np.cos(theta - phi))
    a, c = 1.0 / k1, 1.0 / k2
    return {"a": a, "b": np.sqrt(a * a + c * c + 1.0 - 2.0 * a * c * k3), "c": c}


def test_a_function_generator_is_better_than_one_with_three_exact_points():
    """The rocker turns by a power of the crank angle; the optimum agrees with that of the closed form."""
    theta = np.linspace(1.0, 2.6, 11)

    def wanted(angle):
        return 1.2 + 0.2 * angle**1.5

    exact = 1.8 - 0.8 * np.cos(np.radians([30, 90, 150]))
    lengths = freudenstein(exact, wanted(exact))
    assert rocker_angles(exact, d=1.0, **lengths)[0] == pytest.approx(wanted(exact), abs=1e-12)
    start = four_bar(**lengths, d=1.0, start=90, guess=-60)
    bounds = {key: (0.3 * value, 3.0 * value) for key, value in lengths.items()}
    design = synthesize(start, "motor", FunctionGoal("pivot", wanted(theta), theta), bounds)
    assert design.rms < 0.95 * design.start_rms

    def closed_form(sizes):
        return rocker_angles(theta, *sizes, 1.0)[0] - wanted(theta)

    other = least_squares(closed_form, list(lengths.values()), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert design.rms == pytest.approx(np.sqrt(np.mean(other.fun**2)), rel=1e-8)
    assert list(design.values.values()) == pytest.approx(other.x, rel=1e-4)
    peak = synthesize(start, "motor", FunctionGoal("pivot", wanted(theta), theta), bounds, norm="peak")
    assert peak.converged and peak.peak < design.peak and peak.rms > design.rms
    alternating = np.sum(np.abs(np.abs(peak.deviations) - peak.peak) < 1e-9 * peak.peak)
    assert alternating >= 4  # equally large deviations at an optimum with three unknowns


def test_an_offset_of_a_function_is_found():
    goal = FunctionGoal("pivot", rocker_angles(ANGLES)[0] + 0.3, ANGLES, free_offset=True)
    start = with_values(four_bar(), {"a": 0.45, "b": 1.5})
    design = synthesize(start, "motor", goal, {key: BOUNDS[key] for key in ("a", "b")})
    assert design.values == pytest.approx({"a": 0.5, "b": 1.4}, abs=1e-9)
    assert design.offset == pytest.approx(-0.3, abs=1e-9)


def test_the_least_peak_torque_is_lower_than_all_around_it():
    mechanism, speed, drives = four_bar(), 6.0, np.linspace(0.0, 2.0 * np.pi, 9)
    goal = EffortGoal(drives, speed)
    design = synthesize(mechanism, "motor", goal, {"c": (1.15, 1.7)}, norm="peak")
    assert "Effort, peak" in design_text(mechanism, design, goal, "peak")

    def peak(size):
        motion = driven_motion(with_values(mechanism, {"c": size}), {"motor": (0.0, 2.0 * np.pi)}, 9, speed=speed)
        return np.max(np.abs(drive_loads(motion).efforts["motor"]))

    assert peak(design.values["c"]) == pytest.approx(design.peak, rel=1e-12)
    least = [peak(design.values["c"] * factor) for factor in (0.999, 1.001)]
    assert design.peak < min(least)
    assert design.peak < 0.99 * design.start_peak


@pytest.mark.parametrize(
    ("goal", "variables", "error", "message"),
    [
        (FunctionGoal("pivot", ANGLES, ANGLES), {"a": (0.6, 1.0)}, InputError, "0.5 of a is not between its bounds"),
        (FunctionGoal("pivot", ANGLES, ANGLES), {}, InputError, "no parameter may change"),
        (FunctionGoal("pivott", ANGLES, ANGLES), {"a": (0.1, 1.0)}, InputError, "Did you mean 'pivot'"),
        (PathGoal("coupler.tap", in_plane(ANGLES + 0j), ANGLES), {"a": (0.1, 1.0)}, InputError, "has no point 'tap'"),
        (FunctionGoal("pivot", ANGLES, ANGLES), {"e": (0.1, 1.0)}, MechanismError, "e: is not a key"),
    ],
)
def test_what_cannot_be_searched_is_refused(goal, variables, error, message):
    with pytest.raises(error, match=message):
        synthesize(four_bar(), "motor", goal, variables)


def test_wrong_goals_are_refused():
    with pytest.raises(InputError, match=r"positions have the shape \(2,\)"):
        PathGoal("coupler.tracer", np.zeros(2), np.zeros(2))
    with pytest.raises(InputError, match="without any position"):
        PathGoal("coupler.tracer", np.full((2, 3), np.nan), np.arange(2.0))
    with pytest.raises(InputError, match=r"infinite.*nan"):
        PathGoal("coupler.tracer", np.full((2, 3), [np.inf, 0.0, 1.0]), np.arange(2.0))
    for drives in (np.array([np.nan, 1.0]), 1.0):
        with pytest.raises(InputError, match="at least two finite numbers"):
            EffortGoal(drives, 1.0)


def test_goals_may_be_lists():
    goal = PathGoal("coupler.tracer", [[0, 0, 1], [0, 0, 2]], [0, 1])
    assert goal.positions.dtype == goal.drives.dtype == float
    assert goal.positions.tolist() == [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]]


def test_a_goal_beyond_a_dead_point_is_refused():
    start = four_bar(1.0, 1.0, 1.1, 2.2, 40)
    with pytest.raises(UnreachableError, match="motor reaches from -71"):
        synthesize(start, "motor", FunctionGoal("pivot", ANGLES, ANGLES), {"a": (0.5, 1.5)})


def test_an_optimum_on_two_branches_is_refused(monkeypatch):
    few_starts(monkeypatch)
    problem = DesignProblem(four_bar(), "motor", FunctionGoal("pivot", np.ones(2), np.array([1.0, 2.0])), ["a"])
    modes = [driven_motion(four_bar(), {"motor": (1.0, 2.0)}, 2, mode=mode).q for mode in (1, 2)]
    problem.begin(np.array([modes[0][0], modes[1][1]]))
    with pytest.raises(MbdSimError, match=r"on different branches of the motion\. Give narrower bounds"):
        _require_movable(problem, problem.start)


def test_an_effort_that_is_larger_between_the_positions_is_told():
    """Beside the positions of the drive, 20 N acts for 20 mm of the way."""
    punch = parse_mechanism("""
mechanism: punch
parameters: {weight: 3}
parts: {ram: {mass: 2}}
joints: {slide: {type: prismatic, between: [ground, ram], axis: [1, 0, 0]}}
forces: {sheet: {type: effort, coordinate: slide, effort: "-weight - where(slide > 0.06 and slide < 0.08, 20, 0)"}}
""")
    goal = EffortGoal([0.0, 0.05, 0.1], 1.0)
    design = synthesize(punch, "slide", goal, {"weight": (2.0, 4.0)}, norm="peak")
    text = design_text(punch, design, goal, "peak")
    assert design.peak == pytest.approx(2.0)
    assert "between the positions it reaches 22 N, at slide = 0.0625 m" in text and "more positions than 3" in text
    fine = EffortGoal(np.linspace(0.0, 0.1, 21), 1.0)
    design = synthesize(punch, "slide", fine, {"weight": (2.0, 4.0)}, norm="peak")
    assert design.peak == pytest.approx(22.0) and "between" not in design_text(punch, design, fine, "peak")
