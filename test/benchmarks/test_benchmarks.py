"""The benchmarks run with our own engine, and other simulators, where installed, have the same mechanisms."""

import math

import numpy as np
import pytest

from benchmarks.engines import CLASSES, OURS, Candidate, candidates, load
from benchmarks.fresh import in_fresh_process
from benchmarks.judge import Judge
from benchmarks.measure import STEP, Effort, Result, difference, measure, require_agreement
from benchmarks.mechanisms import MECHANISMS, left_out, rods
from benchmarks.plan import plan_of
from benchmarks.robots import ROBOTS
from benchmarks.table import markdown

OURS_RK4 = Candidate(OURS, "rk4", "rk4")


# Longer chains than seven rods have the same plans and tapes, and take long to derive.
@pytest.mark.parametrize("name", [name for name in MECHANISMS if name not in ("30 rods", "100 rods", *ROBOTS)])
def test_plans_and_tapes_have_the_same_mechanism(name):
    text = MECHANISMS[name]()
    plan, judge = plan_of(text), Judge(text)
    assert len(plan.bodies) == len(plan.q) == len(judge.sim.q)
    assert sum(body.mass for body in plan.bodies) == pytest.approx(judge.sim.mechanism.mass)
    found = plan.tape.run([*plan.q, *plan.u], math.sin, math.cos)
    expected = [*plan.u, *judge.accelerations(plan.q, plan.u)]
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


def test_tables_of_our_own_engine():
    plan, judge = plan_of(rods(2)), Judge(rods(2))
    results, agreement = measure(plan, judge, [OURS_RK4, Candidate(OURS, "dop853", "dop853")], Effort(1, 0.01, 2.0))
    rk4, dop853 = results
    assert 1e-12 < rk4.error < 1e-9 and dop853.error < 1e-12 and agreement == {}
    assert abs(dop853.drift) < 1e-12 and dop853.violation is None and dop853.monitored == 3.0
    assert rk4.each > 0.0 and rk4.many > 0.0 and rk4.commanded > 0.0
    head, _, first, second = markdown(results, f"{OURS} dop853").splitlines()
    assert head.count("|") == first.count("|") and "loop open" not in head
    assert first.startswith("| **mbd_sim rk4** |") and "| 1.00 |" in first
    assert second.startswith("| **mbd_sim dop853**, default |") and "| 1.00 |" in second


def test_dampers_have_no_drift_of_energy():
    text = rods(1).replace("position: 90 deg", "position: 90 deg, damping: 0.5")
    plan = plan_of(text)
    (found,), _ = measure(plan, Judge(text), [OURS_RK4], Effort(1, 0.01, 0.5))
    assert plan.bodies[0].damping == 0.5 and found.drift is None and found.error < 1e-9


def test_tables_note_what_cannot_be_measured():
    failed = Result("other", note="cannot: no such joint")
    propagated = Result("another", many=0.5, drift=-0.4, error=math.inf, violation=1e-5, monitored=10.0)
    propagated.samples = {"many": [0.5, 0.4, 9.0]}
    ours = Result(f"{OURS} rk4", each=0.2, many=0.1, drift=-1e-8, error=1e-9, violation=1e-14)
    ours.samples = {"each": [0.2, 0.2, 0.2], "many": [0.1, 0.1, 1.8]}
    table = markdown([ours, failed, propagated], f"{OURS} rk4")
    assert "| (5.00) |" in table and "-40 % (10 s)" in table and "∞" in table and "loop open" in table
    assert table.endswith("\n\nother: cannot: no such joint.")


def test_setup_is_measured_in_a_separate_process():
    found = in_fresh_process(OURS_RK4, plan_of(rods(1)), STEP)
    assert found["again"] > 0.0 and 0.0 < found["setup"] < 60.0 and found["memory"] > 1.0


def test_plans_refuse_unsupported_elements():
    with pytest.raises(ValueError, match="'pin0' is more than a hinge or slider with a spring and a damper"):
        plan_of(rods(1).replace("position: 90 deg", "friction: {coulomb: 1}"))


def test_simulators_that_are_not_installed_are_named():
    found, lines = candidates([OURS, "heyoka"])
    assert OURS_RK4 in found and len(lines) == 2


def test_what_is_not_measured_has_a_reason():
    assert left_out("7 rods", "exudyn") == "" == left_out("ANYmal", "mujoco") == left_out("100 rods", OURS)
    assert left_out("100 rods", "exudyn") and left_out("ANYmal", "drake")


def test_other_mechanisms_are_refused():
    plan = plan_of(rods(1))
    require_agreement(plan, OURS_RK4, 1e-10)
    require_agreement(plan, OURS_RK4, None)
    for found in (2e-9, math.nan):
        with pytest.raises(RuntimeError, match="rods1: mbd_sim has a different mechanism"):
            require_agreement(plan, OURS_RK4, found)


@pytest.mark.parametrize("module", [module for module in CLASSES if module != OURS])
@pytest.mark.parametrize("name", ["2 rods", "cart+pendulum"])
def test_other_simulators_have_the_same_mechanism(module, name):
    try:
        method, key = next(iter(load(module).METHODS.items()))
    except ImportError:
        pytest.skip(f"{module} is not installed")
    text = MECHANISMS[name]()
    plan = plan_of(text)
    assert difference(plan, Judge(text), Candidate(module, method, key).build(plan, STEP)) < 1e-9
