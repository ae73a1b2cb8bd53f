"""YAML text to data with lines: what is read, and what is refused before it can do harm."""

import functools
import math
import time

import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.text.yaml_text import parse_source
from mbd_sim.mechanism.values.source import dotted
from test.generators.mechanism_texts import PENDULUM, changed, problem_of, problems_of


@functools.cache
def reference_time():
    """The processor time in s that it takes to read a text of 100,000 characters."""
    text = "a: [" + "1.5, " * 20_000 + "]"
    start = time.process_time()
    parse_source(text)
    return time.process_time() - start


def refusal(text):
    """The only problem of a text that cannot be read, found at once: backtracking would take minutes."""
    longest = 30.0 * reference_time()
    start = time.process_time()
    with pytest.raises(MechanismError) as caught:
        parse_source(text, "file.yaml")
    assert time.process_time() - start < longest
    (problem,) = caught.value.problems
    assert problem.file == "file.yaml" and problem.remedy
    return problem


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3), ("-3", -3), ("+3", 3), ("010", 10), ("3.5", 3.5), (".5", 0.5), ("5.", 5.0), ("1e3", 1000.0),
        ("1E-3", 0.001), ("true", True), ("False", False), ("null", None), ("~", None), ("", None), (".inf", math.inf),
        ("-.Inf", -math.inf), ("yes", "yes"), ("no", "no"), ("on", "on"), ("1_000", "1_000"), ("0x10", "0x10"),
        ("12:30", "12:30"), ("2024-01-01", "2024-01-01"), ("'3'", "3"), ('"true"', "true"), ("30 deg", "30 deg"),
        ("9" * 40, 1e40), ("[1, a, [2.5]]", [1, "a", [2.5]]), ("{a: 1}", {"a": 1}),
    ],
)  # fmt: skip
def test_scalars_are_read_as_yaml_1_2_says(text, value):
    data = parse_source(f"key: {text}").data
    assert data == {"key": value} and type(data["key"]) is type(value)


def test_nan_is_read_as_a_number():
    assert math.isnan(parse_source("key: .nan").data["key"])


def test_every_value_has_its_line():
    source = parse_source("a: 1\n\n# comment\nb:\n  c: [1,\n      2]\n  d: >\n    folded\n  e: {f: x}\n")
    lines = {("a",): 1, ("b",): 4, ("b", "c"): 5, ("b", "c", 0): 5, ("b", "c", 1): 6, ("b", "d"): 7, ("b", "e", "f"): 9}
    assert {location: source.line(location) for location in lines} == lines


def test_what_is_not_written_has_the_line_of_what_encloses_it():
    source = parse_source("x: 1\na:\n  b:\n    c: 1\n")
    assert source.line(("a", "b", "missing", 3)) == 3
    assert source.line(("missing",)) == 1


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_endings_and_byte_order_marks_of_other_systems_are_read(ending, mark, tmp_path):
    text = mark + changed(("axis:", "axes:")).replace("\n", ending)
    path = tmp_path / "file.yaml"
    path.write_bytes(text.encode())
    with pytest.raises(MechanismError) as caught:
        load_mechanism(path)
    assert [(problem.line, problem.key) for problem in caught.value.problems] == [(14, "joints.pin.axes")]


def test_a_key_is_shown_as_a_path():
    assert dotted(("parts", "rod", "center", 2)) == "parts.rod.center[2]"
    assert dotted(("parts", "a b", "")) == "parts.'a b'.''"
    assert len(dotted(("x" * 1000,))) < 70 and "\x1b" not in dotted(("\x1b[31m",))


def test_aliases_repeat_values_and_merge_keys_inherit_them():
    source = parse_source("a: &a\n  x: 1\n  y: 2\nb: *a\nc:\n  <<: *a\n  y: 3\nd: {<<: [{x: 7}, *a]}\n")
    assert source.data["b"] == {"x": 1, "y": 2}
    assert source.data["c"] == {"x": 1, "y": 3}
    assert source.data["d"] == {"x": 7, "y": 2}
    lines = {("b", "y"): 3, ("c", "x"): 2, ("c", "y"): 7, ("d", "x"): 8, ("d", "y"): 3}  # where each is written
    assert {location: source.line(location) for location in lines} == lines


def test_a_mechanism_may_use_anchors():
    text = changed(("  rod:\n", "  rod: &rod\n"), ("joints:\n", "  other:\n    <<: *rod\n    mass: 7\njoints:\n"))
    text += "  weld: {type: fixed, between: [rod.tip, other]}\n"
    assert parse_mechanism(text).parts["other"].mass == 7.0


def test_a_key_given_twice_is_reported_with_both_lines_and_with_everything_else():
    problems = problems_of(changed(("    mass: m\n", "    mass: m\n    mass: 3\n"), ("position:", "positon:")))
    assert [(problem.line, problem.key) for problem in problems] == [(8, "parts.rod.mass"), (16, "joints.pin.positon")]
    assert problems[0].message == "is given twice, first on line 7" and problems[0].remedy == "Remove one of them."


@pytest.mark.parametrize("value", ["1", "[1]", "text"])
def test_a_merge_key_needs_mappings(value):
    problem = problem_of(changed(("    mass: m\n", f"    <<: {value}\n    mass: m\n")))
    assert (problem.line, problem.key) == (7, "parts.rod.<<")
    assert problem.message == "must merge a mapping, or a list of mappings"


BOMB = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)
)
MERGE_BOMB = "a0: &a0 {k: 1}\n" + "".join(
    f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}\n" for i in range(1, 12)
)


@pytest.mark.parametrize(
    ("text", "line", "message", "remedy"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", 3, "not valid YAML", "Check indentation"),
        ("a: 1\nb: 'x\nc: 3\n", 3, "not valid YAML: while scanning a quoted scalar that begins on line 2", "Check"),
        ("a:\n\tb: 1\n", 2, "not valid YAML", "Indent with spaces"),
        ("a: b: c\n", 1, "not valid YAML", "a value with ': '"),
        ("a:\n  b: {x: ${l/2}}\n", 2, "not valid YAML", "write the expression bare (l/2) or quoted"),
        ("a: 1\n---\nb: 1\n", 2, "a second YAML document", "Keep one mechanism per file."),
        ("a: 1\nb: *c\n", 2, "unknown alias '*c'", "Mark a value before it with &c."),
        ("length: &length 1\nb: *lenght\n", 2, "unknown alias '*lenght'", "Did you mean 'length'?"),
        (
            "a: 1\nb: !!python/object/apply:os.system [ls]\n",
            2,
            "the tag '!!python/object/apply:os.system'",
            "Write plain",
        ),
        ("a: !!float 1\n", 1, "the tag '!!float' is not allowed", "Write plain"),
        ("a: !mine 1\n", 1, "the tag '!mine' is not allowed", "Write plain"),
        ("a: 1\n? [x]\n: 1\n", 2, "a key must be a word", "quote"),
        ("a: 1\nb: \x00\n", 2, "the character U+0000 is not allowed", "Remove it."),
        ("a: 1\nb: \x1b[31m\n", 2, "the character U+001B is not allowed", "Remove it."),
        ("a: \ud800\n", 1, "the character U+D800 is not allowed", "Remove it."),
        ("a: &a [*a]\n", 1, "an alias is inside the value that it repeats", "Remove it."),
        ("a: &a {<<: *a}\n", 1, "an alias is inside the value that it repeats", "Remove it."),
        (BOMB, 1, "aliases expand to more than 60000 values", "Use fewer aliases."),
        (MERGE_BOMB, 1, "aliases expand to more than 60000 values", "Use fewer aliases."),
        ("a: " + "[" * 100_000, 1, "nested deeper than 40 levels", "Flatten"),
        ("{a: " * 5000 + "1" + "}" * 5000, 1, "nested deeper than 40 levels", "Flatten"),
        ("- " * 5000, 1, "nested deeper than 40 levels", "Flatten"),
        ("a: [" + "1," * 150_000 + "]", 1, "more than 60000 values", "hundreds"),
        ("a" * 1_000_001, 1, "the text is longer than 1000000 characters", "a few kB"),
    ],
    ids=range(24),
)
def test_what_cannot_be_read_is_refused_at_once_with_its_line(text, line, message, remedy):
    problem = refusal(text)
    assert problem.line == line and problem.message.startswith(message) and remedy in problem.remedy


def test_terminal_escapes_do_not_reach_the_message():
    text = changed(("mechanism: pendulum", 'mechanism: "\\e[31m"'), ("ground, rod", '"\\e[2J", rod'))
    problems = problems_of(text)
    assert len(problems) == 2
    assert all(str(problem).isprintable() for problem in problems)


@pytest.mark.parametrize("text", ["", "# only a comment", "null", "[]", "7", "hello", "---"])
def test_the_error_for_a_file_without_a_mapping_says_how_to_begin(text):
    problem = problem_of(text)
    assert problem.line == 1 and "mapping with 'mechanism', 'parts' and 'joints'" in problem.message
    assert "mechanism: pendulum" in problem.remedy


def test_a_path_in_place_of_text_is_recognized():
    assert "load_mechanism" in problem_of("config/double_rod.yaml").remedy


def write(path, content):
    path.write_bytes(content)
    with pytest.raises(MechanismError) as caught:
        load_mechanism(path)
    (problem,) = caught.value.problems
    assert problem.file == str(path)
    return problem


def test_a_file_of_ten_megabytes_is_refused_at_once(tmp_path):
    longest = reference_time()
    start = time.process_time()
    problem = write(tmp_path / "big.yaml", PENDULUM.encode() * (10_000_000 // len(PENDULUM)))
    assert time.process_time() - start < longest
    assert problem.message == "the file is larger than 1000000 bytes"


def test_a_file_in_another_encoding_is_refused_with_its_line(tmp_path):
    problem = write(tmp_path / "latin.yaml", PENDULUM.replace("rod:", "# für\n  rod:", 1).encode("latin-1"))
    assert problem.line == 6 and problem.remedy == "Save the file as UTF-8."
    assert write(tmp_path / "utf16.yaml", PENDULUM.encode("utf-16")).remedy == "Save the file as UTF-8."
