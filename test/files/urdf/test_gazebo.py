"""Springs of Gazebo in a URDF: they act as those of an SDF; what else Gazebo is told is listed with its line."""

import numpy as np
import pytest

from mbd_sim import MechanismError, Simulation, parse_mechanism
from test.files.urdf.test_reader import joint, link, robot


def spring(stiffness, rest=0.0, of="j", more=""):
    return (
        f'<gazebo reference="{of}"><springStiffness>{stiffness}</springStiffness>\n'
        f"<springReference>{rest}</springReference>{more}</gazebo>"
    )


def pair(kind, *blocks):
    axis = '<axis xyz="0 0 1"/>'
    return parse_mechanism(robot(link("a"), link("b"), joint("j", kind, axis), *blocks))


@pytest.mark.parametrize(("kind", "load"), [("continuous", 0.0), ("prismatic", -2.0 * 9.81)])
def test_a_joint_swings_about_where_its_spring_and_gravity_are_in_balance(kind, load):
    """With unit inertia about z and a mass of 2 kg: q = q0 (1 - cos ωt), about the rest that the file gives."""
    stiffness, inertia = 50.0, 1.0 if kind == "continuous" else 2.0
    simulation = Simulation(pair(kind, spring(stiffness, 0.25)))
    simulation.run(until=0.7)
    middle, rate = 0.25 + load / stiffness, np.sqrt(stiffness / inertia)
    assert simulation.q == pytest.approx([middle * (1.0 - np.cos(0.7 * rate))], abs=1e-12)


def test_it_is_the_spring_of_the_same_joint_in_an_sdf():
    body = "<inertial><mass>2</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"
    dynamics = "<dynamics><spring_stiffness>7</spring_stiffness><spring_reference>-0.3</spring_reference></dynamics>"
    sdf = parse_mechanism(
        f'<sdf version="1.9"><model name="m"><link name="b">{body}</link><joint name="j" type="revolute">'
        f"<parent>world</parent><child>b</child><axis><xyz>0 0 1</xyz>{dynamics}</axis></joint></model></sdf>"
    )
    urdf = pair("continuous", spring(7, -0.3))
    for name in ("stiffness", "rest"):
        assert np.array_equal(getattr(urdf.joints["j"], name), getattr(sdf.joints["j"], name))


def test_the_last_of_several_blocks_counts_and_other_elements_are_listed():
    blocks = [
        spring(3),
        "<gazebo><plugin/></gazebo>",
        spring(5, 0.1, more="<provideFeedback>1</provideFeedback><stopErp>1</stopErp>"),
    ]
    mechanism = pair("continuous", *blocks, '<gazebo reference="j"><provideFeedback>1</provideFeedback></gazebo>')
    own = mechanism.joints["j"].stiffness
    assert (own.item(), mechanism.joints["j"].rest.item()) == (5.0, 0.1)
    assert "<stopErp> of <gazebo>: gazebo[j] (line 9)" in mechanism.source.notes
    assert "<springStiffness> that is given again: gazebo[j] (line 5)" in mechanism.source.notes
    assert "<gazebo>: without a name, j" in mechanism.source.notes


def test_a_reference_without_a_stiffness_is_listed():
    mechanism = pair("continuous", '<gazebo reference="j"><springReference>1</springReference></gazebo>')
    assert not mechanism.joints["j"].rest.any()
    assert mechanism.source.notes == ("<springReference> without a stiffness: gazebo[j] (line 5)",)


def test_springs_of_links_and_of_joints_without_an_axis_are_listed():
    mechanism = pair("fixed", spring(3), spring(4, of="b"))
    (note,) = (one for one in mechanism.source.notes if "springStiffness" in one)
    assert note == "<springStiffness> of what has no axis: gazebo[j] (line 5), gazebo[b] (line 7)"


@pytest.mark.parametrize(("text", "message"), [("soft", "'soft' is not a number"), ("-1", "must not be negative")])
def test_wrong_numbers_are_refused_with_their_line(text, message):
    with pytest.raises(MechanismError, match=rf":5: gazebo\[j\].springStiffness: {message}"):
        pair("continuous", spring(text))
