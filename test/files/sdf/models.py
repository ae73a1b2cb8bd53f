"""SDF models for tests."""

# Poses relative to frames, nested models, axes in other frames, every type of joint that Drake knows, and springs.
ROBOT = """
<sdf version="1.9">
  <world name="hall">
    <gravity>0.1 0.2 -9.7</gravity>
    <frame name="table"><pose>1 2 0.5 0.1 0.2 0.3</pose></frame>
    <model name="robot">
      <pose relative_to="table">0.1 0 0.2 0 0 0.5</pose>
      <frame name="mount"><pose degrees="true">0 0.1 0 10 20 30</pose></frame>
      <link name="foot">
        <pose relative_to="mount">0 0 0.1 0.3 0 0</pose>
        <inertial><pose>0.1 0 0.05 0.2 0.3 0.4</pose><mass>2</mass>
          <inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.15</izz><ixy>0.01</ixy><ixz>-0.02</ixz><iyz>0.03</iyz></inertia>
        </inertial>
        <visual name="v"><pose>0 0 0.1 0 0 0</pose><geometry><box><size>0.1 0.2 0.3</size></box></geometry></visual>
      </link>
      <link name="arm">
        <pose rotation_format="quat_xyzw">0.2 0.3 0.4 0.1 0.3 0.3 0.9</pose>
        <inertial><mass>1.5</mass><inertia><ixx>0.02</ixx><iyy>0.03</iyy><izz>0.04</izz></inertia></inertial>
      </link>
      <link name="slider">
        <inertial><pose>0 0.1 0 0 0 0</pose><mass>0.7</mass>
          <inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.012</izz></inertia></inertial>
      </link>
      <joint name="hip" type="revolute">
        <pose relative_to="mount">0.05 0 0 0 0 0</pose>
        <parent>foot</parent><child>arm</child>
        <axis><xyz expressed_in="mount">0 1 1</xyz>
          <limit><lower>-1</lower><upper>2</upper><effort>30</effort><velocity>4</velocity></limit>
          <dynamics><damping>0.3</damping></dynamics></axis>
      </joint>
      <joint name="rail" type="prismatic">
        <pose>0.01 0.02 0.03 0.4 0.5 0.6</pose><parent>arm</parent><child>slider</child>
        <axis><xyz>1 2 0</xyz><dynamics><damping>0.2</damping></dynamics></axis>
      </joint>
      <model name="hand">
        <pose relative_to="slider">0.1 0 0 0 0.2 0</pose>
        <link name="palm"><inertial><mass>0.3</mass>
          <inertia><ixx>0.001</ixx><iyy>0.001</iyy><izz>0.001</izz></inertia></inertial></link>
        <link name="finger"><pose>0 0.05 0 0 0 0</pose><inertial><pose>0 0.02 0 0 0 0</pose><mass>0.1</mass>
          <inertia><ixx>0.0002</ixx><iyy>0.0001</iyy><izz>0.0002</izz></inertia></inertial></link>
        <joint name="knuckle" type="ball"><parent>palm</parent><child>finger</child></joint>
      </model>
      <joint name="wrist" type="universal">
        <parent>slider</parent><child>hand::palm</child>
        <axis><xyz>1 0 0</xyz><dynamics><damping>0.05</damping></dynamics></axis>
        <axis2><xyz>0 1 0</xyz><dynamics><damping>0.05</damping></dynamics></axis2>
      </joint>
    </model>
    <model name="post">
      <static>true</static><pose>3 0 0 0 0 0</pose>
      <link name="body"><inertial><mass>5</mass></inertial></link>
    </model>
  </world>
</sdf>
"""

PENDULUM = """
<sdf version="1.9"><model name="pendulum">
  <link name="rod">
    <pose>0 0 -0.5 0 0 0</pose>
    <inertial><mass>2</mass><inertia><ixx>0.2</ixx><iyy>0.3</iyy><izz>0.1</izz></inertia></inertial>
  </link>
  <joint name="pin" type="continuous">
    <pose>0 0 0.5 0 0 0</pose><parent>world</parent><child>rod</child>
    <axis><xyz>0 1 0</xyz>
      <dynamics><spring_stiffness>3</spring_stiffness><spring_reference>0.4</spring_reference><damping>0.5</damping></dynamics>
    </axis>
  </joint>
</model></sdf>
"""
