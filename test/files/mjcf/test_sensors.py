"""The sensors of MJCFs beside MuJoCo's own, at random states, and what is said of those that are not read."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.files.load import parse_mechanism
from test.oracles.mujoco_oracle import import_mujoco

MODEL = """<mujoco><compiler angle="radian"/><option gravity="0.3 -0.2 -9.7"/><worldbody>
<body name="base" pos="0 0 1"><freejoint name="root"/>
 <geom name="box" type="box" size="0.2 0.1 0.05" mass="3" pos="0.02 0 0.01" euler="0.1 0.2 0.3"/>
 <site name="chip" pos="0.05 0.02 0.03" euler="0.3 -0.2 0.5"/>
 <body name="arm" pos="0.2 0 0">
  <joint name="a" axis="0 1 0" stiffness="3" damping="0.2"/><joint name="b" axis="1 0 0" damping="0.1" pos="0 0 0.02"/>
  <geom name="stick" type="capsule" fromto="0 0 0 0.3 0 -0.1" size="0.02" mass="0.7"/>
  <site name="wrist" pos="0.1 0.02 0" euler="0.5 0.1 -0.4"/>
  <body name="hand" pos="0.3 0 -0.1" euler="0.1 0 0.3">
   <geom size="0.05" mass="0.4" pos="0.03 0 0"/><site name="palm" pos="0.02 0 0.1" euler="0.7 0 0.2"/>
   <body name="nail" pos="0 0.1 0"><joint name="c" type="ball"/>
    <geom type="box" size="0.02 0.03 0.05" mass="0.2" pos="0 0 -0.05"/><site name="tip" pos="0 0 -0.1" euler="0 0.4 0"/>
   </body></body></body></body></worldbody><sensor>SENSORS</sensor></mujoco>"""
SITES = ("chip", "wrist", "palm", "tip")
AT_SITES = {
    "accelerometer": "specific_force",
    "gyro": "angular_velocity",
    "velocimeter": "velocity",
    "force": "force",
    "torque": "torque",
}
FRAMES = {"site": SITES, "body": ("base", "arm", "hand", "nail"), "xbody": ("arm", "hand"), "geom": ("box", "stick")}
OF_FRAMES = {
    "framepos": "position",
    "framequat": "orientation",
    "framelinvel": "velocity",
    "frameangvel": "angular_velocity",
}


def all_sensors():
    """The elements, and the quantity that each measures here."""
    found = {
        f'<{kind} name="{kind}_{site}" site="{site}"/>': quantity
        for kind, quantity in AT_SITES.items()
        for site in SITES
        if quantity not in ("force", "torque") or site != "chip"  # the base has no parent
    }
    found |= {
        f'<{kind} name="{kind}_{owner}_{name}" objtype="{owner}" objname="{name}"/>': quantity
        for kind, quantity in OF_FRAMES.items()
        for owner, names in FRAMES.items()
        for name in names
    }
    return found | {'<jointvel name="jv" joint="b"/>': "velocity"}


def at_random_state(text, rng):
    """A simulation of ours, and MuJoCo's model and data, at the same random state."""
    mujoco = import_mujoco()
    model = mujoco.MjModel.from_xml_string(text)
    data, simulation = mujoco.MjData(model), Simulation(parse_mechanism(text))
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    data.qvel[:] = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    y = simulation.state.copy()
    y[: model.nq + model.nv] = np.concatenate([data.qpos, data.qvel])
    simulation.restore(y, steps=0)
    return simulation, model, data


def test_measurements_are_those_of_mujoco():
    """Finds a wrong frame, point, sign or quantity of any sensor."""
    elements = all_sensors()
    text = MODEL.replace("SENSORS", "".join(elements))
    simulation, model, data = at_random_state(text, np.random.default_rng(0))
    readings = simulation.sensors()
    assert len(readings) == model.nsensor == len(elements)
    for index, quantity in enumerate(elements.values()):
        sensor = model.sensor(index)
        theirs, own = data.sensordata[sensor.adr[0] : sensor.adr[0] + sensor.dim[0]], readings[sensor.name]
        measured = np.atleast_1d(own.values[quantity])
        sign = -1.0 if quantity == "orientation" and measured @ theirs < 0.0 else 1.0
        np.testing.assert_allclose(sign * measured, theirs, rtol=1e-9, atol=1e-9, err_msg=sensor.name)


def test_rates_delays_and_cutoffs_are_those_of_the_file():
    sensors = (
        '<accelerometer name="acc" site="chip" interval="0.004" delay="0.002" nsample="1" cutoff="3"/>'
        '<force name="load" site="tip" cutoff="0.5"/><gyro name="odd" site="tip" interval="0.0033"/>'
    )
    source = parse_mechanism(MODEL.replace("SENSORS", sensors)).source
    found = source.data["sensors"]
    assert (found["acc"]["rate"], found["acc"]["delay"], found["acc"]["limit"]) == (pytest.approx(250.0), 0.002, 3.0)
    assert found["load"]["force"] == {"limit": 0.5} and found["load"]["joint"] == "c"
    assert found["odd"]["rate"] == pytest.approx(1000.0 / 3.0)
    assert any(
        "rates that are not a whole number of steps of 0.001 s" in note and "odd" in note for note in source.notes
    )
    Simulation(parse_mechanism(MODEL.replace("SENSORS", sensors)))


@pytest.mark.parametrize(
    ("element", "why"),
    [
        ('<touch name="it" site="tip"/>', "sensors of the kind touch"),
        ('<jointpos name="it" joint="a"/>', "joint states have them"),
        (
            '<framepos name="it" objtype="site" objname="tip" reftype="site" refname="chip"/>',
            "relative to another frame",
        ),
        ('<subtreecom name="it" body="arm"/>', "sensors of the kind subtreecom"),
        ('<framequat name="it" objtype="camera" objname="eye"/>', "sensors of the kind framequat"),
        ('<clock name="it"/>', "sensors of the kind clock"),
        ('<gyro name="it" site="chip" noise="0.1"/>', "noise of sensors"),
    ],
)
def test_what_is_not_read_is_listed_with_its_line(element, why):
    text = MODEL.replace("SENSORS", element).replace("<worldbody>", '<worldbody><camera name="eye"/>')
    place = f"sensor[it] (line {MODEL.count(chr(10)) + 1})"
    assert any(why in note and place in note for note in parse_mechanism(text).source.notes)
