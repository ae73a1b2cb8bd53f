"""Corners and rims of a part on a plane that share slots: the motion is that with rows of their own."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import about, unit
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.elements.contacts import Cluster
from mbd_sim.simulation.contact.features.clusters import ClusterOnPlane

BOX = "{type: block, size: [0.4, 0.3, 0.2]}"
ROUND, SLOTS = "{type: cylinder, radius: 0.2, length: 0.3}, {type: sphere, radius: 0.1, at: [0.15, 0, 0]}", 7
TEXT = """
mechanism: thrown
parts: {{body: {{mass: 2, inertia: [0.03, 0.04, 0.05], collisions: [{shapes}]}}}}
joints:
  base: {{type: free, between: [ground, body], position: [0, 0, {height}], orientation: {turn},
    velocity: [0.7, 0.2, 0], angular_velocity: {spin}}}
contacts: {{floor: {{parts: {parts}, plane: ground, friction: 0.4, restitution: 0.3}}}}
"""


def thrown(shapes, parts, height=0.6, turn="{axis: [1, 2, 0.3], angle: 40 deg}", spin=(1, 2, -1)):
    return parse_mechanism(TEXT.format(shapes=shapes, parts=parts, height=height, turn=turn, spin=list(spin)))


def test_bodies_move_as_with_rows_of_their_own():
    """A body that falls, strikes, slides and tips: finds wrong gaps, normals, points and lost features.

    Slip counts as zero below 1e-8 of the natural speed. Where rows of one kind find the end of a slip a step part
    earlier than the others, speeds differ by up to 3e-8 afterwards, with any method; with this one both find it alike.
    """
    shared, own = thrown(ROUND, "all"), thrown(ROUND, "[body]")
    assert [type(contact.first) for contact in shared.contacts] == [Cluster] and shared.contacts[0].slots == SLOTS
    assert not any(isinstance(contact.first, Cluster) for contact in own.contacts)
    runs = [Simulation(mechanism, method="tsitouras8") for mechanism in (shared, own)]
    for until, digits in ((0.5, 1e-10), (0.8, 1e-8)):  # rebounds that end a sequence amplify the tolerance of gaps
        for simulation in runs:
            simulation.run(until=until)
        np.testing.assert_allclose(runs[0].state[:13], runs[1].state[:13], rtol=0, atol=digits)
    assert len(runs[1].contact_events) > 3
    assert abs(runs[0].energies.residual) < 1e-8
    for turned in ([1, 0, 0, 0], [0, 1, 0, 0]):  # it stands on the points of either rim
        runs[0].reset(q=[0, 0, 0.15, *turned], u=np.zeros(6))
        runs[0].run(until=0.05)
        assert runs[0].q[:3] == pytest.approx([0, 0, 0.15], abs=1e-9)


def dropped():
    return Simulation(thrown(BOX, "all", turn="{axis: [1, 0, 0], angle: 10 deg}", spin=(0, 0, 0)), method="tsitouras8")


def test_bodies_come_to_rest():
    """A block that comes to rest on four corners, with its weight on them."""
    simulation = dropped()
    simulation.run(until=1.0)
    assert np.max(np.abs(simulation.u)) < 1e-9
    assert simulation.q[2] == pytest.approx(0.1, abs=1e-9)
    assert sum(reading.force[2] for reading in simulation.contacts().values()) == pytest.approx(2 * 9.81)


def test_what_is_never_lowest_is_left_out():
    """Corners inside a ball, and those inside the hull of others, even of other parts that are welded to theirs."""
    inner = "{type: block, size: [0.1, 0.1, 0.1]}"
    hidden = parse_mechanism(
        TEXT.format(
            shapes=f"{{type: sphere, radius: 0.3}}, {inner}",
            parts="all",
            height=1,
            turn="{rpy: [0, 0, 0]}",
            spin=[0, 0, 0],
        )
    )
    assert [contact.first.radius for contact in hidden.contacts] == [0.3]
    text = TEXT.format(shapes=BOX, parts="all", height=1, turn="{rpy: [0, 0, 0]}", spin=[0, 0, 0])
    text = text.replace(
        "parts: {", f"parts: {{tip: {{mass: 0, collisions: [{inner}], points: {{p: [0.03, 0, 0]}}}}, ", 1
    )
    text = text.replace("joints:", "joints:\n  weld: {type: fixed, between: [body, tip.p]}", 1)
    (contact,) = parse_mechanism(text).contacts
    assert len(contact.first.bodies) == 8


def test_a_step_may_be_split():
    """n steps in one call give the bits of n calls, and a restored snapshot those of the run before it."""
    runs = [dropped() for _ in range(2)]
    runs[0].step(400)
    for n in (150, 250):
        runs[1].step(n)
    assert runs[0].state.tobytes() == runs[1].state.tobytes()
    snapshot = runs[0].snapshot()
    runs[0].step(100)
    end = runs[0].state.tobytes()
    runs[1].restore(snapshot)
    runs[1].step(100)
    assert runs[1].state.tobytes() == end


def test_of_many_corners_that_touch_those_are_chosen_that_are_far_from_each_other():
    """A hull whose base has 12 corners takes eight of them, and tips over none."""
    ring = [
        [0.2 * np.cos(a), 0.2 * np.sin(a), z]
        for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)
        for z in (-0.1, 0.1)
    ]
    points = ", ".join(str([float(round(value, 4)) for value in point]) for point in ring)
    (contact,) = thrown(f"{{type: hull, points: [{points}]}}", "[body]").contacts
    assert (type(contact.first), contact.slots) == (Cluster, 8)
    narrow, still = ClusterOnPlane(contact.first, contact.second, 8), Pose(np.zeros(3), np.eye(3))
    found = narrow.touching(Pose(np.array([0.0, 0.0, 0.1]), about(unit((1, 2, 0)), 1e-10)), still, 1e-9)
    angles = np.sort([np.arctan2(body.numbers[4], body.numbers[3]) for body in found])
    assert len(found) == 8 and np.diff([*angles, angles[0] + 2.0 * np.pi]).max() < 1.1
