"""What `<ros2_control>` blocks do: random robots, whose joints take and keep what their interfaces say."""

import random
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from mbd_sim import Kinematics, Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.files.urdf.writer import PLUGIN, ControlTopics, to_urdf
from mbd_sim.mechanism.contents import commanded_drives

INTERFACES = ("position", "velocity", "effort")


def interface(kind, name, **parameters):
    inner = "".join(f'<param name="{key}">{value!r}</param>' for key, value in parameters.items())
    return f'<{kind} name="{name}">{inner}</{kind}>'


class RandomRobot:
    """A chain of joints in several systems, with random interfaces, ranges, starts, followers and sensors."""

    def __init__(self, seed):
        rng = self.rng = random.Random(seed)
        self.joints = [f"joint{number}" for number in range(rng.randint(3, 6))]
        self.commands = {name: rng.sample(INTERFACES, rng.randint(0, 3)) for name in self.joints}
        self.commands[self.joints[0]] = ["position"]
        self.start = {name: round(rng.uniform(-0.3, 0.3), 3) for name in self.joints if rng.random() < 0.6}
        self.ranges = {name: (-0.4, round(rng.uniform(0.4, 0.9), 3)) for name in self.joints if rng.random() < 0.5}
        self.follower = self.joints[-1] if rng.random() < 0.5 else None
        if self.follower:
            self.commands[self.follower] = []
            self.start.pop(self.follower, None)

    def urdf(self):
        parts, blocks = ['<link name="base"/>'], {"one": "", "two": ""}
        for number, name in enumerate(self.joints):
            kind = self.rng.choice(("revolute", "prismatic"))
            parent = "base" if number == 0 else f"link{number - 1}"
            mimic = f'<mimic joint="{self.joints[0]}" multiplier="-0.5" offset="0.1"/>' if name == self.follower else ""
            parts.append(
                f'<link name="link{number}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.2" izz="0.2"/></inertial>'
                f'</link><joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="link{number}"/>'
                f'<origin xyz="0.1 0.2 0.3"/><axis xyz="0 {number % 2} 1"/>{mimic}'
                '<limit lower="-0.6" upper="0.6" effort="9" velocity="3"/><dynamics damping="0.4"/></joint>'
            )
            lower, upper = self.ranges.get(name, (None, None))
            inner = "".join(
                interface(
                    "command_interface", one, **({"min": lower, "max": upper} if one != "velocity" and upper else {})
                )
                for one in self.commands[name]
            )
            start = {"initial_value": self.start[name]} if name in self.start else {}
            inner += interface("state_interface", "position", **start) + interface("state_interface", "velocity")
            blocks[self.rng.choice(["one", "two"])] += f'<joint name="{name}">{inner}</joint>'
        sensor = '<sensor name="wrist"><state_interface name="force.x"/><param name="frame_id">link1</param></sensor>'
        imu = '<sensor name="imu"><state_interface name="orientation.w"/><param name="frame_id">link2</param></sensor>'
        hardware = "<hardware><plugin>mock_components/GenericSystem</plugin></hardware>"
        systems = "".join(
            f'<ros2_control name="{name}" type="system">{hardware}{block}{sensor if name == "one" else imu}</ros2_control>'
            for name, block in blocks.items()
        )
        return f'<robot name="random">{"".join(parts)}{systems}</robot>'


@pytest.mark.parametrize(("seed", "preferred"), [(seed, ("position", "effort")[seed % 2]) for seed in range(6)])
def test_joints_of_random_robots_serve_what_their_interfaces_say(seed, preferred):
    robot = RandomRobot(seed)
    mechanism = parse_mechanism(robot.urdf(), "random.urdf", control=preferred)
    drives, poses = commanded_drives(mechanism), Kinematics(mechanism).poses()
    order = [preferred, *INTERFACES]
    for name in robot.joints:
        served = next((one for one in order if one in robot.commands[name]), None)
        assert (name in drives) == (served in ("position", "velocity")), name
        joint = mechanism.joints[name]
        if name in drives:
            assert drives[name].channels[0] == served
            assert drives[name].velocity_limit == 3.0
            lower, upper = robot.ranges.get(name, (-0.6, 0.6))
            if served == "position":
                assert (drives[name].lower, drives[name].upper) == (max(lower, -0.6), min(upper, 0.6))
        elif name != robot.follower:
            assert joint.position[0] == robot.start.get(name, 0.0)
            assert joint.damping[0] == 0.4 and joint.effort_limit == 9.0
    first = robot.start.get(robot.joints[0], 0.0)
    assert drives[robot.joints[0]].start == first
    if robot.follower:
        relative = poses[f"link{len(robot.joints) - 2}"].inverse() @ poses[f"link{len(robot.joints) - 1}"]
        assert coordinate(mechanism.joints[robot.follower], relative) == pytest.approx(0.1 - 0.5 * first, abs=1e-12)
    assert [(one.name, type(one).__name__) for one in mechanism.sensors] == [("wrist", "ForceTorque"), ("imu", "Imu")]
    again = parse_mechanism(mechanism_text(mechanism.source))  # as from a recording
    assert commanded_drives(again).keys() == drives.keys() and len(again.actuators) == len(mechanism.actuators)
    published = ElementTree.fromstring(to_urdf(mechanism, ControlTopics("/c", "/s")))
    blocks = [block for block in published.findall("ros2_control") if block.find("joint") is not None]
    assert {block.findtext("hardware/plugin") for block in blocks} == {PLUGIN}
    shown = {joint.get("name"): [one.get("name") for one in joint.findall("command_interface")]
             for block in blocks for joint in block.findall("joint")}  # fmt: skip
    assert set(shown) == set(robot.joints)
    for name in drives:
        assert shown[name] == list(drives[name].channels)


def coordinate(joint, relative):
    """The coordinate of a hinge or a slider from the pose of its second part in its first one."""
    axis = joint.axis / np.linalg.norm(joint.axis)
    if joint.type == "prismatic":
        return float(axis @ (relative.position - [0.1, 0.2, 0.3]))
    turn = relative.rotation
    sine = 0.5 * axis @ [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return float(np.arctan2(sine, 0.5 * (np.trace(turn) - 1.0)))


def test_without_control_the_blocks_do_not_act():
    mechanism = parse_mechanism(RandomRobot(1).urdf(), "random.urdf")
    assert not commanded_drives(mechanism) and not mechanism.sensors
    assert any(
        note.startswith("<ros2_control>, which acts with --control: one, two") for note in mechanism.source.notes
    )


ARM = (
    '<robot name="arm"><link name="base"/><link name="a"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1"/></inertial></link><joint name="j" type="revolute"><parent link="base"/>'
    '<child link="a"/><limit lower="0.2" upper="1" effort="5" velocity="2"/></joint>{}</robot>'
)


def block(inner):
    return ARM.format(f'<ros2_control name="s" type="system">{inner}</ros2_control>')


def test_a_drive_starts_within_its_range_and_holds_against_gravity():
    text = block('<joint name="j"><command_interface name="position"/></joint>')
    mechanism = parse_mechanism(text, "arm.urdf", control="position")
    simulation = Simulation(mechanism)
    simulation.step(100)
    assert commanded_drives(mechanism)["j"].start == 0.2
    assert any("start positions out of the range, here at its end: j" in note for note in mechanism.source.notes)


def test_what_is_not_read_is_named():
    text = block(
        "<hardware><plugin>x/Y</plugin><param name='port'>3</param></hardware><gpio name='io'/>"
        '<joint name="j"><command_interface name="position"><param name="kp">3</param></command_interface>'
        '<command_interface name="effort"/><command_interface name="stiffness"/><state_interface name="temperature"/></joint>'
        '<sensor name="lidar"><state_interface name="range"/></sensor>'
        '<sensor name="lost"><state_interface name="force.x"/><param name="frame_id">nowhere</param></sensor>'
        '<transmission name="t"><plugin>transmission_interface/SimpleTransmission</plugin></transmission>'
    )
    notes = " | ".join(parse_mechanism(text, "arm.urdf", control="position").source.notes)
    for named in (
        "s: x/Y", "s: port", "<gpio> of <ros2_control>: io", "j/position kp", "beside the one that acts: j/effort",
        "j/stiffness", "j/temperature", "lidar/range", "lost (nowhere)", "commands and states are those of the joints: t",
    ):  # fmt: skip
        assert named in notes, named


@pytest.mark.parametrize(
    ("inner", "expected"),
    [
        ('<joint name="k"/>', "<ros2_control name='s'> has a joint 'k', which the robot does not have. Valid: "),
        ('<joint name="j"/><joint name="j"/>', "the joint 'j' is in the blocks s and s"),
        ('<joint name="j"><command_interface name="effort"><param name="min">a</param></command_interface></joint>',
         "j/effort min: 'a' is not a number"),
        ('<joint name="j"><command_interface name="effort" min="2" max="1"/></joint>', "min 2 is not below max 1"),
    ],
)  # fmt: skip
def test_mistakes_are_answered_with_names_and_remedies(inner, expected):
    with pytest.raises(MechanismError, match=re.escape(expected)):
        parse_mechanism(block(inner), "arm.urdf", control="position")


def test_mistakes_stand_at_the_line_of_the_joint_in_the_block():
    text = block('\n<joint name="j"/>\n<joint name="k"/>\n\n')
    with pytest.raises(MechanismError, match=re.escape("arm.urdf:3: ros2_control[s].joint[k]: <ros2_control")):
        parse_mechanism(text, "arm.urdf", control="position")


def test_a_mechanism_file_has_the_key_and_keeps_its_own_actuators(tmp_path):
    (tmp_path / "arm.urdf").write_text(block('<joint name="j"><command_interface name="position"/></joint>'))
    path = tmp_path / "arm.yaml"
    path.write_text("urdf: arm.urdf\ncontrol: position\n")
    assert "j" in commanded_drives(load_mechanism(path))
    path.write_text("urdf: arm.urdf\ncontrol: position\nactuators: {m: {type: effort, joint: j}}\n")
    mechanism = load_mechanism(path)
    assert not commanded_drives(mechanism) and [one.name for one in mechanism.actuators] == ["m"]
    with pytest.raises(MechanismError, match="no <ros2_control> block"):
        load_mechanism("rod_pendulum", control="position")


IMU = '<sensor name="a"><state_interface name="orientation.x"/></sensor>'


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("{rate: 50 Hz}", (50, True)),
        ("{rate: 20 Hz, orientation: }", (20, False)),
        ("{type: imu, at: base, rate: 50 Hz}", (50, True)),
        ("{type: force_torque, joint: j, rate: 10 Hz}", (10, None)),  # another sensor, which is as it is written
    ],
)
def test_sensors_of_the_block_are_merged_key_by_key(tmp_path, keys, expected):
    (tmp_path / "arm.urdf").write_text(block(IMU))
    path = tmp_path / "arm.yaml"
    path.write_text(f"urdf: arm.urdf\ncontrol: position\nsensors: {{a: {keys}}}\n")
    (sensor,) = load_mechanism(path).sensors
    assert sensor.sampling.rate == pytest.approx(expected[0])
    assert getattr(sensor, "orientation", None) is expected[1]


@pytest.mark.parametrize(("most", "own", "limit"), [(3, 5, 3), (7, 5, 5)])
def test_symmetric_ranges_of_efforts_are_effort_limits_and_others_are_actuators_with_a_remark(most, own, limit):
    text = '<joint name="j"><command_interface name="effort" min="{}" max="{}"/></joint>'
    mechanism = parse_mechanism(block(text.format(-most, most)), "arm.urdf", control="effort")
    assert not mechanism.actuators and mechanism.joints["j"].effort_limit == limit <= own
    mechanism = parse_mechanism(block(text.format(-1, most)), "arm.urdf", control="effort")
    assert len(mechanism.actuators) == 1
    assert any("actuator_timeout ends their commands: j" in remark for remark in mechanism.source.remarks)
