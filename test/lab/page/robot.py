"""A robot from a URDF that stands on a floor: a trunk on two pairs of legs, each pair with a hip and two feet; one hip has a motor."""

PAIR = """
  <link name="{name}">
    <inertial><origin xyz="0 0 -0.15"/><mass value="1"/>
      <inertia ixx="0.02" iyy="0.01" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0.1 -0.15"/><geometry><box size="0.03 0.03 0.3"/></geometry></visual>
    <visual><origin xyz="0 -0.1 -0.15"/><geometry><box size="0.03 0.03 0.3"/></geometry></visual>
    <visual name="left"><origin xyz="0 0.1 -0.3"/><geometry><sphere radius="0.03"/></geometry></visual>
    <visual name="right"><origin xyz="0 -0.1 -0.3"/><geometry><sphere radius="0.03"/></geometry></visual>
  </link>
  <joint name="{name}_hip" type="revolute">
    <parent link="trunk"/><child link="{name}"/><origin xyz="{x} 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="40" velocity="10"/><dynamics damping="1"/>
  </joint>"""
URDF = f"""<robot name="walker">
  <link name="trunk">
    <inertial><mass value="6"/><inertia ixx="0.05" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="0.5 0.2 0.1"/></geometry></visual>
  </link>{PAIR.format(name="front", x=0.2)}{PAIR.format(name="rear", x=-0.2)}
</robot>
"""
OVERLAY = """
urdf: walker.urdf
base: free
parts:
  front: {points: {left: [0, 0.1, -0.33], right: [0, -0.1, -0.33]}}
  rear: {points: {left: [0, 0.1, -0.33], right: [0, -0.1, -0.33]}}
joints:
  base: {position: [0, 0, 0.33]}
  front_hip: {stiffness: 200}
  rear_hip: {stiffness: 200}
actuators:
  drive: {type: dc_motor, joint: rear_hip, torque_constant: 0.05, resistance: 0.8, gear_ratio: 20, control: voltage}
contacts:
  floor: {parts: [front.left, front.right, rear.left, rear.right], plane: ground, friction: 0.8, stiffness: 1e5, damping: 100}
"""


def standing_robot(folder):
    """The path of the mechanism file that puts the robot on a floor."""
    (folder / "walker.urdf").write_text(URDF, encoding="utf-8")
    file = folder / "walker.yaml"
    file.write_text(OVERLAY, encoding="utf-8")
    return file
