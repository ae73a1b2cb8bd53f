"""Collision elements of an SDF in contact: planes, friction, restitution, and what acts when."""

import pytest

from mbd_sim import Simulation
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.on_floor import on_floor

WORLD = """<sdf version="1.9"><world name="w"><gravity>0 0 -9.81</gravity>
<model name="ground"><static>true</static><pose>0 0 0.5 0 0 0</pose><link name="link">
  <collision name="c"><geometry><plane><normal>NORMAL</normal><size>9 9</size></plane></geometry>
    <surface><friction><ode><mu>0.7</mu></ode></friction>
      <bounce><restitution_coefficient>0.6</restitution_coefficient></bounce></surface></collision>
</link></model>
<model name="ball"><pose>0 0 HEIGHT 0 0 0</pose><link name="link">
  <inertial><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>
  <visual name="v"><geometry><box><size>9 9 9</size></box></geometry></visual>
  <collision name="c"><geometry><sphere><radius>0.25</radius></sphere></geometry>SURFACE</collision>
</link></model></world></sdf>"""
SLIPPERY = "<surface><friction><ode><mu>0.2</mu><mu2>0.3</mu2></ode></friction></surface>"
BOUNCY = "<surface><bounce><restitution_coefficient>0.5</restitution_coefficient></bounce></surface>"


def world(surface="", normal="0 0 1", height="2"):
    return parse_mechanism(WORLD.replace("SURFACE", surface).replace("NORMAL", normal).replace("HEIGHT", height))


@pytest.mark.parametrize(
    ("surface", "friction", "restitution"), [("", 0.7, 0.0), (SLIPPERY, 0.2, 0.0), (BOUNCY, 0.7, 0.5)]
)
def test_the_smaller_coefficients_of_two_surfaces_count(surface, friction, restitution):
    waiting = world(surface)
    assert not waiting.contacts
    (contact,) = on_floor(waiting).contacts
    assert (contact.law.friction, contact.law.restitution) == (friction, restitution)
    assert any("(mu2)" in note for note in waiting.source.notes) == (surface == SLIPPERY)


def test_collision_shapes_touch_and_visual_ones_do_not():
    (contact,) = on_floor(world()).contacts
    assert contact.first.radius == 0.25


def test_planes_are_where_the_file_has_them():
    """A ball that falls from 2 m on the plane at 0.5 m, and rebounds with half its speed."""
    simulation = Simulation(on_floor(world(BOUNCY)))
    simulation.run(until=1.5)
    (event, *_) = [one for one in simulation.contact_events if one.time > 0]
    assert event.time == pytest.approx((2 * (2 - 0.75) / 9.81) ** 0.5, abs=1e-10)


def test_planes_may_be_inclined():
    simulation = Simulation(on_floor(world(normal="0 1 1")))
    (gap,) = (reading.gap for reading in simulation.contacts().values())
    assert gap == pytest.approx(1.5 * 0.5**0.5 - 0.25, abs=1e-12)


def test_bases_are_lifted_out_of_the_floor_of_a_file():
    assert on_floor(world(height="0.5")).joints["ball::link_base"].position[2] == pytest.approx(0.75, abs=1e-15)


TABLE = """<sdf version="1.9"><world name="w"><gravity>0 0 -9.81</gravity>
<model name="table"><static>true</static><pose>0 0 0.4 0 0 0</pose><link name="top">
  <collision name="slab"><geometry><box><size>1 1 0.1</size></box></geometry>
    <surface><friction><ode><mu>0.5</mu></ode></friction></surface></collision></link></model>
<model name="brick"><pose>0 0 0.6 0 0 0</pose><link name="body">
  <inertial><mass>1</mass><inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia></inertial>
  <collision name="c"><geometry><box><size>0.1 0.1 0.1</size></box></geometry></collision>SECOND</link></model>
</world></sdf>"""


def test_shapes_of_static_links_carry_what_lies_on_them():
    """A brick falls 0.1 m on a table and stays there; without --floor it falls through."""
    waiting = parse_mechanism(TABLE.replace("SECOND", ""))
    assert not waiting.contacts and any("shapes of static links, which act" in note for note in waiting.source.notes)
    simulation = Simulation(on_floor(waiting))
    assert simulation.mechanism.contacts[0].law.friction == 0.5
    simulation.run(until=0.6)
    assert simulation.q[2] == pytest.approx(0.5, abs=1e-12)
    assert sum(reading.normal for reading in simulation.contacts().values()) == pytest.approx(9.81, abs=1e-9)


def test_shapes_of_different_friction_have_contacts_of_their_own():
    second = f'<collision name="d"><geometry><sphere><radius>0.01</radius></sphere></geometry>{SLIPPERY}</collision>'
    contacts = parse_mechanism(TABLE.replace("SECOND", second)).source.data["contacts"].values()
    found = {tuple(record["between"]): record["friction"] for record in contacts}
    slab = "table::top.slab"
    assert found == {("brick::body.c", slab): 0.5, ("brick::body.d", slab): 0.2}
