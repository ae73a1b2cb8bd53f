import re

import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.checks.override import matching, value_of, with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.mechanism_texts import PENDULUM


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
        ("length", 1.0, "is not a key of this file"),
        ("gravity[3]", 1.0, "The last entry is 2"),
        ("[2]", 1.0, "not a key"),
        ("parameters.m", -1.0, "at least 0"),
        ("parameters.new", 1.0, "there is no parameter 'new'. Valid: l, m"),
        ("functions.new(t)", "t", "there is no function 'new(t)'. The file has no functions"),
        ("m.x", 1.0, "is not a key of this file"),
        ("joints.elbow.between[0][1]", 1.0, "not a list"),
    ],
)
def test_a_key_that_does_not_exist_is_named_with_what_does(rods, name, value, words):
    with pytest.raises(MechanismError, match=re.escape(words)):
        with_values(rods, {name: value})


def test_a_value_that_the_file_leaves_out_has_its_default(rods):
    assert value_of(rods, "joints.elbow.damping") == 0.0
    assert value_of(rods, "l") == 1.0
    assert value_of(rods, "gravity[2]") == -9.81
    assert value_of(rods, "joints.elbow.type") is None
    with pytest.raises(MechanismError, match="elbow"):
        value_of(rods, "joints.elbw.damping")


def test_the_integrator_need_not_be_in_the_file():
    mechanism = parse_mechanism(PENDULUM)
    assert "integrator" not in mechanism.source.data
    assert with_values(mechanism, {"integrator.step": "0.1 ms"}).step == 1e-4


def test_patterns_match_numbers_of_the_file(rods):
    assert matching(rods, ["parameters.*"]) == ["parameters.m", "parameters.l"]
    assert "joints.elbow.damping" in matching(rods, ["joints.*.damping"])
    assert "gravity[2]" in matching(rods, ["gravity[*"])


@pytest.mark.parametrize("written", ["regularization", "regularisation"])
def test_both_spellings_of_regularization_are_read_and_changed(written):
    text = f"""
mechanism: slider
parts: {{body: {{mass: 1}}}}
joints: {{s: {{type: prismatic, between: [ground, body], axis: [1, 0, 0], friction: {{coulomb: 1, {written}: 0.2}}}}}}
"""
    mechanism = parse_mechanism(text)
    assert mechanism.joints["s"].friction.regularization == 0.2
    for key in ("joints.s.friction.regularization", "joints.s.friction.regularisation"):
        assert value_of(mechanism, key) == 0.2
        assert with_values(mechanism, {key: 0.3}).joints["s"].friction.regularization == 0.3
        assert matching(mechanism, [key.replace("s.", "*.", 1)]) == ["joints.s.friction.regularization"]
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text.replace("0.2", "-1"))
    (problem,) = caught.value.problems
    assert (problem.key, problem.value) == (f"joints.s.friction.{written}", "-1")


def test_regularization_in_both_spellings_at_once_is_refused():
    with pytest.raises(MechanismError, match="unknown key 'regularisation'"):
        parse_mechanism(
            "mechanism: slider\nparts: {body: {mass: 1}}\njoints: {s: {type: prismatic, between: [ground, body], "
            "axis: [1, 0, 0], friction: {coulomb: 1, regularisation: 1, regularization: 1}}}"
        )


def test_a_parameter_with_a_unit_takes_only_units_of_its_dimension():
    linkage = load_mechanism("four_bar")  # crank: 0.5 m, density: 1
    assert with_values(linkage, {"crank": "40 cm", "density": "2 kg/m"}).parameters["crank"] == 0.4
    assert with_values(linkage, {"crank": 0.4}).parameters["crank"] == 0.4
    with pytest.raises(MechanismError, match=r"crank: the unit 'kg' does not fit: a value in m is expected here"):
        with_values(linkage, {"crank": "1 kg"})
