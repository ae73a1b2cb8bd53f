"""MJCF models with what Gymnasium's do not have."""

# All kinds of geoms and orientations, classes, frames, several joints on a body, ball and free joints, inertias.
BODIES = """
<mujoco model="zoo">
  <compiler angle="degree" eulerseq="zYx" balanceinertia="true" boundinertia="0.001" settotalmass="30"/>
  <option gravity="0.5 0 -9.6"/>
  <default>
    <joint damping="0.3" armature="0.02"/>
    <geom density="700"/>
    <default class="stiff"><joint stiffness="4" springref="20"/>
      <default class="stiffer"><joint stiffness="9"/></default>
    </default>
  </default>
  <worldbody>
    <body name="swing" pos="0 0 1" euler="10 20 30" childclass="stiff">
      <joint name="a" type="slide" axis="1 0 1" ref="0.3" pos="0.1 0 0"/>
      <joint name="b" axis="0 1 0.2" ref="-25" pos="0 0.1 0.05" class="stiffer"/>
      <joint name="c" axis="1 0 0" pos="0 0 0.2" springref="-10"/>
      <geom type="box" size="0.1 0.2 0.05" axisangle="1 1 0 40" pos="0.1 0 0"/>
      <geom type="ellipsoid" fromto="0 0 0 0.2 0.1 0.3" size="0.05 0.08" mass="2"/>
      <geom type="box" fromto="0 0 0 0.2 0.1 -0.3" size="0.05"/>
      <geom type="ellipsoid" size="0.05 0.08 0.1" euler="30 -50 70"/>
      <frame pos="0.1 0 0.1" euler="0 0 45">
        <body name="inner" pos="0.2 0 0" xyaxes="1 1 0 0 1 1">
          <joint name="d" type="ball" pos="0 0 0.1" stiffness="3" damping="0.2" class="main" armature="0"/>
          <geom type="capsule" fromto="0 0 0 0.1 0.3 0" size="0.04"/>
          <geom type="cylinder" size="0.05 0.2" zaxis="1 0 1"/>
          <geom type="sphere" size="0.2" density="0"/>
          <site name="hand" pos="0 0.3 0" euler="0 90 0"/>
        </body>
        <geom type="sphere" size="0.06" pos="0 0 0.1"/>
      </frame>
    </body>
    <body name="flier" pos="1 2 3" quat="1 1 0 0">
      <joint name="root" type="free" stiffness="2" damping="0.4" armature="0"/>
      <inertial pos="0.1 0 0" mass="2" fullinertia="0.1 0.2 0.15 0.01 -0.02 0.03" />
      <geom type="sphere" size="1"/>
      <body pos="0 0 0.5">
        <inertial pos="0 0 0.1" euler="0 0 30" mass="1" diaginertia="0.01 0.02 0.5"/>
        <body><joint name="e" axis="0 1 1"/><geom type="cylinder" fromto="0 0 0 0 0.2 0.1" size="0.03"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

# Tendons and actuators.
FORCES = """
<mujoco model="forces">
  <compiler angle="radian"/>
  <default><position ctrlrange="-1 1"/></default>
  <worldbody>
    <site name="wall" pos="-1 0 0.5"/>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" ref="0.2" armature="0.7"/>
      <geom size="0.1"/>
      <site name="hook" pos="0.1 0 0.1"/>
      <body name="arm">
        <joint name="pin" axis="0 1 0" ref="0.4" actuatorfrcrange="-7 7"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.03"/>
        <site name="tip" pos="0 0 -0.5"/>
        <body name="tool" pos="0 0 -0.5">
          <joint name="wrist" axis="1 0 0"/>
          <geom type="box" size="0.1 0.05 0.02"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="sum" stiffness="30" damping="0.5" springlength="0.1">
      <joint joint="pin" coef="1.5"/><joint joint="wrist" coef="-0.5"/>
    </fixed>
    <fixed name="slack" stiffness="40" springlength="-0 0.2"><joint joint="rail" coef="2"/></fixed>
    <spatial name="rope" stiffness="20" damping="0.7" springlength="0.4"><site site="wall"/><site site="hook"/></spatial>
    <spatial name="loose" stiffness="50" springlength="0.3 0.6"><site site="wall"/><site site="tip"/></spatial>
  </tendon>
  <actuator>
    <motor name="pull" tendon="rope" gear="3"/>
    <motor name="push" joint="rail" gear="-2" forcerange="-0.5 0.5" forcelimited="true"/>
    <position name="hold" joint="pin" kp="12" kv="0.8" gear="2"/>
    <velocity name="spin" joint="wrist" kv="0.3" gear="1.5"/>
    <general name="mixed" joint="wrist" gainprm="2" biastype="affine" biasprm="0.3 -0.4 -0.1" gear="2"/>
    <motor name="through" tendon="slack" armature="0.1" damping="0.6"/>
  </actuator>
</mujoco>
"""

# One equality of each kind, in the world that `equality` is put into.
LINKS = """
<mujoco model="links">
  <worldbody>
    <site name="post" pos="1.2 0 0.2"/>
    <body name="one" pos="0 0 1">
      <joint name="a" axis="0 1 0" ref="10"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03"/>
      <site name="tip" pos="0.5 0 0"/>
      <body name="two" pos="0.5 0 0" euler="0 30 0">
        <joint name="b" axis="0 1 0"/><joint name="c" axis="1 0 0"/>
        <geom type="box" size="0.2 0.1 0.05" pos="0.2 0 0"/>
      </body>
    </body>
    <body name="three" pos="0.2 0.3 1">
      <joint name="d" type="ball"/><joint name="e" type="slide" axis="0 0 1"/><joint name="f" type="slide" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.1 0.4 0" size="0.04"/>
      <site name="eye" pos="0.1 0.4 0"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rod"><site site="post"/><site site="eye"/></spatial>
    <fixed name="ab"><joint joint="a" coef="2"/><joint joint="b" coef="1"/></fixed>
    <fixed name="ef"><joint joint="e" coef="1"/><joint joint="f" coef="-0.5"/></fixed>
  </tendon>
  <equality>EQUALITY</equality>
</mujoco>
"""
EQUALITIES = {
    "connect": '<connect body1="two" body2="three" anchor="0.1 0 0"/>',
    "connect_to_world": '<connect body1="three" anchor="0.1 0.4 0"/>',
    "connect_sites": '<connect site1="tip" site2="eye"/>',
    "weld": '<weld body1="three" body2="two"/>',
    "weld_relative": '<weld body1="one" body2="three" relpose="0.21 0.1 0 0.9 0.1 0.2 0"/>',
    "joint": '<joint joint1="a" joint2="b" polycoef="0.1 0.5"/>',
    "joint_polynomial": '<joint joint1="a" joint2="b" polycoef="0 0.5 0.3 -0.2"/>',
    "tendon_length": '<tendon tendon1="rod"/>',
    "tendons": '<tendon tendon1="ab" tendon2="ef" polycoef="0 2"/>',
}
