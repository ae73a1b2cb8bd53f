"""Data written as YAML reads back as the same data."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbd_sim.files.text.library import shipped
from mbd_sim.files.text.yaml_text import UNPRINTABLE, parse_source, yaml_text


@pytest.mark.parametrize("path", shipped().values(), ids=shipped())
def test_shipped_files(path):
    data = parse_source(path.read_text(encoding="utf-8")).data
    assert parse_source(yaml_text(data)).data == data


WORDS = st.text(max_size=12).filter(lambda text: not UNPRINTABLE.search(text))
TRICKY = st.sampled_from(
    [
        "",
        "1e3",
        "no",
        "on",
        "null",
        "~",
        "0x1f",
        "1_0",
        "a: b",
        "a #b",
        "- a",
        "{a}",
        "'",
        "\n",
        "1:30",
        "=",
        "<<",
        "!a",
        "&a",
        "*a",
    ]
)
NUMBERS = st.floats(allow_nan=False) | st.integers(-(10**20), 10**20)
VALUES = st.recursive(
    NUMBERS | WORDS | TRICKY | st.booleans(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS | TRICKY, inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=8, deadline=None)
@given(st.dictionaries(st.sampled_from(["parts", "joints", "x"]) | WORDS, VALUES, max_size=4))
def test_any_data(data):
    assert parse_source(yaml_text(data)).data == data


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_keep_every_bit(number):
    found = parse_source(yaml_text({"x": number})).data["x"]
    assert float(found) == number and (number == 0.0 or math.copysign(1.0, found) == math.copysign(1.0, number))


def test_it_is_laid_out_for_people():
    data = {"mechanism": "a", "parts": {"b": {"mass": 1.0, "points": {"p": [0.0, -0.5, 1e-7]}}}, "joints": {}}
    assert yaml_text(data, ["From here.\nmechanism: b"]) == (
        "# From here. mechanism: b\n"
        "mechanism: a\nparts:\n  b:\n    mass: 1\n    points:\n      p: [0, -0.5, 1e-07]\njoints: {}\n"
    )
