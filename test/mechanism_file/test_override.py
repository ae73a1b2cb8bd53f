import pytest

from mbd_sim.errors import MechanismError
from mbd_sim.load import load_mechanism
from mbd_sim.mechanism_file.override import matching, value_of, with_values


@pytest.fixture
def rods():
    return load_mechanism("double_rod")


def test_a_value_is_given_in_si_units_or_as_in_the_file(rods):
    changed = with_values(rods, {"l": "120 cm", "joints.elbow.damping": 0.5, "gravity[2]": -1.62})
    assert changed.parameters == {"m": 1.0, "l": 1.2}
    assert changed.joints["elbow"].damping[0] == 0.5
    assert changed.gravity.tolist() == [0.0, 0.0, -1.62]
    assert changed.parts["upper"].center[2] == -0.6
    assert rods.parameters["l"] == 1.0, "the mechanism itself stays"


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("joints.elbw.damping", 1.0, "elbow"),
        ("joints.elbow.dampng", 1.0, "damping"),
        ("length", 1.0, "names nothing"),
        ("gravity[3]", 1.0, "The last one is 2"),
        ("[2]", 1.0, "not a key"),
        ("parameters.m", -1.0, "at least 0"),
        ("m.x", 1.0, "names nothing"),
        ("joints.elbow.between[0][1]", 1.0, "not a list"),
    ],
)
def test_a_key_that_does_not_exist_is_named_with_what_does(rods, name, value, words):
    with pytest.raises(MechanismError, match=words.replace("[", r"\[")):
        with_values(rods, {name: value})


def test_a_value_that_the_file_leaves_out_has_its_default(rods):
    assert value_of(rods, "joints.elbow.damping") == 0.0
    assert value_of(rods, "l") == 1.0
    assert value_of(rods, "gravity[2]") == -9.81
    assert value_of(rods, "joints.elbow.type") is None
    with pytest.raises(MechanismError, match="elbow"):
        value_of(rods, "joints.elbw.damping")


def test_patterns_match_numbers_of_the_file(rods):
    assert matching(rods, ["parameters.*"]) == ["parameters.m", "parameters.l"]
    assert "joints.elbow.damping" in matching(rods, ["joints.*.damping"])
    assert "gravity[2]" in matching(rods, ["gravity[*"])
