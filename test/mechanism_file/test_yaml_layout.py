"""Data of words and numbers is laid out as by PyYAML; other data is left to it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbd_sim.mechanism_file import yaml_writer
from mbd_sim.mechanism_file.yaml_layout import UnusualTextError
from mbd_sim.mechanism_file.yaml_writer import text_by_pyyaml, yaml_text

SECTIONS = st.sampled_from(["parts", "joints", "ground", "points", "shapes", "meshes", "parameters"])
WORDS = st.from_regex(r"[A-Za-z_][A-Za-z0-9_./-]{0,20}", fullmatch=True) | st.sampled_from(
    ["no", "on", "y", "null", "true"]
)
TEXTS = WORDS | st.sampled_from(["#00ff7f", "package://robot/meshes/arm.stl", "file:///a", "", "a b", "#", "a:", "é"])
NUMBERS = st.floats(allow_nan=True) | st.integers(-(10**20), 10**20) | st.booleans()
VALUES = st.recursive(
    NUMBERS | TEXTS | st.none(),
    lambda inner: st.lists(inner, max_size=8) | st.dictionaries(WORDS | SECTIONS, inner, max_size=4),
    max_leaves=15,
)


@pytest.fixture
def alone(monkeypatch):
    """PyYAML must not be needed."""
    monkeypatch.setattr(yaml_writer, "text_by_pyyaml", lambda data: pytest.fail("it is left to PyYAML"))


@settings(max_examples=30, deadline=None)
@given(st.dictionaries(SECTIONS | WORDS, VALUES, max_size=5))
def test_it_is_the_text_of_pyyaml(data):
    assert yaml_text(data) == text_by_pyyaml(data)


def test_robots_do_not_need_pyyaml(alone):
    mesh = {"file": "package://robot/meshes/arm.stl", "scale": [0.001] * 3}
    numbers = [index / 7 for index in range(20)]
    part = {
        "mass": 1.5,
        "center": None,
        "meshes": [mesh, mesh],
        "points": {"p": {"at": numbers, "rotate": {"rpy": numbers}}},
    }
    data = {
        "mechanism": "robot",
        "parts": {"arm": part, "no": {}},
        "joints": {"j": {"limits": [[-1, 1]], "color": "#00ff7f"}},
    }
    assert yaml_text(data) == text_by_pyyaml(data)


@pytest.mark.parametrize(
    "data", [{}, {"a": "two words"}, {"a b": 1}, {"parts": [{"b": 1}]}, {"a": {"b": ""}}, {"a": "x" * 200}]
)
def test_other_data_is_left_to_pyyaml(data):
    layout = yaml_writer.YamlLayout(80, yaml_writer._block, yaml_writer._plain, yaml_writer._is_quoted)
    with pytest.raises(UnusualTextError):
        layout.text(data)
    assert yaml_text(data) == text_by_pyyaml(data)
