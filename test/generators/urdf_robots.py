"""URDFs of a 7-axis arm and of a quadruped with 12 joints, with numbers of their own, and their energies by hand."""

import xml.etree.ElementTree as ElementTree

import numpy as np

from mbd_sim.base.geometry.rotation import about, from_quaternion, from_rpy


def inertial(mass, xyz, rpy, moments):
    xx, yy, zz, xy, xz, yz = moments
    return f"""
    <inertial>
      <origin xyz="{xyz}" rpy="{rpy}"/>
      <mass value="{mass}"/>
      <inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"/>
    </inertial>"""


def arm():
    """A 7-axis arm on a pedestal, with frames that turn between the joints, and a massless flange and tool."""
    turns = ["0 0 0", "-1.5708 0 0", "1.5708 0 0.1", "1.5708 0 0", "-1.5708 0 0", "1.5708 0.05 0", "1.5708 0 0"]
    places = ["0 0 0.33", "0 0 0", "0 -0.31 0", "0.08 0 0", "-0.08 0.38 0", "0 0 0", "0.09 0 0"]
    axes = ["0 0 1", "0 0 2", "0 0 1", "0 0 -1", "0 0.6 0.8", "0 0 1", "0 0 1"]
    masses = [4.9, 0.65, 3.2, 3.6, 1.2, 1.7, 0.74]
    text = '<?xml version="1.0"?>\n<robot name="seven_axes">\n  <link name="base_link"/>\n  <link name="pedestal">'
    text += inertial(20.0, "0 0 0.15", "0 0 0", (0.4, 0.5, 0.3, 0, 0, 0)) + "\n  </link>"
    text += '\n  <joint name="mount" type="fixed">\n    <parent link="base_link"/>\n    <child link="pedestal"/>\n  </joint>'
    for i, (turn, place, axis, mass) in enumerate(zip(turns, places, axes, masses, strict=True)):
        moments = np.array([0.07, 0.06, 0.05, 0.004, -0.007, 0.01]) * mass / 3.0
        parent = f"link{i}" if i else "pedestal"
        text += f"""
  <link name="link{i + 1}">{inertial(mass, f"0.0{i} -0.02 {0.03 * i}", f"0.{i} -0.2 0.4", moments)}
    <visual>
      <origin xyz="0 0 0.1" rpy="0.3 0 0"/>
      <geometry><cylinder radius="0.05" length="0.2"/></geometry>
      <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
    </visual>
    <visual><geometry><mesh filename="package://arm/meshes/link{i + 1}.dae"/></geometry></visual>
  </link>
  <joint name="axis{i + 1}" type="revolute">
    <origin xyz="{place}" rpy="{turn}"/>
    <parent link="{parent}"/>
    <child link="link{i + 1}"/>
    <axis xyz="{axis}"/>
    <limit lower="-2.{i}" upper="2.8" effort="{90 - 10 * i}" velocity="2.5"/>
    <dynamics damping="0.{i + 1}" friction="0.0{i}"/>
  </joint>"""
    for parent, child, place in (("link7", "flange", "0 0 0.1"), ("flange", "tool0", "0 0.02 0.05")):
        text += f"""
  <link name="{child}"/>
  <joint name="{parent}-{child}" type="fixed">
    <origin xyz="{place}" rpy="0 0 -0.7854"/>
    <parent link="{parent}"/>
    <child link="{child}"/>
  </joint>"""
    return text + "\n</robot>\n"


def quadruped():
    """A trunk with four legs of three joints each; a massless root, a rotor and feet that are welded on."""
    text = '<robot name="four_legs">\n  <link name="base"/>\n  <link name="trunk">'
    text += inertial(6.9, "0.02 0.001 -0.005", "0 0 0.1", (0.025, 0.098, 0.107, 0.0001, 0.002, -3e-5)) + "\n  </link>"
    text += '\n  <joint name="floating_base" type="fixed">\n    <parent link="base"/>\n    <child link="trunk"/>\n  </joint>'
    for leg, x, y in (("FL", 1, 1), ("FR", 1, -1), ("RL", -1, 1), ("RR", -1, -1)):
        links = (
            ("hip", "trunk", f"{0.193 * x} {0.047 * y} 0", "1 0 0", 0.68, f"{-0.005 * x} {0.002 * y} 0", 5e-4),
            ("thigh", "hip", f"0 {0.095 * y} 0", "0 1 0", 1.15, f"-0.004 {-0.022 * y} -0.033", 6e-3),
            ("calf", "thigh", "0 0 -0.213", "0 1 0", 0.15, "0.005 0 -0.13", 1.4e-3),
        )
        for name, parent, place, axis, mass, center, size in links:
            parent = parent if parent == "trunk" else f"{leg}_{parent}"
            moments = (size, 1.1 * size, 0.3 * size, 0.02 * size * y, 0.01 * size * x, -0.01 * size)
            text += f"""
  <link name="{leg}_{name}">{inertial(mass, center, "0.1 0 0", moments)}
  </link>
  <joint name="{leg}_{name}_joint" type="{"continuous" if name == "hip" else "revolute"}">
    <origin rpy="0 0 0" xyz="{place}"/>
    <parent link="{parent}"/>
    <child link="{leg}_{name}"/>
    <axis xyz="{axis}"/>
    <limit lower="-2.7" upper="4.2" effort="23.7" velocity="30.1"/>
  </joint>"""
        for name, parent, place, mass, size in (
            ("foot", "calf", "0 0 -0.213", 0.04, 1e-5),
            ("rotor", "hip", "0 0.04 0", 0.09, 1e-4),
        ):
            text += f"""
  <link name="{leg}_{name}">{inertial(mass, "0 0 0", "0 0 0", (size, 1.5 * size, size, 0, 0, 0))}
    <visual><geometry><sphere radius="0.02"/></geometry></visual>
  </link>
  <joint name="{leg}_{name}_joint" type="fixed">
    <origin xyz="{place}"/>
    <parent link="{leg}_{parent}"/>
    <child link="{leg}_{name}"/>
  </joint>"""
    return text + "\n</robot>\n"


def numbers(element, name, default=(0.0, 0.0, 0.0)):
    return np.array([float(word) for word in element.get(name).split()] if element is not None else default)


def origin_of(element):
    origin = element.find("origin")
    if origin is None:
        return np.zeros(3), np.eye(3)
    xyz, rpy = (
        numbers(origin, name) if origin.get(name) else np.zeros(3)
        for name in ("xyz", "rpy")
    )  # fmt: skip
    return xyz, from_rpy(*rpy)


def energies(text, positions, speeds, base=None, gravity=(0.0, 0.0, -9.81)):
    """Kinetic and potential energy of a robot of fixed and axial joints, by walking its URDF.

    :param base: position, quaternion, velocity in ground's axes and angular velocity in its own axes of the root link.
    """
    robot = ElementTree.fromstring(text)
    joints = robot.findall("joint")
    children = {joint.find("child").get("link") for joint in joints}
    (root,) = (link.get("name") for link in robot.findall("link") if link.get("name") not in children)
    place, quaternion, velocity, omega = base or (np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3))
    turn = from_quaternion(quaternion)
    moving = {root: (place, turn, velocity, turn @ omega)}
    while len(moving) < len(joints) + 1:
        for joint in joints:
            parent, child, name = joint.find("parent").get("link"), joint.find("child").get("link"), joint.get("name")
            if parent not in moving or child in moving:
                continue
            place, turn, velocity, omega = moving[parent]
            xyz, rotation = origin_of(joint)
            arm, turned = turn @ xyz, turn @ rotation
            velocity = velocity + np.cross(omega, arm)
            place = place + arm
            if joint.get("type") != "fixed":
                axis = numbers(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
                axis = axis / np.linalg.norm(axis)
                if joint.get("type") == "prismatic":
                    slide = turned @ axis
                    velocity = velocity + np.cross(omega, slide * positions[name]) + slide * speeds[name]
                    place = place + slide * positions[name]
                else:
                    omega = omega + turned @ axis * speeds[name]
                    turned = turned @ about(axis, positions[name])
            moving[child] = (place, turned, velocity, omega)
    kinetic = potential = 0.0
    for link in robot.findall("link"):
        found = link.find("inertial")
        if found is None:
            continue
        mass = float(found.find("mass").get("value"))
        moments = {key: float(value) for key, value in found.find("inertia").attrib.items()}
        xx, yy, zz, xy, xz, yz = (moments[f"i{name}"] for name in ("xx", "yy", "zz", "xy", "xz", "yz"))
        place, turn, velocity, omega = moving[link.get("name")]
        xyz, rotation = origin_of(found)
        axes, arm = turn @ rotation, turn @ xyz
        spin = axes.T @ omega
        kinetic += 0.5 * mass * np.sum((velocity + np.cross(omega, arm)) ** 2)
        kinetic += 0.5 * spin @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ spin
        potential -= mass * np.dot(gravity, place + arm)
    return kinetic, potential
