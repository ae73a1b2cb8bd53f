"""The method that is chosen for a mechanism by its rates, and what is said about it."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest

from mbd_sim import Ensemble, Simulation
from mbd_sim.base.errors import DivergedError, MechanismError
from mbd_sim.cli.runs.run import simulate
from mbd_sim.dynamics import joint_linearization
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.simulation.model import method_choice
from mbd_sim.simulation.model.builder import partial_system
from mbd_sim.simulation.model.method_choice import choose_method, fastest_mode, is_slower
from test.simulation.run.test_advice import RIGID, STIFF

# The inertia of the finger is that of a bead; its friction and damping are those of a gear motor, as in many URDFs.
FINGER = """<robot name="finger">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tip"><inertial><mass value="0.001"/>
    <inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="1"/><dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="knuckle" type="continuous"><origin xyz="0.4 0 0"/><parent link="arm"/><child link="tip"/>
    <axis xyz="0 1 0"/><dynamics damping="0.05" friction="0.3"/></joint>
</robot>"""


def finger(**options):
    return Simulation(parse_mechanism(FINGER, "finger.urdf"), **options)


def test_a_robot_with_friction_on_tiny_inertias_runs_as_it_comes():
    simulation = finger()
    assert simulation.model.method.name == "rosenbrock_w"
    simulation.run(until=2.0)
    energies = simulation.energies
    assert np.all(np.isfinite(simulation.state))
    assert abs(energies.residual) < 1e-5 * energies.dissipated
    with pytest.raises(DivergedError):
        finger(method="tsitouras8").run(until=0.2)


def test_the_choice_is_explained():
    remark, limits = finger().remarks
    assert re.match(
        r"method rosenbrock_w is used: knuckle has rates of 3e\+10/s, and with steps of 0.001 s adams11, the "
        r"default, is used only up to 1.4e\+03/s.",
        remark,
    )
    assert limits.startswith(
        "the limits of 'shoulder' do not act on the motion. To make all of them stops: --limits stops;"
    )
    assert f"note             {remark}" in simulate(finger(), 0.01, quiet=True)


def test_an_explicit_choice_is_kept_with_a_warning():
    simulation = finger(method="rk4")
    assert simulation.model.method.name == "rk4"
    assert "method rk4 is stable up to 2.8e+03/s. Use method rosenbrock or auto." in simulation.remarks[0]
    written = parse_mechanism(STIFF.replace("parts:", "integrator: {method: tsitouras8}\nparts:", 1))
    assert Simulation(written).model.method.name == "tsitouras8"
    assert Simulation(written, method="auto").model.method.name == "rosenbrock_w"


def test_one_sided_elements_are_not_told_to_use_a_method_that_refuses_them():
    """Before, a method chosen by the user was answered with 'Use method rosenbrock', which cannot treat stops."""
    stops = STIFF.replace("damping: 1e4", "damping: 1e4, limits: {lower: -2, upper: 2, restitution: 0}", 1)
    for method, named in ((None, "adams11"), ("rk4", "rk4")):
        remark = Simulation(parse_mechanism(stops), method=method).remarks[0]
        assert f"with method {named}; methods for stiff mechanisms do not treat one-sided elements" in remark
        assert "Use steps of" in remark and "rosenbrock" not in remark


def test_the_step_counts():
    assert finger(step=1e-11).model.method.name == "adams11"
    assert Ensemble(parse_mechanism(STIFF), 2).model.method.name == "rosenbrock_w"


def test_stiffness_outside_joints_takes_the_exact_jacobian():
    between = STIFF.replace("position: 1, rest: 1, stiffness: 1e7, damping: 1e4", "position: 1")
    spring = "forces: {s: {type: spring, between: [ground, grain], stiffness: 1e7, damping: 1e4, length: 1}}\n"
    simulation = Simulation.from_text(between + spring)
    assert simulation.model.method.name == "rosenbrock"


def test_friction_counts_that_acts_only_near_rest(tmp_path):
    """At 5 rad/s the slope of the regularized friction is zero; it is 3e10/s at rest."""
    (tmp_path / "finger.urdf").write_text(FINGER, encoding="utf-8")
    moving = "urdf: finger.urdf\njoints: {knuckle: {damping: 0, velocity: 5}, shoulder: {friction: }}\n"
    mechanism = parse_mechanism(moving, str(tmp_path / "moving.yaml"))
    assert Simulation(mechanism).model.method.name == "rosenbrock_w"


def test_other_mechanisms_keep_the_default_without_a_remark():
    simulation = Simulation.from_text(RIGID)
    assert (simulation.model.method.name, simulation.remarks) == ("adams11", ())


def test_rates_that_cost_nothing_are_not_saved_by_a_history():
    """The rates of a disk under a torque are two operations; those of a pendulum three, of which one is a sine."""
    found = [
        Simulation.from_file(name, method=method).model.method.name
        for name, method in (("disk_driven", "auto"), ("disk_driven", "adams11"), ("simple_pendulum", "auto"))
    ]
    assert found == ["tsitouras8", "adams11", "adams11"]


def test_an_unknown_method_is_refused_with_the_nearest():
    with pytest.raises(MechanismError, match=r"there is no method 'rosenbrok'.*rosenbrock"):
        Simulation.from_text(RIGID, method="rosenbrok")


@pytest.mark.parametrize("name", ["double_rod", "four_bar", "spring_chain", "motor_arm"])
def test_the_bound_of_rates_agrees_with_eigenvalues(name):
    equations = derive(load_mechanism(name))
    at = equations, 0.0, equations.start_state, equations.inputs_without_commands
    rate = fastest_mode(*at).rate
    assert is_slower(*at, 1.3 * rate)
    assert not is_slower(*at, 0.999 * rate)


@pytest.mark.parametrize(("method", "count"), [("auto", 1), ("rosenbrock", 0)])
def test_the_linear_system_of_the_joints_is_traced_once_for_the_method_that_solves_it(monkeypatch, method, count):
    """Not also in order to choose the method: for a humanoid that takes 0.35 s."""
    equations, traced = derive(parse_mechanism(FINGER, "finger.urdf")), []
    tracing = joint_linearization._partial_system
    monkeypatch.setattr(joint_linearization, "_partial_system", lambda *given: traced.append(given) or tracing(*given))
    choice = choose_method(equations.mechanism, equations, equations.inputs_without_commands, method, 1e-3)
    assert traced == []
    for _ in range(2):
        partial_system(equations, choice.method)
    assert len(traced) == count


@pytest.mark.parametrize("name", ["double_rod", "four_bar", "motor_arm"])
def test_differences_are_the_derivatives_of_the_rates(name):
    equations = derive(load_mechanism(name))
    y, inputs, core = equations.start_state, np.zeros(equations.rates.size1_in(2)), equations.core.stop
    at = ca.SX.sym("y", len(y))
    slopes = ca.Function("slopes", [at], [ca.jacobian(equations.rates.call([0.0, at, inputs])[0], at)])
    expected = np.array(ca.DM(slopes(y)))[:core, :core]
    found = method_choice._jacobian(equations, 0.0, y, inputs)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * np.max(np.abs(expected)))
