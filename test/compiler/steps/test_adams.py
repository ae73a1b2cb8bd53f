"""Steps of Adams methods: accuracy, and how they begin; see also `test_method_history`."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Ensemble, MechanismError, Simulation
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.steps.adams_history import COUNT, LEVEL, VECTORS
from mbd_sim.compiler.steps.adams_policy import finest_level
from mbd_sim.integrators.explicit import ADAMS

METHOD = "adams11"


def built(name="double_rod", **options):
    return Simulation.from_file(name, method=METHOD, **options)


def test_it_takes_two_evaluations_where_the_motion_is_smooth():
    """Its steps differ from those of `tsitouras8` once there are enough slopes, and have the same accuracy."""
    run, other = built(), Simulation.from_file("double_rod", method="tsitouras8")
    run.step(9)
    other.step(9)
    assert run.state.tobytes() == other.state.tobytes()
    run.step(2)
    other.step(2)
    assert run.state.tobytes() != other.state.tobytes()
    assert run.state == pytest.approx(other.state, abs=1e-14)


def test_it_is_refused_where_it_would_always_begin_anew():
    with pytest.raises(MechanismError, match=f"{METHOD} cannot treat .*sample_rate or a delay.*tsitouras8"):
        built("six_axis_servo_arm")
    assert Simulation.from_file("six_axis_servo_arm").model.method.name == "tsitouras8"


def test_a_member_that_starts_anew_takes_the_steps_of_a_new_run():
    """Wherever in the count of steps that is, also while steps are divided."""
    ensemble, single = Ensemble.from_file("slider_crank", 2, method=METHOD), built("slider_crank")
    ensemble.step(13)
    ensemble.restart([1])
    ensemble.step(300)
    single.step(300)
    assert ensemble.state[1].tobytes() == single.state.tobytes()
    single.step(13)
    assert ensemble.state[0].tobytes() == single.state.tobytes()


def test_steps_are_divided_where_the_motion_is_fast_and_only_there():
    """The piston of a crank at 1 ms: some steps at once, some in halves, and the energy as with `tsitouras8`."""
    run, other = built("slider_crank"), Simulation.from_file("slider_crank", method="tsitouras8")
    levels, residuals = [], np.zeros(2)
    for _ in range(100):
        run.step(10)
        other.step(10)
        levels.append(run.history[LEVEL])
        residuals = np.maximum(residuals, [abs(run.energies.residual), abs(other.energies.residual)])
    assert 10 < np.count_nonzero(levels) < 90
    assert np.count_nonzero(np.diff(levels)) > 4
    assert residuals[0] < residuals[1] + 1e-13 * run.energies.kinetic


def other_steps(run, steps):
    """How many of some steps are those of the other method, which lose the sum of round-off, and the levels of all."""
    first, levels = VECTORS + run.inputs.size + run.state.size, []
    others = 0
    for _ in range(steps):
        run.step()
        levels.append(int(run.history[LEVEL]))
        others += not np.any(run.history[first : first + run.state.size])
    return others, levels


def test_smaller_and_larger_parts_need_no_steps_of_the_other_method():
    """Once there are enough slopes, those in between are interpolated where smaller parts are needed."""
    others, levels = other_steps(built("slider_crank"), 1000)
    assert others < ADAMS[METHOD].length + 3
    assert set(levels) == {0, 1, 2}
    assert levels[-1] < 2


@pytest.mark.parametrize(("name", "finest"), [("snap_through", 0), ("slider_crank", 2)])
def test_steps_with_few_operations_are_not_divided(name, finest):
    """Where two halves take longer than a step of the other method; see `finest_level`."""
    equations = Simulation.from_file(name).model.equations
    instructions = instruction_count(arranged(equations.rates))
    assert finest_level(instructions, len(equations.start_state)) == finest


def test_round_off_does_not_divide_steps():
    """Coordinates of 1000 m, whose round-off in the slopes is a hundred times as large as otherwise."""
    text = """
mechanism: far
parts: {rod: {mass: 1, center: [0, 0, -1], inertia: [0.1, 0.1, 0.1]}, weight: {mass: 1}}
joints:
  rail: {type: prismatic, between: [ground, weight], axis: [1, 0, 0], position: 1000 m, stiffness: 50, rest: 1000 m}
  pin: {type: revolute, between: [weight, rod], axis: [0, 1, 0], position: 1}
"""
    run = Simulation.from_text(text, method=METHOD)
    run.step(3000)
    assert run.history[COUNT] > 100


def test_a_spinning_top_falls_back_and_keeps_the_bits_of_the_other_method():
    """At 150 rad/s no attempt succeeds."""
    run, other = built("heavy_top"), Simulation.from_file("heavy_top", method="tsitouras8")
    run.step(500)
    other.step(500)
    assert run.state.tobytes() == other.state.tobytes()


@pytest.mark.parametrize("name", ["four_bar", "moving_support_pendulum"])
def test_the_energy_account_is_as_accurate_as_with_the_other_method(name):
    """Both residuals are random walks of round-off."""
    residuals = []
    for method in (METHOD, "tsitouras8"):
        run, residual = Simulation.from_file(name, method=method), 0.0
        for _ in range(20):
            run.step(150)
            residual = max(residual, abs(run.energies.residual))
        residuals.append(residual)
    size = run.energies.kinetic + abs(run.energies.potential)
    assert residuals[0] < residuals[1] + 3e-14 * size
