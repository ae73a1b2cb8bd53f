"""Numbers of the equations by formulas of the file, against mechanisms that are built with other values."""

import casadi as ca
import numpy as np
import pytest

from mbd_sim import MechanismError, parse_mechanism
from mbd_sim.dynamics.kinematics.parameters import equation_data
from mbd_sim.files.checks.override import with_values
from mbd_sim.studies.optimization.parameter_inputs import parameter_inputs

PRESS = """
mechanism: press
parameters:
  bottom: hypot(crank, high) + 0.3*exp(-spread)
  crank: 1.2*(spread - 0.2)**3 + 0.03*stiff(spread)
  spread: 0.4
  high: ${1000*where(spread > 0.1, atan2(spread, 2), 3)} mm
  heavy: 3 kg
functions: {stiff(x): 2*x + tanh(x)}
parts:
  crank: {mass: heavy, shape: {type: rod, to: [crank, 0, high]}, points: {pin: [crank, 0, bottom]}}
  rod: {mass: 2, shape: {type: rod, to: [bottom, 0, 0]}}
joints:
  motor: {type: revolute, between: [ground, crank], axis: [0, 1, 0]}
  pin: {type: revolute, between: [crank.pin, rod], axis: [0, 1, 0]}
"""


def test_numbers_follow_formulas_of_any_kind():
    """Also in another order than that of the file, with units, functions of the file and a key that is no parameter."""
    mechanism = parse_mechanism(PRESS)
    keys = ("spread", "heavy", "parts.rod.mass")
    inputs = parameter_inputs(mechanism, keys)
    assert inputs.keys == keys and inputs.values.tolist() == [0.4, 3.0, 2.0]
    p = ca.SX.sym("p", 3)
    numbers = ca.Function("numbers", [p], [inputs.numbers_at(p), inputs.point_at("crank", "pin", p)])
    for values in ([0.7, 5.0, 1.0], [0.15, 1.0, 4.0]):
        changed = with_values(mechanism, dict(zip(keys, values, strict=True)))
        found, pin = numbers(ca.DM(values))
        expected = equation_data(changed).free[inputs.numbers.indices]
        assert found.full().ravel()[inputs.numbers.columns] == pytest.approx(expected, rel=1e-13)
        assert pin.full().ravel() == pytest.approx(changed.parts["crank"].points["pin"].position, rel=1e-13)


def test_what_has_no_formula_in_any_parameter_is_refused():
    mechanism = parse_mechanism("""
mechanism: rod
parameters: {spread: 0.4}
parts: {rod: {mass: 3, shape: {type: rod, to: [0.1 + exp(spread), 0, "log(2 + spread)"]}}}
joints: {motor: {type: revolute, between: [ground, rod], axis: [0, 1, 0]}}
""")
    with pytest.raises(MechanismError, match="depends on the inputs by no short formula"):
        parameter_inputs(mechanism, "spread")
    assert np.isfinite(equation_data(mechanism).free).any()
