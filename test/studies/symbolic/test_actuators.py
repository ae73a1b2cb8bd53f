"""The laws of actuators as formulas give the numbers of the compiled equations."""

import numpy as np
import pytest
import sympy as sp

from mbd_sim.cli.main import main
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.studies.algebra.polynomial import too_large
from mbd_sim.studies.symbolic import actuators, linearized, symbolic_equations, to_latex

ARM = """
mechanism: arm
parameters: {{m: 2 kg, l: 0.5 m, gain: 30}}
ground: {{points: {{anchor: [0.3, 0, 0.1]}}}}
parts:
  rod: {{mass: m, shape: {{type: rod, to: [0, 0, -l]}}, points: {{end: [0, 0, -l]}}}}
joints:
  pin: {{type: revolute, between: [ground, rod], axis: [0, -1, 0], position: 0.4}}
actuators:
  drive: {{{actuator}}}
"""
ACTUATORS = {
    "effort": "type: effort, joint: pin, effort_limit: 4 N*m, gear_ratio: 3, rotor_inertia: 0.01",
    "line": "type: effort, between: [ground.anchor, rod.end], effort_limit: 40 N",
    "delayed": "type: effort, joint: pin, delay: 10 ms",
}


SERVO = "type: effort, joint: pin, servo: {controls: position, kp: gain, kd: 2, ki: 5, limit: 6}"


def numbers_of(mechanism, found, t, q, u, held, commands):
    """Accelerations, and rates of states by name, from the formulas."""
    values = {found.time: t} | dict(zip(found.q + found.u, [*q, *u], strict=True))
    values |= dict.fromkeys(found.efforts, 0.0) | {one.symbol: one.value for one in found.parameters}
    for actuator in found.actuators:
        values |= {state.symbol: held[actuator.name, state.name] for state in actuator.states}
        values |= {symbol: commands[actuator.name, channel] for channel, symbol in actuator.commands.items()}
    for actuator in found.actuators:
        values[actuator.effort] = float(actuator.law.subs(values))
    mass, inertial, forces = (
        np.array(sp.Matrix(term).subs(values), dtype=float) for term in (found.mass, found.inertial, found.forces)
    )
    rates = {(a.name, s.name): s.rate for a in found.actuators for s in a.states if s.rate is not None}
    samples = {(a.name, s.name): s.sampled for a in found.actuators for s in a.states if s.sampled is not None}
    return (
        np.linalg.solve(mass, forces - inertial).ravel(),
        {name: float(rate.subs(values)) for name, rate in rates.items()},
        {name: float(sample.subs(values)) for name, sample in samples.items()},
    )


def compare(mechanism, parameters=None):
    """Compare accelerations, rates and samples with the compiled equations at random states."""
    found, engine = symbolic_equations(mechanism, parameters), derive(mechanism)
    layout, random = engine.actuators.layout, np.random.default_rng(2)
    nq, nv = engine.layout.nq, engine.layout.nv
    for _ in range(2):
        t, y, inputs = 0.3, engine.start_state.copy(), engine.inputs_without_commands
        y[: nq + nv] = random.normal(size=nq + nv)
        held, commands = {}, {}
        for actuator, slots in zip(mechanism.actuators, layout.slots, strict=True):
            for channel, index in slots.commands.items():
                commands[actuator.name, channel] = inputs[index] = random.normal(scale=3.0)
                if channel in slots.states:
                    y[slots.states[channel]] = inputs[index]
            for name, index in slots.states.items():
                if name not in slots.commands and name not in slots.energies:
                    held[actuator.name, name] = y[index] = random.normal()
        u_rates, rates, samples = numbers_of(mechanism, found, t, y[:nq], y[nq : nq + nv], held, commands)
        expected = np.array(engine.rates.call([t, y, inputs])[0]).ravel()
        assert np.allclose(u_rates, expected[nq : nq + nv], rtol=1e-10, atol=1e-10)
        places = {a.name: slots.states for a, slots in zip(mechanism.actuators, layout.slots, strict=True)}
        for (actuator, state), rate in rates.items():
            assert rate == pytest.approx(expected[places[actuator][state]], rel=1e-10, abs=1e-9)
        for sampler in engine.actuators.between_steps.samplers:
            new = np.array(sampler.function(t, y, inputs)).ravel()
            for (actuator, state), sample in samples.items():
                if places[actuator][state] in sampler.components:
                    own = new[sampler.components.index(places[actuator][state])]
                    assert sample == pytest.approx(own, rel=1e-10, abs=1e-10)
    return found


@pytest.mark.parametrize("kind", ACTUATORS)
def test_actuators_give_the_compiled_accelerations(kind):
    found = compare(parse_mechanism(ARM.format(actuator=ACTUATORS[kind])))
    assert [actuator.name for actuator in found.actuators] == ["drive"]


def test_a_motor_with_a_sampled_servo():
    found = compare(load_mechanism("motor_drive"))
    states = {state.name: state for state in found.actuators[0].states}
    assert states["current"].rate is not None and states["integral"].sampled is not None
    assert states["output"].period == pytest.approx(1e-3)


def test_gains_that_are_parameters_are_symbols():
    mechanism = parse_mechanism(ARM.format(actuator=SERVO))
    found = compare(mechanism, ["gain", "m"])
    gain = next(one.symbol for one in found.parameters if one.key == "gain")
    assert gain in found.actuators[0].law.free_symbols


def test_the_laws_are_printed(capsys):
    assert main(["check", "motor_drive", "--latex"]) == 0
    text = capsys.readouterr().out
    assert r"= \tau_{\mathrm{shaft}} + f_{\mathrm{drive}}" in text
    assert r"\dot{i}_{\mathrm{drive}} &= 1000\, \min" in text
    assert r"{I_{\mathrm{drive}}}^{+} &= 0.98\, I_{\mathrm{drive}}" in text
    assert r"$I_{\mathrm{drive}}$ its state integral, sampled every 0.001 s" in text


def test_delays_are_stated():
    text = to_latex(symbolic_equations(parse_mechanism(ARM.format(actuator=ACTUATORS["delayed"])), None))
    assert r"$w_{\mathrm{drive,effort}}$ its command of effort, given 0.01 s earlier" in text


def test_laws_that_are_too_long_are_left_out(monkeypatch):
    simplified = actuators.simplified

    def limited(mechanism, algebra, function, inputs):
        if function.name() == "laws":
            raise too_large(mechanism, "there is too much")
        return simplified(mechanism, algebra, function, inputs)

    monkeypatch.setattr(actuators, "simplified", limited)
    found = symbolic_equations(parse_mechanism(ARM.format(actuator=SERVO)), ["m"])
    assert all(actuator.law is None and not actuator.states for actuator in found.actuators)
    assert found.forces[0].has(found.actuators[0].effort)
    assert "too long to be written out" in to_latex(found)


def test_mechanisms_whose_commands_are_delayed_are_not_linearized_as_formulas():
    mechanism = parse_mechanism(ARM.format(actuator=ACTUATORS["delayed"]))
    assert linearized(mechanism, symbolic_equations(mechanism)) is None
