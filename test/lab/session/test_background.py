"""The file, or one that it includes, is saved while the mechanism runs."""

import random
from pathlib import Path

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.files.checks.override import with_values
from mbd_sim.lab.session.background import FileWatch
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession


class Edited:
    """A mechanism file, a session that runs it, and the watch on it."""

    def __init__(self, file, text, changes=None):
        self.file, self.text = file, text
        self.file.write_text(self.text, encoding="utf-8")
        mechanism = load_mechanism(self.file)
        mechanism = with_values(mechanism, changes) if changes else mechanism
        self.session = OwnSession(Bench.of(mechanism), running=False)
        self.problems = []
        self.watch = FileWatch(self.session.bench.simulation.mechanism, Bench.of, self._adopt, self.problems.append)

    def _adopt(self, bench):
        self.session.ask("adopt", lambda session: session.adopt(bench))

    def save(self, text, file=None):
        (file or self.file).write_text(text, encoding="utf-8")
        self.watch.look()
        self.session.turn()

    @property
    def simulation(self):
        return self.session.bench.simulation


@pytest.fixture
def edited(tmp_path, monkeypatch):
    """The four-bar in a file whose path is the same in all tests, which build it once."""
    monkeypatch.chdir(tmp_path)
    return Edited(Path("edited.yaml"), load_mechanism("four_bar").source.text)


def test_the_state_of_what_has_the_same_names_is_kept(edited):
    edited.session.step(700)
    before = edited.session.bench.simulation
    edited.save(edited.text.replace("density: 1 ", "density: 2 "))
    after = edited.session.bench.simulation
    assert after is not before
    assert after.mechanism.mass == pytest.approx(2.0 * before.mechanism.mass)
    assert after.q == pytest.approx(before.q, abs=1e-9)
    assert after.u == pytest.approx(before.u, abs=1e-8)
    assert after.time == before.time
    assert edited.session.frame.generation == 2


def test_other_lengths_are_assembled_near_the_present_positions(edited):
    edited.session.step(300)
    before = edited.session.bench.simulation.q.copy()
    edited.save(edited.text.replace("coupler: 1.4 m", "coupler: 1.45 m"))
    simulation = edited.session.bench.simulation
    assert simulation.violation.position < 1e-9
    assert np.max(np.abs(simulation.q - before)) < 0.3


def test_moved_sliders_stay_as_far_as_the_file_does_not_say_otherwise(tmp_path):
    text = load_mechanism("four_bar").source.text
    edited = Edited(tmp_path / "edited.yaml", text, {"parameters.density": 3.0})
    edited.session.change("parameters.coupler", 1.35)
    edited.session.change("parameters.rocker", 1.25)
    edited.session.bench.simulation.set_efforts({"crank_pivot": 2.0})
    edited.save(edited.text.replace("rocker: 1.2 m", "rocker: 1.22 m"))
    live = edited.simulation.live
    assert (live["parameters.coupler"], live["parameters.rocker"], live["parameters.density"]) == (1.35, 1.22, 3.0)
    assert edited.simulation.efforts[0] == 2.0
    assert edited.simulation.violation.position < 1e-9


def test_the_energy_account_goes_on(edited):
    edited.session.bench.simulation.set_efforts({"crank_pivot": 2.0})
    edited.session.step(500)
    before = edited.simulation.energies
    edited.save(edited.text.replace("density: 1 ", "density: 2 "))
    after = edited.simulation.energies
    assert after.work_applied == before.work_applied != 0.0
    assert after.residual == pytest.approx(before.residual, abs=1e-12)
    edited.session.step(500)
    assert abs(edited.simulation.energies.residual) < 1e-9


OF_ALL_KINDS = """
mechanism: of_all_kinds
parts:
  support: {mass: 1}
  rod: {shape: {type: rod, to: [0, 0, -1], mass: 1}}
  arm: {shape: {type: rod, to: [0, 0, -0.4], mass: 1}}
  body: {mass: 1, inertia: [1, 2, 3]}
  ball: {shape: {type: particle, mass: 1, radius: 0.04}}
joints:
  shaker: {type: prismatic, between: [ground, support], axis: [1, 0, 0], drive: 0.1*sin(5*t)}
  pin: {type: revolute, between: [support, rod], axis: [0, -1, 0], position: 0.3}
  shaft: {type: revolute, between: [ground, arm], axis: [0, -1, 0], damping: 0.02}
  flight: {type: free, between: [ground, body], angular_velocity: [0.01, 2, 0.01]}
  height: {type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: 0.05}
actuators:
  motor: {type: effort, joint: shaft, effort_limit: 20, delay: 4 ms, servo: {controls: velocity, kp: 3, ki: 5, sample_rate: 100}, command: {velocity: 0.5}}
constraints:
  floor: {type: on_plane, point: ball, bound: at_least, restitution: 0.5}
integrator: {step: 1 ms}
"""


def test_a_file_that_only_looks_different_changes_nothing(tmp_path):
    """Drives that are functions of time, integrals of servos, contacts and orientations go on with the same bits."""
    edited = Edited(tmp_path / "edited.yaml", OF_ALL_KINDS)
    edited.simulation.set_commands({"motor": 0.8})
    edited.session.step(148)
    edited.simulation.set_commands({"motor": 0.7})
    edited.session.step(2)  # the command before is on its way
    assert edited.simulation.contact_events  # the ball has rebounded
    before = edited.simulation
    edited.save(edited.text + "\n# a remark\n")
    after = edited.simulation
    assert after is not before
    assert np.array_equal(after.state, before.state)
    assert np.array_equal(after.inputs, before.inputs)
    assert after.time == before.time
    assert edited.session.message == "the file was read again"


URDF = """<robot name="r"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pin" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""
SDF = """<sdf version="1.9"><model name="arm"><link name="arm"><inertial><pose>0 0 -0.5 0 0 0</pose><mass>1</mass>
<inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.01</izz></inertia></inertial></link>
<joint name="pin" type="revolute"><parent>world</parent><child>arm</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>"""
WORLD = """<sdf version="1.9"><world name="w"><include><uri>arm.sdf</uri></include></world></sdf>"""
MESHED = """mechanism: meshed
parts: {block: {mass: 2, meshes: [{file: block.stl}]}}
joints: {pin: {type: revolute, between: [ground, block], axis: [0, 1, 0]}}
"""
MJCF = """<mujoco><include file="arm.xml"/></mujoco>"""
ARM = """<mujoco><worldbody><body name="arm"><joint name="pin" axis="0 1 0"/>
<geom type="box" size=".1 .1 .5" pos="0 0 -.5" mass="1"/></body></worldbody></mujoco>"""


def stl(side):
    """A tetrahedron as text."""
    corners = np.vstack([np.zeros(3), side * np.eye(3)])
    faces = [corners[list(face)] for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    lines = [
        "\n".join(
            ["facet normal 0 0 0", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in face), "endloop", "endfacet"]
        )
        for face in faces
    ]
    return "\n".join(["solid block", *lines, "endsolid block"])


INCLUDED = {
    "urdf": ("main.yaml", "mechanism: robot\nurdf: arm.urdf\n", "arm.urdf", URDF, 'mass value="1"', 'mass value="3"'),
    "sdf": ("main.sdf", WORLD, "arm.sdf", SDF, "<mass>1<", "<mass>3<"),
    "mjcf": ("main.xml", MJCF, "arm.xml", ARM, 'mass="1"', 'mass="3"'),
    "mesh": ("main.yaml", MESHED, "block.stl", stl(1.0), stl(1.0), stl(0.5)),
}


@pytest.mark.parametrize("kind", INCLUDED)
def test_files_that_are_included_are_followed_and_their_mistakes_are_told(kind, tmp_path):
    name, main, other, text, old, new = INCLUDED[kind]
    if kind == "mjcf":
        pytest.importorskip("mujoco")
    if kind == "mesh":
        pytest.importorskip("trimesh")
    included = tmp_path / other
    included.write_text(text, encoding="utf-8")
    edited = Edited(tmp_path / name, main)
    edited.session.step(100)
    choose, running, inertia = random.Random(7), edited.session.bench, edited.simulation.mass_matrix()[0, 0]
    for number in range(4):
        edited.save(text[: choose.randrange(20, len(text) - 40)] + "<", included)
        assert len(edited.problems) == number + 1, text
        assert edited.session.bench is running
        edited.session.step(10)
    q = edited.simulation.q.copy()
    edited.save(text.replace(old, new), included)
    assert edited.session.bench is not running
    assert abs(edited.simulation.mass_matrix()[0, 0] / inertia - 1.0) > 0.1
    assert np.array_equal(edited.simulation.q, q)
    edited.save(text, included)  # it is still followed
    assert edited.simulation.mass_matrix()[0, 0] == pytest.approx(inertia, rel=0.1)


def test_a_file_that_was_missing_is_found_when_it_appears(tmp_path):
    edited = Edited(tmp_path / "main.yaml", load_mechanism("simple_pendulum").source.text)
    edited.save("mechanism: robot\nurdf: arm.urdf\n")
    assert "there is no such file" in edited.problems[0]
    edited.save(URDF.replace("</robot>", "<robot>"), tmp_path / "arm.urdf")
    assert len(edited.problems) == 2
    edited.save(URDF, tmp_path / "arm.urdf")
    assert edited.simulation.mechanism.name == "robot"


def test_wrong_files_are_told_and_the_mechanism_goes_on(edited):
    """Six files with mistakes: lines cut off, words changed, numbers replaced."""
    choose, wrong = random.Random(5), 0
    running = edited.session.bench
    while wrong < 6:
        lines = edited.text.splitlines()
        at = choose.randrange(8, len(lines))
        lines[at] = choose.choice(
            [lines[at][: len(lines[at]) // 2] + " [", lines[at].replace("crank", "krank"), "  ?: }"]
        )
        text = "\n".join(lines) + "\n"
        count = len(edited.problems)
        edited.save(text)
        if len(edited.problems) > count:
            wrong += 1
            assert str(edited.file) in edited.problems[-1]
            assert edited.session.bench is running
        running = edited.session.bench
        edited.session.step(10)
    edited.save(edited.text + "\n")
    assert edited.session.bench is not running


def test_a_recording_goes_on_in_the_next_file(edited, tmp_path):
    edited.session.record(tmp_path / "run.mcap")
    edited.session.step(50)
    edited.save(edited.text.replace("density: 1 ", "density: 2 "))
    edited.session.step(50)
    edited.session.stop()
    assert sorted(path.name for path in tmp_path.glob("*.mcap")) == ["run.mcap", "run_part2.mcap"]
