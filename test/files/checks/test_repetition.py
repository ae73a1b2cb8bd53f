"""Entries that stand for several: names, values, lines, and everything that reads or changes a file."""

import json

import jsonschema
import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.cli.main import main
from mbd_sim.files.checks.json_schema import json_schema
from mbd_sim.files.checks.override import matching, value_of, with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.text.yaml_text import mechanism_text, parse_source, yaml_text
from test.files.urdf.test_overlay import FIVE_BAR

CHAIN = """mechanism: chain
parameters: {l: 0.5, n: 4, count: n}
ground:
  points:
    top_{i}: {for: {i: 1..3}, at: [i*l, "-{i}", 0]}
parts:
  link_{i}:
    for: {i: 1..count}
    points: {tip: [0, 0, -l]}
    shapes:
      - {type: rod, to: [0, 0, -l], mass: i}
      - {for: {k: [-1, 1]}, type: sphere, radius: 0.1, at: [k*l, k**2, 0], mass: 0}
joints:
  pin_1: {type: revolute, between: [ground.top_1, link_1], axis: [0, 1, 0]}
  pin_{i}:
    for: {i: 2..n}
    type: revolute
    between: ["link_{i-1}.tip", "link_{i}"]
    axis: [0, 1, 0]
    position: ${10*i} deg
"""


def problems_of(text):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text, "chain.yaml")
    return str(caught.value).splitlines()


def changed(old, new):
    assert old in CHAIN
    return CHAIN.replace(old, new)


def test_an_entry_stands_for_one_entry_for_each_value_of_its_index():
    chain = parse_mechanism(CHAIN)
    assert list(chain.parts) == ["link_1", "link_2", "link_3", "link_4"]
    assert [part.mass for part in chain.parts.values()] == [1.0, 2.0, 3.0, 4.0]
    assert [(joint.parent, joint.child) for joint in chain.joints.values()][1:] == [
        ("link_1", "link_2"), ("link_2", "link_3"), ("link_3", "link_4"),
    ]  # fmt: skip
    assert chain.joints["pin_3"].position == pytest.approx(np.deg2rad(30.0))
    assert chain.ground_points["top_3"].position.tolist() == [1.5, -3.0, 0.0]
    spheres = [shape for shape in chain.parts["link_2"].shapes if shape.kind == "sphere"]
    assert [sphere.pose.position.tolist() for sphere in spheres] == [[-0.5, 1.0, 0.0], [0.5, 1.0, 0.0]]


def test_it_is_the_same_mechanism_as_the_one_written_out():
    written_out = parse_mechanism(yaml_text(parse_mechanism(CHAIN).source.data))
    first, second = Simulation(parse_mechanism(CHAIN)), Simulation(written_out)
    for sim in (first, second):
        sim.step(50)
    assert first.state.tobytes() == second.state.tobytes()


def test_words_and_several_indices():
    text = """mechanism: table
parameters: {left: 1, right: -1}
parts:
  leg_{side}_{k}: {for: {side: [left, right], k: 1..2}, mass: 1, center: [side*k, 0, 0]}
joints:
  weld_{side}_{k}: {for: {side: [left, right], k: 1..2}, type: fixed, between: [ground, "leg_{side}_{k}"]}
"""
    legs = parse_mechanism(text).parts
    assert {name: leg.center[0] for name, leg in legs.items()} == {
        "leg_left_1": 1.0, "leg_left_2": 2.0, "leg_right_1": -1.0, "leg_right_2": -2.0,
    }  # fmt: skip


def test_an_empty_range_stands_for_no_entry():
    assert list(parse_mechanism(changed("n: 4", "n: 1")).joints) == ["pin_1"]


@pytest.mark.parametrize(
    "old, new, lines",
    [
        ("    axis: [0, 1, 0]\n", "    axis: [0, 1, 0]\n    dampin: 1\n",
         ["chain.yaml:20: joints.pin_2.dampin (i = 2, and 2 more): unknown key 'dampin'. Did you mean 'damping'? Others: "
          "axis, between, compliance, cut, damper, drive, effort_limit, friction, guess, limits, position, rest, … (5 more)."]),
        ("link_{i-1}.tip", "link_{i}.top",
         [f"chain.yaml:18: joints.pin_{i}.between[0] (i = {i}): 'link_{i}' has no point 'top'. Did you mean 'tip'?"
          for i in (2, 3, 4)]),
        ("{i: 2..n}", "{i: 3}",
         ["chain.yaml:16: joints.'pin_{i}'.for.i: must be a range or a list (got 3). Write for example 1..6 or [left, right]."]),
        ("{i: 2..n}", "{i: 2..n/3}",
         ["chain.yaml:16: joints.'pin_{i}'.for.i: 'n/3' is 1.33333, not a whole number. Write for example 1..6."]),
        ("{i: 2..n}", "{i: 9..n}",
         ["chain.yaml:16: joints.'pin_{i}'.for.i: the range begins with 9 and ends with 4 (got '9..n'). "
          "Begin with the smaller number, or list the values."]),
        ("{i: 2..n}", "{i: 1..n}",
         ["chain.yaml:15: joints.'pin_{i}' (i = 1): the name 'pin_1' is given twice. Choose another name."]),
        ("{i: 2..n}", "{l: 2..n}",
         ["chain.yaml:16: joints.'pin_{i}'.for.l: the index 'l' has the name of a parameter. Rename one of them."]),
        ("pin_{i}:", "pin:",
         ["chain.yaml:15: joints.pin (i = 3): the name 'pin' is given twice. Put the index into the name: pin_{i}."]),
        ("pin_{i}:", "pin_${i}:",
         ["chain.yaml:15: joints.'pin_${i}' (i = 3): the name 'pin_${i}' is given twice. "
          "Write the index of a name without $: pin_{i}."]),
        ("{i: 2..n}", "{i: 2..1e9}",
         ["chain.yaml:16: joints.'pin_{i}'.for.i: has more than 60000 values (got '2..1e9'). Use fewer repetitions."]),
        ("link_{i-1}.tip", "link_{j-1}.tip",
         ["chain.yaml:18: joints.'pin_{i}'.between[0] (i = 2, and 2 more): unknown name 'j' (got 'link_{j-1}.tip'). "
          "Valid: count, e, i, l, n, pi."]),
        ("link_{i-1}.tip", "link_{i/2}.tip",
         ["chain.yaml:18: joints.'pin_{i}'.between[0] (i = 3): 1.5 is not a whole number and cannot be part of a name "
          "(got 'link_{i/2}.tip'). Use whole numbers or words."]),
    ],
)  # fmt: skip
def test_problems_name_the_line_of_the_template_and_the_index(old, new, lines):
    assert problems_of(changed(old, new)) == lines


def test_values_are_changed_by_the_names_of_the_single_entries_and_by_parameters_of_ranges():
    chain = with_values(parse_mechanism(CHAIN), {"joints.pin_2.damping": 3.0, "n": 3})
    assert list(chain.parts) == ["link_1", "link_2", "link_3"] and chain.joints["pin_2"].damping == [3.0]
    longer = with_values(chain, {"n": 5, "l": 2.0})
    assert len(longer.parts) == 5 and longer.joints["pin_2"].damping == [3.0] and longer.parameters["l"] == 2.0
    assert value_of(longer, "joints.pin_5.position") == pytest.approx(np.deg2rad(50.0))
    assert matching(chain, ["joints.*.damping"]) == [f"joints.pin_{i}.damping" for i in (1, 2, 3)]
    with pytest.raises(MechanismError, match="there is no 'pin_2'"):
        with_values(longer, {"n": 1})


def test_live_values_act_on_single_entries_but_cannot_change_their_number():
    sim = Simulation(parse_mechanism(CHAIN), live=["joints.*.damping", "l"])
    sim.set_live({"l": 0.6, "joints.pin_3.damping": 0.2})
    with pytest.raises(MechanismError, match="cannot change during a run: no value near 4 is possible"):
        Simulation(parse_mechanism(CHAIN), live=["n"])


def test_the_schema_for_editors_accepts_repetitions_and_functions():
    validator = jsonschema.Draft202012Validator(json.loads(json.dumps(json_schema())))
    data = parse_source(CHAIN + "functions:\n  f(x, y): x + y\n").data
    assert [error.message for error in validator.iter_errors(data)] == []
    assert not validator.is_valid(parse_source(changed("{i: 2..n}", "3")).data)
    assert not validator.is_valid(parse_source(changed("pin_{i}:", "pin}:")).data)


def test_entries_beside_a_urdf_are_repeated(tmp_path):
    (tmp_path / "five.urdf").write_text(FIVE_BAR)
    path = tmp_path / "file.yaml"
    path.write_text(
        "mechanism: five\nurdf: five.urdf\nparameters: {n: 2}\nparts:\n  extra_{i}: {for: {i: 1..n}, mass: 1}\njoints:\n"
        '  weld_{i}: {for: {i: 1..n}, type: fixed, between: [ground, "extra_{i}"]}\n'
        "  {side}_hip: {for: {side: [left, right]}, damping: 3}\n".replace("  {side}_hip", '  "{side}_hip"')
    )
    five = load_mechanism(path)
    assert five.joints["right_hip"].damping == five.joints["left_hip"].damping == [3.0] and "extra_2" in five.parts
    assert list(parse_mechanism(mechanism_text(five.source)).parts) == list(five.parts)
    with pytest.raises(
        MechanismError, match="n: cannot be changed here: it determines the number of entries of a file"
    ):
        with_values(five, {"n": 3})


def test_convert_writes_the_entries_out(tmp_path, capsys):
    path = tmp_path / "chain.yaml"
    path.write_text(CHAIN)
    assert main(["convert", str(path)]) == 0 and capsys.readouterr().out == CHAIN
    assert main(["convert", str(path), "--expand"]) == 0
    text = capsys.readouterr().out
    assert (
        "for" not in text
        and "  link_4:\n" in text
        and list(parse_mechanism(text).joints) == [f"pin_{i}" for i in (1, 2, 3, 4)]
    )
