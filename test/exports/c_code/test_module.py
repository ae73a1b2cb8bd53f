"""Exported C code, compiled by gcc, takes the steps of the simulation to the bit."""

import re

import numpy as np
import pytest

from mbd_sim import Ensemble, Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.exports.c_code.model import ALWAYS, export_model
from mbd_sim.exports.c_code.module import c_module
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.exports.c_code.compiled import CompiledModule, compiled
from test.generators.sampled_arm import INTEGRAL, sampled_arm, sampled_drive
from test.generators.two_linkages import two_linkages

STEPS = 400
LIBRARY = {"sin", "cos", "sincos", "floor", "exp", "log", "tan", "asin", "acos", "atan", "atan2", "tanh", "pow", "fma",
           "memcpy", "memset"}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "methods"),
    [
        ("double_rod", ("rosenbrock_w", *ALWAYS)),
        ("four_bar", ("rosenbrock", "rk4")),  # a loop: projection, and stages of ill-conditioned steps
        ("pencil", ("gauss4",)),  # with steps in halves and quarters
        ("rolling_disc", ("adams11",)),  # rolling, and a quaternion
        ("gas_engine", ("rk4",)),  # powers of the C library
    ],
)
def test_steps_have_the_bits_of_the_simulation(name, methods):
    code = compiled(name, method=methods[0])
    for method in methods:
        code.start()
        simulation = Simulation(code.model.mechanism, method=method)
        assert np.array_equal(code.y, simulation.y)
        for index in range(STEPS):
            if index == STEPS // 2 and not simulation.command_map.names:
                effort = 0.3
                code.inputs[0] = effort
                simulation.set_efforts({simulation.model.coordinate_names[0]: effort})
            assert code.step(method, index, simulation.step_size)
            simulation.step()
        assert np.array_equal(code.y, simulation.y), method


def test_delayed_commands_and_sampled_controllers_wait_as_in_the_simulation():
    mechanism = parse_mechanism(sampled_arm("delayed", delay="5 ms", more=INTEGRAL))
    code = CompiledModule(mechanism, method="rosenbrock")
    for method in ("rosenbrock", "rk4"):
        code.start()
        simulation = Simulation(mechanism, method=method)
        for index in range(100):
            if index == 13:
                simulation.set_commands({"drive": 0.4})
                code.inputs[:] = simulation.inputs
            assert code.step(method, index, 1e-3)
            simulation.step()
        assert np.array_equal(code.y, simulation.y), method
        assert simulation.q[0] != 0.0


def test_outputs_are_those_of_the_simulation():
    code = compiled("four_bar", method="adams11")
    code.start()
    simulation = Simulation(code.model.mechanism, method="rk4")
    for index in range(50):
        code.step("rk4", index, simulation.step_size)
        simulation.step()
    outputs = code.outputs(simulation.time)
    assert outputs["kinetic_energy"] == simulation.energies.kinetic
    assert outputs["potential_energy"] == simulation.energies.potential
    points = sorted({name.rpartition(".")[0].rpartition(".")[0] for name in outputs if "." in name})
    assert points
    for point in points:
        there = simulation.point(point)
        position = [outputs[f"{point}.{letter}.position"] for letter in "xyz"]
        velocity = [outputs[f"{point}.{letter}.velocity"] for letter in "xyz"]
        assert np.allclose(position, there.position, rtol=0, atol=1e-15)
        assert np.allclose(velocity, there.velocity, rtol=0, atol=1e-14)
    accelerations = code.rates(simulation.time)[simulation.model.u_range]
    assert np.allclose(accelerations, simulation.u_rates, rtol=1e-13, atol=1e-13)


def double_rod():
    """A module with parameters and a loaded part."""
    return compiled("double_rod", parameters=("l", "m"), wrenches=("lower",))


def test_parameters_change_the_motion_as_in_the_file():
    code = double_rod()
    code.start()
    assert code.p.tolist() == [1.0, 1.0]
    code.p[:] = 0.8, 1.7
    simulation = Simulation(code.model.mechanism, method="rk4", parameters={"l": 0.8, "m": 1.7})
    for index in range(100):
        code.step("rk4", index, simulation.step_size)
        simulation.step()
    assert np.allclose(code.y, simulation.y, rtol=0, atol=1e-13)
    assert code.outputs(0.0)["lower.tip.z.position"] == pytest.approx(
        simulation.point("lower.tip").position[2], abs=1e-13
    )


def test_loops_close_for_changed_parameters_as_in_the_file():
    code = compiled("four_bar", parameters=("crank", "coupler"))
    code.start()
    old = code.y.copy()
    code.p[:] = 0.45, 1.3
    assert code.assemble() == 1
    changed = start_with(code.model.mechanism, crank=0.45, coupler=1.3)
    assert np.max(np.abs(changed - old)) > 0.1
    assert np.allclose(code.y, changed, rtol=0, atol=1e-12)
    code.p[:] = 0.45, 0.1
    before = code.y.copy()
    assert code.assemble() == 0  # too short
    assert np.array_equal(code.y, before)


def start_with(mechanism, **values):
    return derive(with_values(mechanism, values)).start_state


TURNTABLE = """
mechanism: turntable
parameters: {w: 3 rad/s, a: 0.5}
parts:
  table: {mass: 1, inertia: [1, 1, 1]}
  one: {mass: 1, center: [0.3, 0, 0], inertia: [0.01, 0.02, 0.02], points: {tip: [0.6, 0, 0]}}
  two: {mass: 2, center: [0.3, 0, 0], inertia: [0.01, 0.04, 0.04]}
joints:
  spin: {type: revolute, between: [ground, table], axis: [0, 0, 1], drive: w*t}
  a: {type: revolute, between: [table, one], axis: [0, 0, 1], position: a}
  b: {type: revolute, between: [one.tip, two], axis: [0, 0, 1], position: -a}
constraints: {gear: {type: coupling, terms: {a: 1, b: 1}}}
"""


def test_speeds_beside_a_drive_have_the_least_kinetic_energy_as_in_the_simulation_and_for_members_and_drives_are_outputs():
    code = CompiledModule(parse_mechanism(TURNTABLE), parameters=("w", "a"))
    speeds = [(3.0, 0.5), (-7.0, 0.4)]
    members = Ensemble(code.model.mechanism, [{"w": w, "a": a} for w, a in speeds * 9])
    for index, (w, a) in enumerate(speeds):
        code.p[:] = w, a
        assert code.assemble() == 1
        simulation = Simulation(code.model.mechanism, parameters={"w": w, "a": a})
        kinetic = simulation.energies.kinetic
        assert code.y[simulation.model.u_range] == pytest.approx(simulation.u, rel=1e-12, abs=1e-15)
        assert members.u[index] == pytest.approx(simulation.u, rel=1e-12, abs=1e-15)
        drive, outputs = simulation.drives()["spin"], code.outputs(0.0)
        found = [outputs[f"spin.{what}"] for what in ("position", "velocity", "effort")]
        assert np.allclose(found, [drive.position, drive.velocity, drive.force], rtol=1e-14, atol=1e-14)
        for change in (-0.1, 0.1):
            y = simulation.state.copy()
            y[simulation.model.u_range] += [change, -change]
            assert simulation.model.energies(0.0, y).kinetic > kinetic


FLAT = """
mechanism: flat
gravity: [0, 0, 0]
parameters: {w: 3}
ground: {points: {d: [1, 0, 0]}}
parts:
  crank: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
  bar: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  rocker: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
joints:
  main: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 0, velocity: w}
  pin: {type: revolute, between: [crank.tip, bar], axis: [0, -1, 0]}
  other: {type: revolute, between: [ground.d, rocker], axis: [0, -1, 0]}
  eye: {type: revolute, between: [bar.tip, rocker.tip], axis: [0, -1, 0]}
"""


def test_speeds_in_a_singular_configuration_are_those_of_a_branch_and_given_ones_are_kept():
    """A parallelogram lies flat, in the configuration where it may go on as an antiparallelogram as well."""
    code = CompiledModule(parse_mechanism(FLAT), parameters=("w",))
    simulation = Simulation(code.model.mechanism)
    speeds = simulation.model.u_range
    for speed in (13.0 / 7.0, 0.0):
        code.p[:] = speed
        assert code.assemble() == 1
        assert code.y[speeds] == pytest.approx([speed, -speed, speed], rel=1e-12)
    code.start()
    names = [f"{name}.velocity" for name in simulation.coordinate_names]
    places = dict(zip(names, range(speeds.start, speeds.stop), strict=True))
    code.y[places["main.velocity"]], code.y[places["other.velocity"]] = 3.0, -7.0  # (d + r)/(d - r) of the first
    assert code.assemble(["main.velocity", "other.velocity"]) == 1
    simulation.set_state(velocities={"main": 3.0, "other": -7.0})
    assert code.y[speeds] == pytest.approx(simulation.u, rel=1e-12)
    assert simulation.u[0] == 3.0


def test_another_loop_does_not_change_the_branch():
    """A loop that is regular and far faster."""
    text = two_linkages(END=1, LENGTH=0.2, ANGLE=1, LEAN=-0.7, SECOND="30000*w", SPEED="w") + "parameters: {w: 0.001}\n"
    code = CompiledModule(parse_mechanism(text), parameters=("w",))
    speed = 0.002
    code.p[:] = speed
    assert code.assemble() == 1
    expected = start_with(code.model.mechanism, w=speed)[6:12]
    assert expected[:3] == pytest.approx([speed, -speed, speed], rel=1e-12)
    assert code.y[6:12] == pytest.approx(expected, rel=1e-11, abs=1e-11)


STARTS = """
mechanism: starts
parameters: {l: 0.4 m, a: 0.3 rad, b: 0.2, c: 1 rad, v: 2 m/s, w: 1 rad/s}
parts:
  cart: {mass: 1 kg, inertia: [1, 1, 1]}
  arm: {mass: 1 kg, inertia: [0.1, 0.1, 0.1], center: [0, 0, -l/2]}
joints:
  slide: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], position: l*sin(c), velocity: 2*v}
  pin: {type: revolute, between: [cart, arm], axis: [0, 1, 0], position: 2*a, velocity: w*exp(b)}
""" + sampled_drive(delay="3 ms", more=INTEGRAL)


def test_start_values_follow_from_formulas_or_say_that_there_is_none():
    mechanism = parse_mechanism(STARTS)
    code = CompiledModule(mechanism, parameters=("l", "a", "b", "v"), wrenches=("arm",))
    code.p[:] = 0.5, 0.4, 0.2, 1.5
    assert code.assemble() == 1
    changed = Simulation(mechanism, parameters={"l": 0.5, "a": 0.4, "v": 1.5}, wrenches=("arm",))
    assert changed.q[1] == 0.8
    assert np.allclose(code.y, changed.y, rtol=0, atol=1e-13)  # with what the servo holds, and the delayed commands
    count = len(code.inputs)
    assert np.allclose(code.inputs, changed.inputs[:count], rtol=0, atol=1e-13)
    assert 0.8 in code.inputs.tolist()  # the position that the servo holds
    code.p[2] = 0.3
    assert code.assemble() == -2
    assert "pin.velocity depends on b" in code.unknown_start()


def test_wrenches_act_on_parts():
    code = double_rod()
    code.start()
    simulation = Simulation(code.model.mechanism, method="rk4", wrenches=["lower"])
    simulation.set_wrench("lower", force=[3.0, 0.0, 1.0])
    names = [variable.field for variable in code.model.inputs]
    code.inputs[names.index("wrench_lower_force_x")], code.inputs[names.index("wrench_lower_force_z")] = 3.0, 1.0
    for index in range(50):
        code.step("rk4", index, simulation.step_size)
        simulation.step()
    assert np.allclose(code.y, simulation.y, rtol=0, atol=1e-13)


def test_the_module_needs_nothing_but_the_library_of_mathematics():
    needed = set(re.findall(r"^ +U (\w+)", compiled("gas_engine", method="rk4").symbols.stdout, re.MULTILINE))
    assert needed
    assert needed <= LIBRARY


def test_a_state_that_would_not_stay_finite_is_kept():
    code = double_rod()
    code.start()
    code.inputs[0] = 1e308
    before = code.y.copy()
    results = [code.step("rk4", index, 1e3) for index in range(3)]
    assert results == [0, 0, 0]
    assert np.array_equal(code.y, before)


def test_the_text_is_the_same_each_time_and_says_how_it_was_made():
    mechanism = load_mechanism("double_rod")
    model = export_model(mechanism)
    first, second = c_module(model), c_module(export_model(mechanism))
    assert first == second
    assert model.hash in first["double_rod.c"]


def test_names_become_distinct_identifiers_and_comments_stay_comments():
    text = """
mechanism: Math
description: A text */ that would end a comment.
parameters: {double: 2 kg}
parts:
  a: {mass: double, inertia: [1, 1, 1]}
  b: {mass: 1 kg, inertia: [1, 1, 1]}
joints:
  pin_x: {type: revolute, between: [ground, a], axis: [0, 1, 0]}
  pin: {type: planar, between: [a, b], axis: [0, 1, 0]}
"""
    code = CompiledModule(parse_mechanism(text), parameters=("double",))
    assert [variable.field for variable in code.model.states[:2]] == ["q_pin_x", "q_pin_x_2"]
    assert code.p.tolist() == [2.0]
    assert set(code.files) == {"math_mechanism.h", "math_mechanism.c"}


def test_one_sided_elements_are_refused_with_the_reason():
    with pytest.raises(MechanismError, match=r"events.*joints\.slide\.limits.*compliant"):
        export_model(load_mechanism("stops"))


def test_methods_of_series_are_refused():
    with pytest.raises(MechanismError, match=r"taylor cannot be exported.*tsitouras8"):
        export_model(load_mechanism("double_rod"), method="taylor")
