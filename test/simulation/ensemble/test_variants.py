"""Variants that are built at once against the same ones built by themselves: to the last bit."""

import numpy as np
import pytest

from mbd_sim import Ensemble, MechanismError, Simulation
from mbd_sim.dynamics.constraints.start import start_like
from mbd_sim.files.checks.override import matching, value_of, with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.simulation.ensemble import variants as ensemble_variants
from mbd_sim.simulation.ensemble import variants as variant_batch
from mbd_sim.simulation.ensemble.variants import FEWEST, Variants, build_at_once, numbers_of
from mbd_sim.simulation.model.model import build_model

VARIED = {
    "double_rod": ("l", "joints.elbow.damping", "gravity[2]"),
    "four_bar": ("coupler", "joints.crank_pivot.velocity", "density"),
    "tumbling": ("parts.body.mass", "joints.flight.angular_velocity[1]"),
    "constrained_pendulum": ("l", "m"),
    "universal_pendulum": ("parameters.*",),
}


def changes_of(name, count=FEWEST + 1):
    mechanism, random = load_mechanism(name), np.random.default_rng(4)
    keys = [
        key for pattern in VARIED[name] for key in (matching(mechanism, [pattern]) if "*" in pattern else [pattern])
    ]
    keys = [key for key in keys if value_of(mechanism, key)]
    assert keys
    return mechanism, [
        {key: value_of(mechanism, key) * (1.0 + 0.02 * random.normal()) for key in keys} for _ in range(count)
    ]


@pytest.mark.parametrize("name", VARIED)
def test_numbers_of_all_variants_are_those_of_each(name):
    mechanism, changes = changes_of(name)
    found = build_at_once(mechanism, changes, lambda index: with_values(mechanism, changes[index]))
    assert len(found) == len(changes) and None not in found
    for index in (3, 13):  # the first, the middle and the last one were compared
        assert found[index].same_as(numbers_of(with_values(mechanism, changes[index])))


@pytest.mark.parametrize("name", ["four_bar", "constrained_pendulum"])
def test_loops_closed_at_once_are_those_of_each(name):
    mechanism, changes = changes_of(name)
    variants = Variants(mechanism, changes)
    model = build_model(variants.first, None, (), variants.values)
    states, values = variants.starts(model)
    assert len(variants._mechanisms) == 3, "the other variants are not built"
    for state, row, change in [*zip(states, values, changes, strict=True)][2::5]:
        constraints = model.equations.constraints.with_values(row)
        q, u = start_like(
            with_values(mechanism, change), model.layout, constraints, model.equations.rows, model.equations.start.rank
        )
        assert np.array_equal(state[model.q_range], q)
        assert np.array_equal(state[model.u_range], u)


def test_variants_for_which_a_decision_is_another_one_are_built_by_themselves():
    """Without damping, or at the position zero."""
    mechanism = load_mechanism("double_rod")
    changes = [{"joints.elbow.damping": 0.1 * index, "joints.elbow.position": 0.3 - 0.1 * index} for index in range(20)]
    found = build_at_once(mechanism, changes, lambda index: with_values(mechanism, changes[index]))
    variants = Variants(mechanism, changes)
    for index, change in enumerate(changes):
        expected = numbers_of(with_values(mechanism, change))
        assert variants._numbers[index].same_as(expected)
        assert found[index] is None or found[index].same_as(expected)


@pytest.mark.parametrize(
    ("name", "key", "wrong", "words"),
    [
        ("double_rod", "l", 0.0, r"member 8: a rod needs two different ends"),
        ("double_rod", "m", float("nan"), r"parameters\.m: member 8: must be finite"),
        ("double_rod", "joints.elbow.damping", -0.5, r"double_rod.yaml.*damping: member 8: must be at least 0"),
        ("four_bar", "crank", 5.0, r"member 8: .*remains open"),
    ],
)
def test_an_error_names_the_member_the_file_the_key_and_the_remedy(name, key, wrong, words):
    mechanism = load_mechanism(name)
    changes = [{key: wrong if index == 8 else 0.5 + 0.001 * index} for index in range(9)]
    with pytest.raises(MechanismError, match=words) as raised:
        variants = Variants(mechanism, changes)
        variants.starts(build_model(variants.first, None, (), variants.values))
    assert raised.value.problems[0].remedy


ROOT = """
mechanism: root
parts: {slide: {mass: 0}, point: {mass: 1}}
joints:
  x: {type: prismatic, between: [ground, slide], axis: [1, 0, 0], position: 0.6}
  z: {type: prismatic, between: [slide, point], axis: [0, 0, 1], guess: true}
constraints: {curve: {type: on_surface, point: point, equation: z - sqrt(x - 0.1)}}
"""


@pytest.mark.parametrize(("undefined", "others"), [(-0.5, 1), (0.1, FEWEST)])
def test_a_member_whose_constraint_is_undefined_is_named_among_few_and_many(undefined, others):
    """Where x < 0.1 there is no root, and at 0.1 it has no derivative, though the constraint is satisfied."""
    positions = [*np.linspace(0.2, 0.9, others).tolist(), undefined]
    words = rf"curve: member {others}: has no finite value, or no finite derivative, at the start"
    with pytest.raises(MechanismError, match=words):
        Ensemble(parse_mechanism(ROOT), [{"joints.x.position": position} for position in positions])


def test_lists_among_the_changes_are_values_of_the_file():
    mechanism, key = load_mechanism("double_rod"), "gravity"
    changes = [{key: [0.0, 0.0, -9.81]}, {key: [0.0, 0.0, -1.62]}, {key: [0.0, 0.0, -9.81]}]
    variants = Variants(mechanism, changes)
    assert [variants.mechanism_of(member).gravity[2] for member in range(3)] == [-9.81, -1.62, -9.81]
    with pytest.raises(MechanismError, match=r"parameters\.l: member 0: must be a number"):
        _ = Variants(mechanism, [{"l": [1.0, 2.0]}]).first


def test_should_a_batch_differ_nothing_of_it_is_used(monkeypatch):
    mechanism, changes = changes_of("double_rod")
    right = variant_batch._numbers

    def wrong(*args):
        found = right(*args)
        found[-1].data.free[0] += 1e-16
        found[-1].data.free[1] += 1e-3
        return found

    monkeypatch.setattr(variant_batch, "_numbers", wrong)
    found = build_at_once(mechanism, changes, lambda index: with_values(mechanism, changes[index]))
    assert found == [None] * len(changes)


SERVO = """
mechanism: servo
parameters: {l: 0.4, kp: 30, angle: 0.2, load: 0.5 kg}
parts: {arm: {mass: load, center: [0, 0, -l], inertia: [0.1, 0.1, 0.1]}}
joints: {pin: {type: revolute, between: [ground, arm], axis: [0, 1, 0], position: angle}}
actuators: {motor: {type: effort, joint: pin, servo: {controls: position, kp: kp, kd: 2}, command: {position: COMMAND}}}
"""


@pytest.mark.parametrize("command", ["0.3", "angle"])
def test_variants_with_actuators_are_built_at_once_and_begin_as_each_alone(command):
    """The command at the start may differ from one member to the next; only then is each one built by itself."""
    mechanism, random = parse_mechanism(SERVO.replace("COMMAND", command)), np.random.default_rng(4)
    changes = [
        {"l": length, "kp": gain, "angle": angle} for length, gain, angle in random.uniform(0.2, 0.9, (20, 3)).tolist()
    ]
    members = Ensemble(mechanism, changes)
    assert len(members._variants._mechanisms) == (3 if command == "0.3" else 20)
    for index in (0, 7):
        assert members._variants._numbers[index].same_as(numbers_of(with_values(mechanism, changes[index])))
    members.step(50)
    single = Simulation(with_values(mechanism, changes[7]))
    single.step(50)
    assert members.q[7] == pytest.approx(single.q, rel=1e-12)


def test_groups_that_change_other_numbers_are_built_at_once_each():
    mechanism = parse_mechanism(SERVO.replace("COMMAND", "0.3"))
    changes = [{"l": 0.3 + 0.001 * k} if k % 2 else {"load": 0.3 + 0.001 * k, "kp": 20.0 + k} for k in range(40)]
    variants = Variants(mechanism, changes)
    assert len(variants._mechanisms) == 6
    for index in (0, 1, 31):
        assert variants._numbers[index].same_as(numbers_of(with_values(mechanism, changes[index])))


def test_progress_is_told_for_variants_that_are_built_one_by_one(monkeypatch, capsys):
    told, mechanism, changes = [], load_mechanism("rod_pendulum"), [{"l": f"{k + 1} m"} for k in range(4)]
    Variants(mechanism, changes, told.append)
    assert told == [0.0, 0.25, 0.5, 0.75, 1.0]
    monkeypatch.setattr(ensemble_variants, "UNNOTICED", 0.0)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    Variants(mechanism, changes)
    assert capsys.readouterr().err.endswith("\rbuilt 3 of 4 variants\rbuilt 4 of 4 variants\n")
