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
    "weld_of_points": '<weld body1="one" body2="three" anchor="0.1 0 0.2" torquescale="0"/>',
    "joint": '<joint joint1="a" joint2="b" polycoef="0.1 0.5"/>',
    "joint_alone": '<joint joint1="b" polycoef="0.1"/>',
    "joint_partly_given": '<joint joint1="a" joint2="b" polycoef="0.2"/>',
    "joint_polynomial": '<joint joint1="a" joint2="b" polycoef="0 0.5 0.3 -0.2"/>',
    "tendon_length": '<tendon tendon1="rod"/>',
    "tendons": '<tendon tendon1="ab" tendon2="ef" polycoef="0 2"/>',
}

# Two links on the joints ja and jb, a ball jc and a free body, to which further elements are added.
LINKED = """
<mujoco model="linked">
  <compiler angle="radian"/>
  <worldbody>
    <site name="wall" pos="-0.4 0.2 0.3"/>
    <body name="a" gravcomp="GRAVCOMP">
      <joint name="ja" axis="0 1 0" JOINT/>
      <geom type="capsule" fromto="0 0 0 0.3 0 -0.5" size="0.02" mass="1"/>
      <site name="mid" pos="0.2 0 -0.3"/>
      <body name="b" pos="0.3 0 -0.5">
        <joint name="jb" axis="0 1 0.3" ref="0.2"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 -0.4" size="0.02" mass="0.7"/>
        <body name="c" pos="0.1 0 -0.4">
          <joint name="jc" type="ball" BALL/>
          <geom type="box" size="0.1 0.05 0.02" pos="0 0 -0.1" mass="0.5"/>
        </body>
      </body>
    </body>
    <body name="quad" pos="1 0 1" euler="0.1 0.2 0.3">
      <joint type="free" name="root" armature="0.3"/>
      <geom type="box" size="0.1 0.15 0.02" mass="1.2"/>
      <site name="rotor" pos="0.1 0.1 0" euler="0.2 0 0"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="sum"><joint joint="ja" coef="1"/><joint joint="jb" coef="-0.5"/></fixed>
    <fixed name="one"><joint joint="ja" coef="2.5"/></fixed>
    <spatial name="line"><site site="wall"/><site site="mid"/></spatial>
  </tendon>
  <actuator>ACTUATOR</actuator>
</mujoco>
"""


def linked(actuator="", joint="", ball="", gravcomp="0"):
    """The model with further elements and attributes."""
    found = LINKED.replace("ACTUATOR", actuator).replace("JOINT", joint).replace("BALL", ball)
    return found.replace("GRAVCOMP", gravcomp)


# Each with the factor from MuJoCo's ctrl to our command.
ACTUATORS = {
    "motor with one-sided range": ('<motor name="m" joint="ja" gear="3" ctrlrange="-0.1 0.4"/>', 3.0),
    "motor with reversed gear": ('<motor name="m" joint="ja" gear="-3" ctrlrange="-0.1 0.4"/>', -3.0),
    "motor with one-sided force": ('<motor name="m" joint="ja" gear="3" forcerange="-0.1 0.4"/>', 3.0),
    "position with a range without zero": ('<position name="m" joint="jb" kp="40" kv="2" ctrlrange="0.2 0.6"/>', 1.0),
    "position with a one-sided force": ('<position name="m" joint="jb" kp="40" gear="2" forcerange="-1 9"/>', 0.5),
    "velocity on a sum of joints": (
        '<velocity name="m" tendon="sum" kv="4" gear="1.5" ctrlrange="-0.3 0.3"/>',
        1 / 1.5,
    ),
    "position on a sum of joints": ('<position name="m" tendon="sum" kp="9" kv="1"/>', 1.0),
    "position on a line": ('<position name="m" tendon="line" kp="9" kv="1" forcerange="-2 1"/>', 1.0),
    "motor on a sum of joints": ('<motor name="m" tendon="sum" gear="2"/>', 2.0),
    "affine bias within a force range": (
        '<general name="m" joint="ja" gear="2" gainprm="3" biastype="affine" biasprm="0.5 -7 -0.4" forcerange="-1 2"/>',
        6.0,
    ),
    "affine gain": (
        '<general name="m" joint="ja" gear="2" gaintype="affine" gainprm="3 2 -1" biastype="affine" biasprm="0 -1 0"'
        ' ctrlrange="-0.3 0.9"/>',
        1.0,
    ),
    "damping ratio": ('<position name="m" joint="ja" kp="20" dampratio="0.7"/>', 1.0),
    "damper": ('<damper name="m" joint="ja" kv="2" ctrlrange="0 1"/>', 1.0),
    "armature and damping": ('<motor name="m" joint="jb" gear="3" armature="0.02" damping="0.1 0.2 0.3"/>', 3.0),
    "damping of a tendon over one joint": ('<motor name="m" tendon="one" gear="3" damping="0.1 0.2 0.3"/>', 7.5),
    "damping of a tendon over several": ('<motor name="m" tendon="sum" gear="3" damping="0.1 0.2 0.3"/>', 3.0),
    "ball": ('<motor name="m" joint="jc" gear="0 0 3" ctrlrange="0 1"/>', 3.0),
    "ball, oblique": ('<motor name="m" joint="jc" gear="1 -2 3" ctrlrange="-0.2 0.1"/>', 1.0),
    "free joint": ('<motor name="m" joint="root" gear="0 0 1 0 0 0.2" ctrlrange="0 20"/>', 1.0),
    "site": ('<motor name="m" site="rotor" gear="0 0.1 1 0 0 -0.02" ctrlrange="0.1 20"/>', 1.0),
    "joint force range": ('<motor name="m" joint="ja" gear="-5"/>', -5.0),
}
JOINT_FORCES = {
    "polynomial damping": {"joint": 'damping="1 0.5 0.2"'},
    "negative and cubic stiffness": {"joint": 'stiffness="-2 0.5 3" springref="0.3"'},
    "rest at springref": {"joint": 'stiffness="4" springref="0.3" ref="-0.2"'},
    "armature and friction of a ball": {"ball": 'armature="0.05" frictionloss="0.2" damping="0.3 0.1"'},
    "gravity compensation": {"gravcomp": "0.6"},
}
