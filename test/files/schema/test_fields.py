"""Values with units: conversion factors from their definitions, and what is refused."""

import math

import pytest

from mbd_sim.base.errors import InputError
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.text import units
from mbd_sim.files.text.units import parse_value, split_unit
from test.generators.mechanism_texts import changed, part_of, problem_of

FOOT, POUND, GRAVITY = 0.3048, 0.45359237, 9.80665  # their legal definitions, in SI


@pytest.mark.parametrize(
    ("text", "si_unit", "value"),
    [
        ("1 m", "m", 1.0),
        ("12 in", "m", FOOT),
        ("12 inches", "m", FOOT),
        ("2 ft", "m", 2 * FOOT),
        ("6 feet", "m", 6 * FOOT),
        ("1 yd", "m", 3 * FOOT),
        ("1 mile", "m", 5280 * FOOT),
        ("5 mm", "m", 0.005),
        ("5mm", "m", 0.005),
        ("-2.5e1 cm", "m", -0.25),
        ("3 µm", "m", 3e-6),
        ("3 km", "m", 3000.0),
        ("40 lb", "kg", 40 * POUND),
        ("16 oz", "kg", POUND),
        ("250 g", "kg", 0.25),
        ("2 t", "kg", 2000.0),
        ("1 slug", "kg", POUND * GRAVITY / FOOT),
        ("30 deg", "rad", math.pi / 6),
        ("30°", "rad", math.pi / 6),
        ("0.5 turn", "rad", math.pi),
        ("2 rad", "rad", 2.0),
        ("60 rpm", "rad/s", 2 * math.pi),
        ("90 deg/s", "rad/s", math.pi / 2),
        ("36 km/h", "m/s", 10.0),
        ("1 g0", "m/s**2", GRAVITY),
        ("5 ms", "s", 0.005),
        ("2 min", "s", 120.0),
        ("10 lbf", "N", 10 * POUND * GRAVITY),
        ("3 kN", "N", 3000.0),
        ("1 N/mm", "N/m", 1000.0),
        ("2 N*m/deg", "N*m/rad", 360 / math.pi),
        ("2 N·m/rad", "N*m/rad", 2.0),
        ("1 lbf*ft", "N*m", POUND * GRAVITY * FOOT),
        ("3 N*s/m", "N*s/m", 3.0),
        ("3 N/(m/s)", "N*s/m", 3.0),
        ("2 kg m^2", "kg*m**2", 2.0),
        ("2 kg·m²", "kg*m**2", 2.0),
        ("5 g*cm**2", "kg*m**2", 5e-7),
        ("7.85 g/cm**3", "kg/m**3", 7850.0),
        ("1 kg*m**-3", "kg/m**3", 1.0),
        ("50 %", "", 0.5),
        ("0.25", "m", 0.25),
        ("−2 m", "m", -2.0),
        ("3\u00a0mm", "m", 0.003),
    ],
)
def test_a_value_with_a_unit_is_converted_to_si(text, si_unit, value):
    assert parse_value(text, {}, si_unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("${l/2}", 3.0),
        ("${l/2} mm", 0.003),
        ("${l}", 6.0),
        ("-${l}", -6.0),
        ("${l}/2 + 1", 4.0),
        ("${l - 1}*${l}", 30.0),
        ("2*${l} mm", 0.012),
        ("${ 12 } in", FOOT),
        ("l/2", 3.0),
        ("2 * l", 12.0),
        ("2×l", 12.0),
        ("1e-3*l", 0.006),
    ],
)
def test_arithmetic_is_bare_or_in_braces_and_may_have_a_unit(text, value):
    assert parse_value(text, {"l": 6.0}, "m") == pytest.approx(value, rel=1e-15)


def test_the_unit_is_split_from_the_expression():
    assert split_unit("30 deg") == ("30", "deg")
    assert split_unit("1e3 N*m/rad ") == ("1e3", "N*m/rad")
    assert split_unit("l/2") == ("l/2", "")


@pytest.mark.parametrize(
    ("text", "message", "remedy"),
    [
        ("5 m", "the unit 'm' does not fit: a value in kg is expected here", "Write for example 0.5 kg."),
        ("5 kgs", "unknown unit 'kgs'", "Did you mean 'kg'?"),
        ("5 Kg", "unknown unit 'Kg'", "Did you mean 'kg'?"),
        ("5 Nm", "unknown unit 'Nm'", "Did you mean 'N*m'?"),
        ("5 kgg", "unknown unit 'kgg'", "Did you mean 'kg'?"),
        ("5 mmm", "unknown unit 'mmm'", "Did you mean 'mm'?"),
        ("5 furlong", "unknown unit 'furlong'", "Known: m, mm, in"),
        ("2l", "unknown unit 'l'", "To multiply by the parameter, write 2*l."),
        ("2*l kg", "not a number, a value with a unit, or an expression", "Put the arithmetic before a unit in braces"),
        ("5 kg**0.5", "the power of a unit must be a whole number up to 9", "Write for example m**2."),
        ("5 m**999999999", "the power of a unit must be a whole number up to 9", "Write for example m**2."),
        ("3 kg^1e9", "the power of a unit must be a whole number up to 9", "Write for example m**2."),
        ("3 kg**kg", "the power of a unit must be a whole number up to 9", "Write for example m**2."),
        ("1 " + "m*" * 300 + "m", "is longer than 500 characters", "Split it into parameters."),
        ("1 " + "kg*" * 30 + "kg", "unknown unit 'kg*kg*kg*kg*kg", "Known: m, mm, in"),
        ("1 kg/0", "unknown unit 'kg/0'", "Known: m, mm, in"),
        ("1 kg()", "unknown unit 'kg()'", "Known: m, mm, in"),
        ("1 kg - 1", "unknown unit 'kg - 1'", "Known: m, mm, in"),
        ("1 m*(Gm**9)**9", "the unit 'm*(Gm**9)**9' is too large", ""),
    ],
)
def test_a_unit_that_cannot_be_used_is_refused_with_a_remedy(text, message, remedy):
    si_unit = None if "Gm" in text else "kg"
    with pytest.raises(InputError) as caught:
        parse_value(text, {"l": 1.0}, si_unit)
    assert caught.value.message.startswith(message)
    assert caught.value.remedy.startswith(remedy)


@pytest.mark.parametrize("value", [None, True, [1.0], {"a": 1}, math.nan, math.inf, -math.inf, "1e999"])
def test_what_is_no_finite_number_is_refused(value):
    with pytest.raises(InputError):
        parse_value(value, {}, "m")


def test_every_field_takes_units_of_its_kind():
    mechanism = parse_mechanism(
        """
        mechanism: units
        gravity: [0, 0, -1 g0]
        integrator: {step: 2 ms}
        parts:
          cart: {mass: 500 g, center: [1 cm, 0, 0], inertia: [1 g*m**2, 1 g*m**2, 1 g*m**2]}
          arm: {shape: {type: block, size: [10 cm, 1 ft, 1 in], density: 2 g/cm**3}}
        joints:
          rail:
            {type: prismatic, between: [ground, cart], axis: [1, 0, 0], position: 3 in, velocity: 36 km/h, rest: 1 mm,
             stiffness: 2 N/mm, damping: 3 N*s/m, effort_limit: 1 kN, limits: {lower: -1 ft, upper: 1 ft}}
          hinge:
            {type: revolute, between: [cart, arm], axis: [0, 1, 0], position: 30 deg, velocity: 60 rpm, rest: 0.5 turn,
             stiffness: 2 N*m/deg, damping: 4 N*m*s/rad, effort_limit: 5 N*m,
             limits: {lower: -90 deg, upper: 90 deg, stiffness: 1 N*m/rad}}
        """
    )
    assert mechanism.gravity.tolist() == [0.0, 0.0, -GRAVITY]
    assert mechanism.step == 0.002
    cart, rail, hinge = mechanism.parts["cart"], mechanism.joints["rail"], mechanism.joints["hinge"]
    assert (cart.mass, cart.center[0], cart.inertia[0, 0]) == (0.5, 0.01, 0.001)
    assert mechanism.parts["arm"].mass == pytest.approx(2000 * 0.1 * FOOT * FOOT / 12)
    assert [*rail.position, *rail.velocity, rail.rest] == pytest.approx([0.0762, 10.0, 0.001])
    assert [rail.stiffness, rail.damping, rail.effort_limit] == pytest.approx([2000.0, 3.0, 1000.0])
    assert (rail.limits[0].lower, rail.limits[0].upper) == pytest.approx((-FOOT, FOOT)) and rail.limits[
        0
    ].stiffness is None
    assert [*hinge.position, *hinge.velocity, hinge.rest] == pytest.approx([math.pi / 6, 2 * math.pi, math.pi])
    assert [hinge.stiffness, hinge.damping, hinge.effort_limit] == pytest.approx([360 / math.pi, 4.0, 5.0])
    assert hinge.limits[0].upper == pytest.approx(math.pi / 2) and hinge.limits[0].stiffness == 1.0


def test_a_parameter_holds_si_and_may_use_others_in_any_order():
    mechanism = parse_mechanism(changed(("  l: 1.5 m\n", "  l: ${2*half} in\n  half: 6\n  w: 2 lbf\n  d: 30 deg\n")))
    assert mechanism.parameters == pytest.approx(
        {"m": 2.0, "l": FOOT, "half": 6.0, "w": 2 * POUND * GRAVITY, "d": math.pi / 6}
    )
    assert mechanism.parts["rod"].points["tip"].position.tolist() == pytest.approx([0.0, 0.0, -FOOT])


@pytest.mark.parametrize("value", ["1e41", "-1e300", "${10**39*20}"])
def test_values_that_would_overflow_in_products_are_refused(value):
    problem = problem_of(changed(("[0, -1, 0]", f'[0, "{value}", 0]')))
    assert (problem.line, problem.key) == (14, "joints.pin.axis[1]")
    assert "too large to compute with" in problem.message and problem.remedy == "Check its unit and its power of ten."


def test_values_that_would_vanish_in_products_are_zero_or_refused_where_zero_is():
    assert part_of("{mass: 1, center: [1e-61, -1e-320, 1e-60]}").center.tolist() == [0.0, 0.0, 1e-60]
    problem = problem_of(changed(("type: rod, to: [0, 0, -l]", "type: disc, radius: 1e-61")))
    assert (problem.line, problem.key) == (8, "parts.rod.shape.radius")
    assert "too small to compute with" in problem.message and problem.remedy == "Check its unit and its power of ten."


@pytest.mark.parametrize("size", ["1e-60", "1e40"])
def test_the_largest_and_smallest_values_give_finite_inertias(size):
    for shape in (
        f"{{type: sphere, radius: {size}, density: {size}}}",
        f"{{type: cylinder, radius: {size}, length: {size}, density: 1}}",
        f"{{type: block, size: [{size}, {size}, {size}], density: 1}}",
        f"{{type: rod, to: [{size}, 0, 0], mass: 1e40}}",
    ):
        part = part_of(f"{{shapes: [{shape}, {{type: particle, mass: 1, at: [{size}, 1, 1]}}]}}")
        assert all(math.isfinite(x) for x in [part.mass, *part.center, *part.inertia.flat])


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("deg", math.pi / 180.0),
        ("rpm", math.pi / 30.0),
        ("cm**3", 1.0000000000000002e-06),
        ("L/min", 1e-3 / 60.0),
        ("lbf", 4.4482216152605),
        ("oz", 0.028349523125),
        ("psi", 6894.757293168362),
        ("slug", 14.593902937206364),
        ("kg/cm**3", 999999.9999999999),
        ("lb*ft**2", 0.0421401100938048),
        ("N*m/deg", 57.29577951308232),
    ],
)
def test_factors_keep_the_bits_on_which_recordings_depend(unit, factor):
    assert units.si_factor(unit) == factor


def test_a_unit_of_another_dimension_is_refused():
    with pytest.raises(InputError, match="the unit 'cm' does not fit: a value in kg is expected here"):
        parse_value("3 cm", {}, "kg")
