"""Ensembles of mechanisms with actuators: members that start again, and commands as arrays."""

import json

import numpy as np
import pytest

from mbd_sim import CommandError, Ensemble, Simulation
from mbd_sim.files.load import parse_mechanism

ARM = {
    "parts": {"arm": {"mass": 1, "center": [0, 0, -0.3], "inertia": [0.1, 0.1, 0.02], "points": {"tip": [0, 0, -0.6]}}},
    "joints": {"pin": {"type": "revolute", "between": ["ground", "arm"], "axis": [0, 1, 0], "position": 0.4}},
}
DC = {"type": "dc_motor", "joint": "pin", "torque_constant": 0.5, "resistance": 2}
EFFORT = {"type": "effort", "joint": "pin", "effort_limit": 20}
ACTUATORS = {
    "effort": EFFORT,
    "dc_motor": DC | {"voltage_limit": 12},
    "inductance": DC | {"inductance": 1e-3},
    "current": DC | {"control": "current", "current_limit": 5},
    "position servo": EFFORT | {"servo": {"controls": "position", "kp": 30, "kd": 2}},
    "integral": EFFORT | {"servo": {"controls": "position", "kp": 30, "ki": 20, "kd": 2}},
    "velocity servo": DC | {"servo": {"controls": "velocity", "kp": 4, "ki": 9}},
    "rate limit": EFFORT | {"servo": {"controls": "position", "kp": 30, "kd": 2, "rate_limit": 1.5}},
    "sampled": EFFORT | {"servo": {"controls": "position", "kp": 30, "ki": 5, "kd": 2, "sample_rate": "250 Hz"}},
    "delayed": EFFORT | {"delay": "3 ms"},
    "hydraulic": {
        "type": "hydraulic_cylinder", "between": ["ground.hook", "arm.tip"], "stroke": 2, "retracted": 0.01,
        "areas": [2e-3, 1.4e-3], "dead_volumes": [1e-4, 1e-4], "rated_flow": 3e-4, "supply": 1e7,
    },
    "pneumatic": {
        "type": "pneumatic_cylinder", "between": ["ground.hook", "arm.tip"], "stroke": 2, "retracted": 0.01,
        "areas": [8e-4, 6.5e-4], "dead_volumes": [2e-5, 2e-5], "conductance": 2e-8, "supply": 7e5,
    },
}  # fmt: skip


GROUPS = [  # of which each mechanism has all, on an arm each; those that act between steps have a method of their own
    ("effort", "dc_motor", "inductance"), ("current", "position servo", "integral"), ("rate limit", "sampled", "delayed"),
    ("velocity servo", "hydraulic", "pneumatic"),
]  # fmt: skip


def arm(*actuators, sensors=False, loop=False):
    """An arm for each actuator; of the first one, the loop and the encoder."""
    text = json.loads(json.dumps(ARM)) | {
        "mechanism": "arm",
        "integrator": {"step": 1e-3},
        "ground": {"points": {"hook": [0.5, 0, 0]}},
    }
    if actuators == ("drive",):
        text["parts"]["lower"] = {"mass": 0.5, "center": [0, 0, -0.2], "inertia": [0.02, 0.02, 0.01]}
        text["joints"]["elbow"] = {"type": "revolute", "between": ["arm.tip", "lower"], "axis": [0, 1, 0]}
        text["joints"]["pin"] = text["joints"]["pin"] | {"drive": {"command": "position", "bandwidth": 20}}
        text["joints"]["pin"].pop("position")
    elif actuators:
        own = [
            json.dumps({"parts": ARM["parts"], "joints": ARM["joints"], "actuators": {"motor": ACTUATORS[actuator]}})
            for actuator in actuators
        ]
        for number, one in enumerate(own):
            name = str(number or "")  # the arms are beside each other
            for old in ("arm", "pin", "motor"):
                one = one.replace(f'"{old}"', f'"{old}{name}"').replace(f'"{old}.', f'"{old}{name}.')
            for section, entries in json.loads(one).items():
                text.setdefault(section, {}).update(entries)
    if sensors:
        text["sensors"] = {"angle": {"type": "encoder", "joint": "pin", "counts": 1024, "rate": "100 Hz"}}
    if loop:
        text["parts"] |= {
            "coupler": {"mass": 0.5, "inertia": [0.1, 0.1, 0.1], "points": {"end": [1.0, 0, 0]}},
            "rocker": {"mass": 0.5, "inertia": [0.1, 0.1, 0.1], "points": {"end": [0, 0, -0.7]}},
        }
        text["ground"]["points"]["pivot"] = [1.0, 0, 0]
        text["joints"] |= {
            "knee": {"type": "revolute", "between": ["arm.tip", "coupler"], "axis": [0, 1, 0]},
            "rock": {"type": "revolute", "between": ["ground.pivot", "rocker"], "axis": [0, 1, 0]},
            "eye": {"type": "revolute", "between": ["coupler.end", "rocker.end"], "axis": [0, 1, 0]},
        }
    return parse_mechanism(json.dumps(text))


@pytest.mark.parametrize(
    ("actuators", "loop"),
    [((), True), (("drive",), False), *((names, number % 2 == 0) for number, names in enumerate(GROUPS))],
)
def test_a_member_that_starts_again_is_a_fresh_one(actuators, loop):
    """Bit for bit, with each kind of actuator, with sensors and loops, after other commands and efforts."""
    assert {name for group in GROUPS for name in group} == ACTUATORS.keys()
    mechanism = arm(*actuators, sensors=True, loop=loop)
    members = Ensemble(mechanism, 5)
    if members.command_names:
        members.set_commands(np.linspace(-0.4, 0.9, 5)[:, None] + np.zeros((5, len(members.command_names))))
    members.step(12)  # a multiple of the steps between two samples
    untouched = members.state[[0, 2, 4]]
    members.restart([1, 3])
    assert np.array_equal(members.state[[0, 2, 4]], untouched)
    single = Simulation(mechanism)
    for _ in range(3):
        if members.command_names:
            command = np.full(len(members.command_names), 0.7)
            members.set_commands(command)
            single.apply_command_values(command)
        members.step(31)
        single.step(31)
        for member in (1, 3):
            assert np.array_equal(members.q[member], single.q) and np.array_equal(members.u[member], single.u)


def test_commands_are_arrays_for_all_members_or_numbers_by_name():
    mechanism = arm("position servo")
    members = Ensemble(mechanism, 4)
    assert members.command_names == ("motor.position", "motor.velocity", "motor.effort")
    rows = np.arange(12.0).reshape(4, 3)
    members.set_commands(rows)
    assert np.array_equal(members.commands, rows)
    members.set_commands([0.1, 0.2, 0.3])
    assert members.commands.tolist() == [[0.1, 0.2, 0.3]] * 4
    members.set_commands({"motor": np.arange(4.0)})
    members.set_commands({"motor": {"effort": 5.0}})
    assert members.commands.tolist() == [[float(k), 0.2, 5.0] for k in range(4)]
    members.set_commands([{"motor": float(k)} for k in (3, 2, 1, 0)])
    assert members.commands[:, 0].tolist() == [3.0, 2.0, 1.0, 0.0]
    before = members.commands
    for wrong, words in (
        (np.zeros((3, 3)), "do not fit 4 members"),
        (np.zeros(2), "do not fit 4 members"),
        ({"motor": [1.0, 2.0]}, "commands of motor.position do not fit"),
        ({"motor": {"voltage": 1.0}}, "takes no voltage"),
        ({"other": 1.0}, "no actuator 'other'"),
        (np.full((4, 3), np.nan), "not finite"),
        ([{"motor": 1.0}], "1 command for 4 members"),
    ):
        with pytest.raises(CommandError, match=words):
            members.set_commands(wrong)
    assert np.array_equal(members.commands, before)
