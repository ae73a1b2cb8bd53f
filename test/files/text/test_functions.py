"""Named functions of a file: where they can be called, what they become, and their problems."""

import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import parse_mechanism

FILE = """mechanism: file
parameters: {l: 1, s: 0.1, w: 3, a: taper(2)}
functions:
  taper(x): 1 - x/10
  stroke(t, phase): l + s*sin(w*t + phase)
  both(t): stroke(t, 1) + stroke(2*t, a)
  tilt(t): ${30*sin(t)} deg
parts: {rod: {mass: taper(3), center: [0, 0, -1]}, top: {mass: 1}}
joints:
  rail: {type: prismatic, between: [ground, rod], axis: [0, 0, 1], drive: both(t) - 1}
  pin: {type: revolute, between: [rod, top], axis: [0, 0, 1], drive: tilt(t)}
"""
PLAIN = """mechanism: file
parameters: {l: 1, s: 0.1, w: 3, a: 0.8}
parts: {rod: {mass: 0.7, center: [0, 0, -1]}, top: {mass: 1}}
joints:
  rail: {type: prismatic, between: [ground, rod], axis: [0, 0, 1], drive: l + s*sin(w*t + 1) + (l + s*sin(w*(2*t) + a)) - 1}
  pin: {type: revolute, between: [rod, top], axis: [0, 0, 1], drive: "${30*sin(t)} deg"}
"""


def test_a_call_is_the_same_as_the_body_in_its_place():
    file, plain = parse_mechanism(FILE), parse_mechanism(PLAIN)
    assert file.parameters == plain.parameters and file.parts["rod"].mass == plain.parts["rod"].mass
    for time in (0.0, 0.3, 2.0):
        for joint in ("rail", "pin"):
            assert file.joints[joint].drive[0].at(time) == plain.joints[joint].drive[0].at(time)


def test_parameters_in_functions_can_be_live_and_functions_can_be_replaced():
    sim = Simulation(parse_mechanism(FILE), live=["s"])
    sim.set_live({"s": 0.0})
    assert sim.drives()["rail"].position == pytest.approx(1.0)
    other = with_values(parse_mechanism(FILE), {"functions.taper(x)": "x"})
    assert other.parts["rod"].mass == 3.0 and other.parameters["a"] == 2.0


@pytest.mark.parametrize(
    "old, new, problem",
    [
        ("both(t) - 1", "bothe(t)", "10: joints.rail.drive: unknown function 'bothe' (got 'bothe(t)'). Did you mean 'both'? "),
        ("both(t) - 1", "stroke(t)", "10: joints.rail.drive: stroke() takes 2 values, not 1 (got 'stroke(t)'). Write stroke(t, phase)."),
        ("l + s", "q + s", "5: functions.'stroke(t, phase)': unknown name 'q' (got 'q + s*sin(w*t + phase)'). "
         "Valid: a, l, phase, s, t, w. Or make it an argument: stroke(t, phase, q)."),
        ("1 - x/10", "later(x)\n  later(x): taper(x)", "4: functions.'taper(x)': functions call each other in a circle: taper, later"),
        ("taper(x)", "taper", "4: functions.taper: not of the form name(argument, …) (got '1 - x/10'). Write for example 'stroke(t): "),
        ("tilt(t)", "tilt(l)", "7: functions.'tilt(l)': 'l' is also a parameter"),
        ("tilt(t)", "sin(t)", "7: functions.'sin(t)': 'sin' is reserved in expressions"),
        ("1 - x/10", "1 -", "4: functions.'taper(x)': not a number, a value with a unit, or an expression (got '1 -')."),
        ("1 - x/10", "[x]", "4: functions.'taper(x)': must be an expression"),
    ],
)  # fmt: skip
def test_problems_are_reported_once_where_they_are(old, new, problem):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(FILE.replace(old, new), "file.yaml")
    assert str(caught.value.problems[0]).startswith(f"file.yaml:{problem}")
    assert all("taper" in p.key or "later" in p.key for p in caught.value.problems[1:])


def test_functions_that_grow_without_bound_are_refused():
    doubling = "".join(f"  f{i}(x): f{i - 1}(f{i - 1}(x)) + f{i - 1}(x)\n" for i in range(1, 60))
    body = "parts: {a: {mass: f59(1)}}\njoints: {j: {type: fixed, between: [ground, a]}}\n"
    with pytest.raises(MechanismError, match="is too long after its functions are inserted"):
        parse_mechanism(f"mechanism: large\nfunctions:\n  f0(x): x + x\n{doubling}{body}")
