"""Arithmetic in values: its results, and what it refuses."""

import math

import pytest

from mbd_sim.base.errors import InputError
from mbd_sim.mechanism.values.expression import evaluate, names_in, tables_in


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2", 2.0),
        (" .5 ", 0.5),
        ("1e-3*l", 0.0015),
        ("1e3*l", 1500.0),
        ("l/2", 0.75),
        ("-l", -1.5),
        ("+l - -1", 2.5),
        ("2 + 3*4", 14.0),
        ("(2 + 3)*4", 20.0),
        ("2**3**2", 512.0),
        ("2^3", 8.0),
        ("-2**2", -4.0),
        ("m*l^2/12", 2 * 2.25 / 12),
        ("2*pi", 6.283185307179586),
        ("e", 2.718281828459045),
        ("sqrt(2)", 1.4142135623730951),
        ("exp(1)", 2.718281828459045),
        ("log(8)/log(2)", 3.0),
        ("abs(-3)", 3.0),
        ("sin(pi/6)", 0.5),
        ("cos(pi/3)", 0.5),
        ("tan(pi/4)", 1.0),
        ("asin(1)*2", math.pi),
        ("acos(0)*2", math.pi),
        ("atan(1)*4", math.pi),
        ("atan2(1, -1)", 0.75 * math.pi),
        ("min(l, m)", 1.5),
        ("max(l, m)", 2.0),
        ("hypot(3, 4)", 5.0),
    ],
)
def test_an_expression_has_the_value_of_its_arithmetic(text, value):
    assert evaluate(text, {"l": 1.5, "m": 2.0}) == pytest.approx(value, rel=1e-15, abs=1e-15)


def test_a_name_of_the_file_hides_a_constant():
    assert evaluate("2*e", {"e": 10.0}) == 20.0


def test_names_are_found_without_functions_and_constants():
    assert names_in("sin(a)*pi + b/a - 3") == {"a", "b"}


@pytest.mark.parametrize(
    ("text", "message", "remedy"),
    [
        ("lenght/2", "unknown name 'lenght'", "Did you mean 'length'?"),
        ("sine(1)", "unknown function 'sine'", "Did you mean 'sin'?"),
        ("length(2)", "'length' is not a function", "To multiply, write length*(...)."),
        ("min(1)", "min() takes 2 values, not 1", "Write min(a, b)."),
        ("sin(1, 2)", "sin() takes 1 value, not 2", "Write sin(a)."),
        ("1/(2-2)", "division by zero", "Check the divisor."),
        ("1,5", "not a number, a value with a unit, or an expression", "Write decimals with a point."),
        ("sqrt(-1)", "has no finite value", "Check the numbers in it."),
        ("1e308*10", "has no finite value", "Check the numbers in it."),
        ("10**400", "has no finite value", "Check the numbers in it."),
        ("9**9**9**9", "has no finite value", "Check the numbers in it."),
        ("(-8)**0.5", "has no finite value", "Check the numbers in it."),
        ("9" * 400, "has no finite value", "Check the numbers in it."),
        ("1+" * 2500 + "1", "is longer than 5000 characters", "Split it into parameters."),
    ],
)
def test_what_has_no_value_is_refused_with_a_remedy(text, message, remedy):
    with pytest.raises(InputError) as caught:
        evaluate(text, {"length": 1.0})
    assert caught.value.message == message
    assert caught.value.remedy.startswith(remedy)


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "()",
        "(1",
        "1 +",
        "1 2",
        "1 if 2 else 3",
        "1if 2else 3",
        "a.b",
        "a[0]",
        "[1]",
        "{1}",
        "(1, 2)",
        "'1'",
        '"\\d"',
        "f'{a}'",
        "b'1'",
        "lambda: 1",
        "(a:=2)",
        "a = 2",
        "a; a",
        "a\x00",
        "1_000",
        "0x10",
        "1j",
        "True",
        "None",
        "...",
        "not a",
        "a and a",
        "a < 1",
        "a // 2",
        "a % 2",
        "a @ a",
        "~a",
        "*a",
        "sin(x=1)",
        "sin",
        "__import__('os')",
        "__import__(os)",
        "().__class__.__bases__",
        "exec(a)",
        "yield",
        "await a",
        "٣",
        "½",
        "a\u200b",
    ],
)
def test_what_is_not_arithmetic_is_refused(text):
    with pytest.raises(InputError):
        evaluate(text, {"a": 1.0})


def test_an_expression_is_never_run_as_code(tmp_path):
    target = tmp_path / "made"
    with pytest.raises(InputError):
        evaluate(f"open({str(target)!r}, 'w')", {})
    assert not target.exists()


@pytest.mark.parametrize("text", ["-" * 499 + "1", "(" * 249 + "1" + ")" * 249, "1" + "+1" * 249, "sin(" * 124 + "1"])
def test_deep_nesting_gives_a_value_or_an_error(text):
    try:
        assert math.isfinite(evaluate(text, {}))
    except InputError as error:
        assert str(error)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("where(l > 1, l, 0)", 1.5),
        ("where(l <= 1, l, 7)", 7.0),
        ("where(1 < l <= 1.5, 1, 0)", 1.0),
        ("where(l > 2 or m >= 2, 1, 0)", 1.0),
        ("where(l > 2 and sqrt(1 - l) > 0, 1, 0)", 0.0),
        ("where(not l > 2, 1, 0)", 1.0),
        ("where(l > 0, sqrt(l - 1.25), sqrt(-l))", 0.5),
        ("where(l > 2, 1, where(l > 1, 2, 3))", 2.0),
        ("sign(-l) + sign(0)", -1.0),
        ("clip(l, 2, 3) + clip(l, 0, 1) + clip(l, 1, 2)", 4.5),
        ("floor(-l) + mod(-0.5, 2)", -0.5),
        ("tanh(1)", math.tanh(1)),
    ],
)
def test_branches_and_bounded_functions(text, value):
    assert evaluate(text, {"l": 1.5, "m": 2.0}) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("l > 1", "a comparison stands where a number is expected. Use it as a condition: where(x > 0, a, b)."),
        ("where(l, 1, 2)", "a condition must be a comparison"),
        ("where(l > 1, 2)", "where() takes 3 values, not 2. Write where(condition, a, b)."),
        ("where(l == 1, 1, 2)", "not a number, a value with a unit, or an expression"),
        ("table(map, l)", "there is no table 'map'"),
        ("table()", "table() needs the name of a table"),
        ("clip(l, 1)", "clip() takes 3 values, not 2. Write clip(a, b, c)."),
        ("1 if l else 2", "only numbers, names"),
    ],
)
def test_wrong_conditions_are_explained(text, message):
    with pytest.raises(InputError) as caught:
        evaluate(text, {"l": 1.5})
    assert message in str(caught.value)


def test_names_with_points_are_one_name_and_tables_are_none():
    text = "crank.velocity*table(gas, crank) + where(not a < b.x, 1, 2)"
    assert names_in(text) == {"crank.velocity", "crank", "a", "b.x"}
    assert tables_in(text) == {"gas"}
