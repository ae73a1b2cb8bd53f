"""Methods that keep a history: the same bits however steps are divided, and a new history after any change."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from mbd_sim import DivergedError, Ensemble, Simulation
from mbd_sim.compiler.steps.adams_history import COUNT
from mbd_sim.compiler.taylor.step import POSITION

METHODS = ("adams11", "taylor")
TAKEN = {"adams11": COUNT, "taylor": POSITION}  # where the number of steps is that belong to a history
# A loop, a drive and a quaternion. With `adams11` some steps of slider_crank are divided; with `taylor` all but disk_weight
# and simple_pendulum have loops over the order, and the longer steps are divided into several expansions.
RUNS = [
    *(("adams11", name, 1e-3) for name in ("moving_support_pendulum", "heavy_top", "slider_crank")),
    *(("taylor", name, 1e-3) for name in ("moving_support_pendulum", "heavy_top")),
    *(("taylor", name, 0.07) for name in ("disk_weight", "simple_pendulum", "four_bar")),
]


def same(*simulations):
    return len({s.state.tobytes() + s.history.tobytes() for s in simulations}) == 1


@pytest.mark.parametrize(("method", "name", "step"), RUNS)
def test_steps_may_be_divided_in_any_way(method, name, step):
    at_once, singly, divided, copy = (Simulation.from_file(name, method=method, step=step) for _ in range(4))
    at_once.step(400)
    for _ in range(400):
        singly.step()
    for n in (1, 9, 10, 11, 30, 139, 200):
        divided.step(n)
        if divided.steps == 200:
            copy.restore(pickle.loads(pickle.dumps(divided.snapshot())))
            assert same(divided, copy)
            copy.step(200)
    assert same(at_once, singly, divided, copy)
    if method == "taylor":  # whose estimates are those of each expansion
        assert at_once.error_estimate == singly.error_estimate == divided.error_estimate < 1e-14


@pytest.mark.parametrize(
    ("method", "change"),
    [(METHODS[i % 2], change) for i, change in enumerate(("effort", "wrench", "live", "state", "time", "reset"))],
)
def test_any_change_begins_a_new_history(method, change):
    wrenches, live = ["rod"] if change == "wrench" else (), ["gravity[2]"] if change == "live" else ()
    run = Simulation.from_file("rod_pendulum", method=method, wrenches=wrenches, live=live)
    run.step(3)
    assert run.history[TAKEN[method]] == 3
    if change == "effort":
        run.set_efforts([0.1])
    elif change == "wrench":
        run.set_wrench("rod", force=[0.1, 0.0, 0.0])
    elif change == "live":
        run.set_live({"gravity[2]": -9.0})
    elif change == "state":
        run.set_state(positions={"pin": 0.1})
    elif change == "time":
        run.restore(run.state, steps=20, inputs=run.inputs, history=run.history)
    else:
        run.reset()
    other = run.copy()
    other.restore(run.state, steps=run.steps, inputs=run.inputs)  # without a history
    run.step(1)
    other.step(1)
    assert run.history[TAKEN[method]] == other.history[TAKEN[method]] == 1
    assert run.state.tobytes() == other.state.tobytes()


@pytest.mark.parametrize("method", METHODS)
def test_a_command_that_changes_nothing_keeps_the_history(method):
    run, other = (Simulation.from_file("double_rod", method=method) for _ in range(2))
    run.step(50)
    run.set_efforts([0.0, 0.0])
    run.step(50)
    other.step(100)
    assert same(run, other)


@pytest.mark.parametrize("method", METHODS)
def test_a_call_that_fails_leaves_the_history_as_it_was(method):
    """An effort law that ends: the same bits up to there as a run that was never asked for more."""
    text = """
mechanism: ends
parameters: {t_end: 0.0505}
parts: {rod: {mass: 1, center: [0, 0, -1], inertia: [0.1, 0.1, 0.1]}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: 1}}
forces: {law: {type: effort, coordinate: pin, effort: "sqrt(t_end - t)"}}
"""
    run, other = (Simulation.from_text(text, method=method) for _ in range(2))
    run.step(20)
    other.step(40)
    with pytest.raises(DivergedError):
        run.step(100)
    run.step(20)
    assert same(run, other)


@pytest.mark.parametrize(
    ("method", "name"),
    [("taylor", "four_bar"), ("adams11", "slider_crank")],
)
def test_members_of_an_ensemble_take_the_same_steps(method, name):
    ensemble, single = Ensemble.from_file(name, 3, method=method), Simulation.from_file(name, method=method)
    q, u = (np.tile(array, (3, 1)) for array in (single.q, single.u))
    u[1:] *= [[1.5], [4.0]]
    ensemble.reset(q, u)
    snapshot = ensemble.snapshot()
    for begun in (False, True):
        if begun:
            ensemble.restore(snapshot)
        ensemble.step(133)
        ensemble.step(67)
        for member in range(3):
            single.reset(q[member], u[member])
            single.step(200)
            assert single.state.tobytes() == ensemble.state[member].tobytes()
            assert single.error_estimate == ensemble.error_estimates[member]
