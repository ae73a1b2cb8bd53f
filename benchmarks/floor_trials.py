"""Real robots on a floor with simple controllers: standing, landing, walking, grasping and pressing.

They come from the packages `example-robot-data` and `gymnasium`; the hand on a table is an SDF of our own. Springs and
dampers hold their joints, and motors add the efforts of a gait or a grip. URDF files lack the inertias of rotors,
without which a damper of a humanoid's ankle acts within microseconds; where it matters, the trial gives them. Friction
of held joints is left out, because MuJoCo's is soft.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.robots import robots_folder
from mbd_sim import Kinematics, load_mechanism
from mbd_sim.base.geometry.rotation import to_quaternion
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.on_floor import on_floor
from mbd_sim.mechanism.mechanism import Mechanism

Commands = Callable[[float], Mapping[str, float]]


def silent(_: float) -> Mapping[str, float]:
    """No commands."""
    return {}


@dataclass(frozen=True)
class Trial:
    """A robot and its task. `build` gives its mechanism, `commands` what its motors get at a time."""

    format: str
    task: str
    build: Callable[[], Mechanism]
    commands: Commands = silent
    watch: tuple[str, ...] = ()  # coordinates to show; by default those of the first joint


def robot_file(path: str) -> str:
    """A file of `example-robot-data`."""
    folder = robots_folder()
    if folder is None:
        raise SystemExit("Install example-robot-data.")
    return str(folder / path)


def gymnasium_file(name: str) -> str:
    """A model of `gymnasium`."""
    import gymnasium

    return str(Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets" / name)


def held(mechanism: Mechanism, pose: Mapping[str, float], stiffness: float, damping: float) -> dict[str, Any]:
    """Changes that hold each hinge and slider at a pose, from which it starts."""
    changes: dict[str, Any] = {}
    coupled = {name for one in mechanism.source.data.get("constraints", {}).values() for name in one.get("terms", {})}
    for joint in mechanism.joints.values():
        if joint.type not in ("revolute", "prismatic") or joint.name in coupled or joint.drive or "root" in joint.name:
            continue
        rest = next((value for key, value in pose.items() if key in joint.name), 0.0)
        changes |= {
            f'joints."{joint.name}".position': rest,
            f'joints."{joint.name}".rest': rest,
            f'joints."{joint.name}".stiffness': stiffness,
            f'joints."{joint.name}".damping': damping,
            f'joints."{joint.name}".friction': None,
        }
    return changes


def rotors(mechanism: Mechanism, inertia: float) -> dict[str, Any]:
    """Actuators whose rotors add an inertia to each hinge, and which exert nothing."""
    hinges = [joint.name for joint in mechanism.joints.values() if joint.type == "revolute" and not joint.drive]
    return {name: {"type": "effort", "joint": name, "rotor_inertia": inertia} for name in hinges}


def _raised(mechanism: Mechanism, height: float) -> dict[str, Any]:
    """Changes that lift a robot: its free joint, or the slider of a planar one."""
    for name, joint in mechanism.joints.items():
        start = mechanism.source.data["joints"][name].get("position", [0.0] * 3)
        if joint.type == "free":
            return {f"joints.{name}.position": [*start[:2], start[2] + height]}
        if joint.type == "prismatic" and abs(joint.axis[2]) == 1.0:
            return {f"joints.{name}.position": start + height}
    raise ValueError("it has no base")


def trot(robot: Mapping[str, tuple[str, str]], stiffness: float, rate: float, swing: float, lift: float) -> Commands:
    """Efforts that move diagonal legs together: the hip forward and back, the knee up while the leg swings.

    :param robot: for each leg its hip and its knee; the first and the fourth leg go together.
    """

    def commands(time: float) -> Mapping[str, float]:
        found = {}
        ramp = min(1.0, time)
        for number, (hip, knee) in enumerate(robot.values()):
            phase = 2.0 * math.pi * rate * time + (0.0 if number in (0, 3) else math.pi)
            raised = lift * max(0.0, math.sin(phase))
            found[hip] = ramp * stiffness * (swing * math.cos(phase) + 0.5 * raised)
            found[knee] = -ramp * stiffness * raised
        return found

    return commands


A1_LEGS = {leg: (f"{leg}_thigh_joint", f"{leg}_calf_joint") for leg in ("FL", "FR", "RL", "RR")}

GRIPPER = """<sdf version="1.9"><world name="cell"><gravity>0 0 -9.81</gravity>
<model name="table"><static>true</static><pose>0 0 -0.05 0 0 0</pose><link name="top">
 <collision name="slab"><geometry><box><size>0.6 0.6 0.1</size></box></geometry>
  <surface><friction><ode><mu>0.6</mu></ode></friction></surface></collision></link></model>
<model name="hand"><link name="palm"><pose>0 0 0.15 0 0 0</pose><inertial><mass>1</mass>
   <inertia><ixx>0.002</ixx><iyy>0.002</iyy><izz>0.002</izz></inertia></inertial></link>
 <joint name="lift" type="prismatic"><parent>world</parent><child>palm</child><axis><xyz>0 0 1</xyz>
   <dynamics><spring_stiffness>5000</spring_stiffness><damping>200</damping></dynamics></axis></joint>
 FINGERS</model>
<model name="brick"><pose>0 0 0.025 0 0 0</pose><link name="body"><inertial><mass>0.3</mass>
   <inertia><ixx>0.000125</ixx><iyy>0.000125</iyy><izz>0.000125</izz></inertia></inertial>
 <collision name="cube"><geometry><box><size>0.05 0.05 0.05</size></box></geometry></collision></link></model>
</world></sdf>"""
FINGER = """<link name="NAME"><pose>0 Y 0.045 0 0 0</pose><inertial><mass>0.1</mass>
  <inertia><ixx>0.0001</ixx><iyy>0.0001</iyy><izz>0.0001</izz></inertia></inertial>
 <collision name="pad"><geometry><box><size>0.02 0.01 0.06</size></box></geometry></collision></link>
 <joint name="NAME_slide" type="prismatic"><parent>palm</parent><child>NAME</child><axis><xyz>0 1 0</xyz>
  <dynamics><damping>40</damping></dynamics></axis></joint>"""
MOTORS = ("lift", "left", "right")
SLIP = 19.9  # s, when grippers let go so much that what they hold slips


def sdf_gripper() -> Mechanism:
    """A hand with two fingers over a brick on a table."""
    sides = (("left", "0.03"), ("right", "-0.03"))
    fingers = "".join(FINGER.replace("NAME", name).replace("Y", y) for name, y in sides)
    found = on_floor(parse_mechanism(GRIPPER.replace("FINGERS", fingers)))
    contacts = {name: record for name, record in found.source.data["contacts"].items() if "brick" in name}
    for side, _ in sides:
        contacts[f"grasp_{side}"] = {"between": ["brick::body", f"hand::{side}"], "friction": 0.6}
    sliders = [joint.name for joint in found.joints.values() if joint.type == "prismatic"]
    motors = {name: {"type": "effort", "joint": slider} for name, slider in zip(MOTORS, sliders, strict=True)}
    return with_values(found, {"contacts": contacts, "actuators": motors})


def grasp_and_lift(time: float) -> Mapping[str, float]:
    """Close, lift 0.15 m, hold, and let it slip."""
    force = 10.0 if time < SLIP else 2.0
    height = 0.15 * min(1.0, max(0.0, (time - 1.0) / 2.0))
    return {"lift": 5000.0 * height + 1.2 * 9.81, "left": -force, "right": force}


PANDA = {"joint2": -0.3, "joint4": -2.2, "joint6": 1.9, "joint7": 0.785}


def panda_grasps() -> Mechanism:
    """The hand of a Panda around a block of 0.5 kg."""
    arm = load_mechanism(robot_file("panda_description/urdf/panda.urdf"))
    changes = held(arm, PANDA, 500.0, 10.0)
    for name in ("panda_joint5", "panda_joint6", "panda_joint7"):
        changes |= {f'joints."{name}".stiffness': 200.0, f'joints."{name}".damping': 1.0}
    for name in ("panda_finger_joint1", "panda_finger_joint2"):
        changes |= {
            f'joints."{name}".position': 0.02002,
            f'joints."{name}".rest': 0.0,
            f'joints."{name}".stiffness': 0.0,
            f'joints."{name}".damping': 20.0,
        }
    arm = with_values(arm, changes)
    tool = Kinematics(arm).poses()["panda_hand_tcp"]
    data = arm.source.data
    block = {"shape": {"type": "block", "size": [0.04, 0.04, 0.04], "mass": 0.5}}
    base = {
        "type": "free",
        "between": ["ground", "block"],
        "position": tool.position.tolist(),
        "orientation": {"quaternion": to_quaternion(tool.rotation).tolist()},
    }
    tip = arm.parts["panda_leftfinger"].touching[-1].name or "shape4"
    tips = {side: {"between": ["block", f"panda_{side}finger.{tip}"], "friction": 0.5} for side in ("left", "right")}
    return with_values(
        arm,
        {
            "parts": {**data["parts"], "block": block},
            "joints": {**data["joints"], "block": base},
            "contacts": tips,
            "actuators": {"squeeze": {"type": "effort", "joint": "panda_finger_joint1"}},
        },
    )


def squeeze(time: float) -> Mapping[str, float]:
    """The effort of both fingers together; half of it presses on each side."""
    return {"squeeze": -20.0 if time < SLIP else -8.0}


def z1_presses() -> Mechanism:
    """An arm whose gripper presses on a floor: its springs rest below it."""
    arm = load_mechanism(robot_file("z1_description/urdf/z1.urdf"), hulls=True)
    pose = {"joint2": 1.9, "joint3": -1.0, "joint4": -0.3}
    changes = held(arm, pose, 200.0, 4.0) | {'joints."joint2".rest': 2.6}
    for name in ("joint5", "joint6"):
        changes |= {f'joints."{name}".stiffness': 20.0, f'joints."{name}".damping': 0.1}
    joints = arm.source.data["joints"]
    jaw = {"type": "fixed", "between": joints["jointGripper"]["between"]}  # whose inertia is too small for a damper
    changes = {name: value for name, value in changes.items() if "Gripper" not in name}
    arm = with_values(arm, {"joints": {**joints, "jointGripper": jaw}})
    touching = [name for name, part in arm.parts.items() if part.touching]
    floor = {
        "parts": [name for name in touching if "ripper" in name or name == "link06"],
        "plane": "ground",
        "friction": 0.4,
    }
    return with_values(arm, changes | {"contacts": {"floor": floor}, "actuators": rotors(arm, 0.02)})


def standing(
    file: Callable[[], str],
    pose: Mapping[str, float],
    stiffness: float,
    damping: float,
    more: Mapping[str, Any] | None = None,
    raised: float = 0.0,
    motors: Sequence[str] = (),
    rotor: float = 0.0,
    feet: Sequence[str] = (),
) -> Callable[[], Mechanism]:
    """Builds a robot on the floor that is held at a pose, with everything or only its `feet` touching the floor."""

    def build() -> Mechanism:
        path = file()
        mechanism = load_mechanism(path, base=None if path.endswith(".xml") else "free", hulls=True)
        changes = held(mechanism, pose, stiffness, damping) | dict(more or {})
        if rotor:
            changes["actuators"] = rotors(mechanism, rotor)
        if feet:
            changes["contacts"] = {"floor": {"parts": list(feet), "plane": "ground", "friction": 0.8}}
        found = on_floor(mechanism, changes)
        if raised:
            found = with_values(found, _raised(found, raised))
        if motors:
            found = with_values(found, {"actuators": {name: {"type": "effort", "joint": name} for name in motors}})
        return found

    return build


TRIALS = {
    "a1_stands": Trial(
        "URDF",
        "quadruped stands",
        standing(lambda: robot_file("a1_description/urdf/a1.urdf"), {"thigh": 0.8, "calf": -1.6}, 60.0, 2.0),
    ),
    "go2_stands": Trial(
        "URDF",
        "quadruped stands",
        standing(lambda: robot_file("go2_description/urdf/go2.urdf"), {"thigh": 0.8, "calf": -1.6}, 60.0, 2.0),
    ),
    "solo12_stands": Trial(
        "URDF",
        "quadruped stands",
        standing(
            lambda: robot_file("solo_description/robots/solo12.urdf"),
            {
                "FL_HFE": 0.7,
                "FR_HFE": 0.7,
                "HL_HFE": -0.7,
                "HR_HFE": -0.7,
                "FL_KFE": -1.4,
                "FR_KFE": -1.4,
                "HL_KFE": 1.4,
                "HR_KFE": 1.4,
            },
            5.0,
            0.1,
        ),
    ),
    "talos_stands": Trial(
        "URDF",
        "biped stands",
        standing(
            lambda: robot_file("talos_data/robots/talos_reduced_box.urdf"),
            {
                "leg_left_3": -0.411354,
                "leg_left_4": 0.859395,
                "leg_left_5": -0.448041,
                "leg_right_3": -0.411354,
                "leg_right_4": 0.859395,
                "leg_right_5": -0.448041,
                "arm_left_4": -0.5,
                "arm_right_4": -0.5,
            },
            3000.0,
            50.0,
            rotor=0.5,
        ),
    ),
    "g1_stands": Trial(
        "URDF",
        "biped stands",
        standing(
            lambda: robot_file("g1_description/urdf/g1_29dof_rev_1_0.urdf"),
            {"hip_pitch": -0.2, "knee": 0.42, "ankle_pitch": -0.23},
            500.0,
            10.0,
            rotor=0.05,
        ),
    ),
    "cassie_stands": Trial(
        "SDF", "biped stands", standing(lambda: robot_file("cassie_description/robots/cassie_v2.sdf"), {}, 1000.0, 20.0)
    ),
    "ant_stands": Trial(
        "MJCF",
        "quadruped stands",
        standing(
            lambda: gymnasium_file("ant.xml"),
            {"ankle_1": 1.0, "ankle_4": 1.0, "ankle_2": -1.0, "ankle_3": -1.0},
            30.0,
            3.0,
        ),
    ),
    "hopper_lands": Trial(
        "MJCF",
        "lands on its foot",
        standing(
            lambda: gymnasium_file("hopper.xml"), {"thigh": 0.2, "leg": -0.4, "foot": 0.2}, 1500.0, 40.0, raised=0.2
        ),
    ),
    "walker2d_lands": Trial(
        "MJCF",
        "planar biped lands",
        standing(
            lambda: gymnasium_file("walker2d_v5.xml"),
            {"thigh": 0.1, "leg": -0.4, "foot": 0.3},
            1500.0,
            40.0,
            raised=0.1,
        ),
    ),
    "humanoid_falls": Trial("MJCF", "biped falls", standing(lambda: gymnasium_file("humanoid.xml"), {}, 1000.0, 20.0)),
    "a1_trots": Trial(
        "URDF",
        "quadruped trots",
        standing(
            lambda: robot_file("a1_description/urdf/a1.urdf"),
            {"thigh": 0.8, "calf": -1.6},
            60.0,
            2.0,
            motors=[name for leg in A1_LEGS.values() for name in leg],
            feet=[f"{leg}_foot" for leg in A1_LEGS],
        ),
        trot(A1_LEGS, 60.0, 2.0, 0.3, 0.4),
    ),
    "gripper_lifts": Trial(
        "SDF",
        "hand with two fingers lifts a brick off a table, lets it slip",
        sdf_gripper,
        grasp_and_lift,
        ("brick::body_base", "lift"),
    ),
    "panda_grasps": Trial("URDF", "arm holds a block, lets it slip", panda_grasps, squeeze, ("block",)),
    "z1_presses": Trial("URDF", "arm hits the floor and presses on it", z1_presses, silent, ("joint2", "joint3")),
}
