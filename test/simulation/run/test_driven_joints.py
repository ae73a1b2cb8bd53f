"""Joints that drives move: where they start, and what is said of commands and positions for them and their followers."""

import argparse

import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.cli.runs.run import _summary
from mbd_sim.cli.shared.common import pace
from mbd_sim.cli.shared.setup_options import build_simulation
from mbd_sim.ros.commands.joint_commands import JointCommandRouter
from mbd_sim.ros.node.sim_parameters import start_values

DRIVE = "drive: {command: position, bandwidth: 50, upper: 0.5}"
SLIDES = f"""
mechanism: slides
gravity: [0, 0, 0]
parts: {{a: {{mass: 1}}, b: {{mass: 1}}, c: {{mass: 1}}, d: {{mass: 1}}, e: {{mass: 1}}}}
joints:
  left: {{type: prismatic, between: [ground, a], axis: [1, 0, 0], {DRIVE}}}
  right: {{type: prismatic, between: [ground, b], axis: [1, 0, 0]}}
  outer: {{type: prismatic, between: [ground, c], axis: [1, 0, 0]}}
  clock: {{type: prismatic, between: [ground, d], axis: [1, 0, 0], drive: 0.1*t}}
  loose: {{type: prismatic, between: [ground, e], axis: [1, 0, 0]}}
constraints:
  both: {{type: coupling, terms: {{left: 1, right: -2}}, follower: right}}
  next: {{type: coupling, terms: {{right: 1, outer: 1}}, follower: outer}}
"""


@pytest.fixture(scope="module")
def slides():
    return Simulation.from_text(SLIDES)


def positions(simulation):
    found = dict(zip(simulation.coordinate_names, simulation.q, strict=False))
    return found | {name: state.position for name, state in simulation.drives().items()}


def test_a_drive_that_follows_commands_starts_where_it_is_told_and_stays_with_its_followers(slides):
    slides.reset(q={"left": 0.3, "loose": 0.7})
    slides.step(50)
    expected = {"left": 0.3, "right": 0.15, "outer": -0.15, "loose": 0.7, "clock": 0.005}
    assert positions(slides) == pytest.approx(expected, abs=1e-12)
    slides.reset()
    assert positions(slides)["left"] == 0.0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda s: s.reset(q={"left": 0.6}), "left = 0.6 is beyond the range of its drive, -inf to 0.5. Give"),
        (lambda s: s.reset(u={"left": 0.6}), "begins at rest. Give left a position, or command its velocity."),
        (lambda s: s.reset(q={"left": 0.1, "right": 0.3}), "Name fewer joints"),
        (lambda s: s.reset(q={"clock": 0.1}), "Name only other joints."),
        (lambda s: s.reset(q={"lefd": 0.1}), "Did you mean 'left'? Others: clock, loose, outer, right."),
        (lambda s: s.set_state({"left": 0.1}), "Command its position, or start again from another one: reset(q={'left'"),
        (lambda s: s.set_efforts({"left": 0.1}), "accepts no effort. Command its position, velocity."),
        (lambda s: s.set_efforts({"clock": 0.1}), "accepts no effort. Command another joint."),
        (lambda s: s.set_efforts({"klock": 0.1}), "there is no joint 'klock'. Did you mean 'clock'?"),
    ],
)  # fmt: skip
def test_what_is_said_of_joints_with_drives(slides, call, words):
    with pytest.raises(CommandError) as caught:
        call(slides)
    assert words in str(caught.value)


def test_the_final_state_of_a_run_names_driven_joints_and_slow_runs_have_a_pace(slides):
    slides.reset(q={"left": 0.3})
    lines = _summary(slides, 50.0 * slides.step_size, "run").splitlines()
    assert [line.split()[0] for line in lines[-5:]] == ["right", "outer", "loose", "left", "clock"]
    assert lines[-2].split() == ["left", "0.3", "0", "(driven)"]
    assert [pace(0.1, 3.0), pace(2.0, 1.0), pace(12345.6, 1.0)] == ["0.0333", "2", "12,346"]


def test_the_parameter_start_of_a_node_places_drives(slides):
    assert start_values("left = 200 mm, loose = 1", {}, slides.model) == ({"left": 0.2, "loose": 1.0}, {})
    with pytest.raises(CommandError, match=r"start: there is no joint 'lefd'\. Did you mean 'left'"):
        start_values("lefd = 0.2", {}, slides.model)


@pytest.mark.parametrize("channel", ["position", "velocity", "effort"])
@pytest.mark.parametrize(("joint", "leader"), [("right", "left"), ("outer", "right")])
def test_followers_of_drives_take_no_commands_from_topics(slides, joint, leader, channel):
    router = JointCommandRouter(slides.effort_map, list(slides.command_map.takers.values()))
    with pytest.raises(
        CommandError, match=f"'{joint}' follows '{leader}', so that it takes no commands. Command {leader}"
    ):
        router.route([joint], {channel: [0.1]})
    with pytest.raises(CommandError, match="follows"):
        router.positioner(joint)
    assert router.route(["loose"], {"effort": [0.1]}).efforts == {"loose": 0.1}


@pytest.mark.parametrize(
    ("start", "left", "words"),
    [("left='200 mm'", 0.2, ""), ("left=0.7", 0.0, "joints.left.drive"), ("clock=0.7", 0.0, "drive=…")],
)
def test_the_option_start_places_drives(tmp_path, start, left, words):
    file = tmp_path / "slides.yaml"
    file.write_text(SLIDES)
    options = argparse.Namespace(
        mechanism=str(file), changes=[], start=[start.replace("'", "")], effort=[], method=None, step=None
    )
    if words:
        with pytest.raises(Exception, match=words):
            build_simulation(options)
    else:
        assert positions(build_simulation(options))["left"] == left
