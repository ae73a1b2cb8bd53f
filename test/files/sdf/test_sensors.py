"""The sensors of SDFs: what they measure, with which errors, and what is said of those that are not read."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.files.load import parse_mechanism

ARM = """<sdf version="1.9"><model name="arm">
<link name="stand"><inertial><mass>1</mass></inertial></link>
<joint name="weld" type="fixed"><parent>world</parent><child>stand</child></joint>
<link name="rod"><pose>0.2 0 1 0 0 0.5</pose>
 <inertial><pose>0.3 0 0 0 0 0</pose><mass>2</mass><inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.2</izz></inertia></inertial>
 LINK</link>
<joint name="hinge" type="revolute"><pose>-0.1 0 0 0.4 0 0</pose><parent>stand</parent><child>rod</child>
 <axis><xyz>0 1 0</xyz><dynamics><spring_stiffness>1e4</spring_stiffness><damping>300</damping></dynamics></axis>
 JOINT</joint></model></sdf>"""
IMU = """<sensor name="chip" type="imu"><pose>0.1 0 0.05 0 1.2 0</pose><update_rate>100</update_rate><topic>t</topic>IMU</sensor>"""
LOAD = """<sensor name="cell" type="force_torque"><pose>0 0 0.1 0.3 0 0</pose><force_torque>FRAME</force_torque></sensor>"""


def arm(link="", joint=""):
    return parse_mechanism(ARM.replace("LINK", link).replace("JOINT", joint))


def test_an_imu_at_rest_measures_the_opposite_of_gravity_in_its_axes():
    """Also its angular velocity 0 and its orientation; they come at the rate of the file."""
    mechanism = arm(IMU.replace("IMU", ""))
    assert mechanism.source.data["sensors"]["chip"]["rate"] == pytest.approx(100.0)
    simulation = Simulation(mechanism)
    simulation.run(until=2.0)
    values = simulation.sensors()["chip"].values
    turn = 1.2 + float(simulation.q[0])  # about an axis that is nearly y of the rod
    assert np.linalg.norm(values["specific_force"]) == pytest.approx(9.81, rel=1e-9)
    assert values["specific_force"] == pytest.approx(9.81 * np.array([-np.sin(turn), 0.0, np.cos(turn)]), abs=2e-2)
    assert np.abs(values["angular_velocity"]).max() < 1e-9 and len(values["orientation"]) == 4


@pytest.mark.parametrize(
    ("frame", "roll"), [("", 0.0), ("<frame>child</frame>", 0.0), ("<frame>sensor</frame>", 0.7)], ids=str
)
def test_a_load_is_about_the_joint_in_the_axes_that_are_named(frame, roll):
    """At rest: the weight, upwards, and its moment about the joint, 0.4 m from the center of mass."""
    direction = "<measure_direction>parent_to_child</measure_direction>"
    mechanism = arm(joint=LOAD.replace("FRAME", frame + direction))
    assert not any("opposite" in note for note in mechanism.source.notes)
    simulation = Simulation(mechanism)
    values = simulation.sensors()["cell"].values
    simulation.run(until=2.0)
    values = simulation.sensors()["cell"].values
    c, s = np.cos(roll), np.sin(roll)
    to_frame = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    weight = 2.0 * 9.81
    assert values["force"] == pytest.approx(to_frame @ [0.0, 0.0, weight], abs=0.02 * weight)
    assert np.linalg.norm(values["force"]) == pytest.approx(weight, rel=1e-9)
    assert values["torque"] == pytest.approx(to_frame @ [0.0, -0.4 * weight, 0.0], abs=0.02 * weight)


def test_noise_becomes_a_density_and_a_bias():
    noise = '<noise type="gaussian"><mean>0.1</mean><stddev>0.2</stddev><bias_mean>0.3</bias_mean></noise>'
    errors = "".join(f"<{axis}>{noise}</{axis}>" for axis in "xyz")
    body = f"<imu><enable_orientation>false</enable_orientation><angular_velocity>{errors}</angular_velocity></imu>"
    mechanism = arm(IMU.replace("IMU", body))
    (sensor,) = mechanism.sensors
    assert sensor.errors[0].bias == pytest.approx(0.4)
    assert sensor.errors[0].noise_density * 100.0**0.5 == pytest.approx(0.2)  # of each measurement
    assert not sensor.orientation


@pytest.mark.parametrize(
    ("link", "joint", "why"),
    [
        ('<sensor name="it" type="contact"><contact/></sensor>', "", "contact sensors, which are not read"),
        ('<sensor name="it" type="camera"/>', "", "camera sensors, which are not read"),
        ('<sensor name="it" type="force_torque"/>', "", "force_torque sensors that are not where"),
        ("", LOAD.replace("FRAME", ""), "loads from the child on the parent"),
        ("", LOAD.replace("FRAME", "<frame>parent</frame>"), "axes of the parent of loads"),
        (IMU.replace("IMU", "").replace(">100<", ">300<"), "", "rates that are not a whole number of steps"),
        (IMU.replace("IMU", "<imu><orientation_reference_frame/></imu>"), "", "<orientation_reference_frame> of <imu>"),
        (IMU.replace("IMU", ""), "", "orientations of imu sensors in the axes of the world"),
        (
            IMU.replace("IMU", '<imu><linear_acceleration><x><noise type="gaussian"><stddev>1</stddev></noise></x></linear_acceleration></imu>'),
            "", "noise that differs by axis",
        ),
    ],
)  # fmt: skip
def test_what_is_not_read_is_listed(link, joint, why):
    assert any(why in note for note in arm(link, joint).source.notes)
