"""Geoms of an MJCF in contact: which can touch by MuJoCo's rules, with what friction, and what they become."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.mjcf.collisions import geom_pairs
from mbd_sim.files.mjcf.compiled_model import CompiledModel
from mbd_sim.files.on_floor import on_floor
from mbd_sim.files.text.yaml_text import mechanism_text
from test.oracles.mujoco_oracle import import_mujoco

DOG = """<mujoco model="dog"><option cone="elliptic"/>
<worldbody>
<geom name="floor" type="plane" size="0 0 1" friction="0.8" pos="0 0 0.1"/>
<body name="trunk" pos="0 0 0.2"><freejoint name="base"/>
  <geom name="hull" type="box" size="0.2 0.1 0.05" mass="3" friction="0.3"/>
  <geom name="deco" type="sphere" size="0.3" contype="0" conaffinity="0" mass="0"/>
  LEGS
</body></worldbody>REST</mujoco>"""
LEG = """<body name="{name}" pos="{x} {y} 0"><joint name="{name}_hip" axis="0 1 0" stiffness="100" damping="2"/>
<geom name="{name}_foot" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3" friction="0.3"/></body>"""
PLACES = {"left": (0.15, 0.1), "right": (0.15, -0.1), "back": (-0.15, 0)}


def dog(rest=""):
    legs = "".join(LEG.format(name=name, x=x, y=y) for name, (x, y) in PLACES.items())
    return DOG.replace("LEGS", legs).replace("REST", rest)


def random_model(rng):
    """Spheres at one place, on a random tree of bodies, some welded, with random bits, priorities and exclusions."""
    bodies, text = [], []
    for number in range(8):
        bits = f'contype="{rng.integers(0, 4)}" conaffinity="{rng.integers(0, 4)}" priority="{rng.integers(0, 2)}"'
        law = f'friction="{rng.uniform():.3f}" condim="{rng.choice([1, 3])}"'
        joint = "" if rng.uniform() < 0.3 else "<joint/>"
        bodies.append(f'<body name="b{number}">{joint}<geom name="g{number}" size="1" {bits} {law}/>')
        text.append(bodies[-1])
        text += ["</body>"] * int(rng.integers(0, text.count("</body>") + 2) == 0 or number == 7)
    flat = "".join(text)
    flat += "</body>" * (flat.count("<body") - flat.count("</body>"))
    exclude = f'<contact><exclude body1="b0" body2="b{rng.integers(2, 8)}"/></contact>'
    world = f'<geom name="w" size="1" friction="{rng.uniform():.3f}" pos="0 0 0.1"/>'
    return f'<mujoco><option><flag filterparent="{rng.choice(["enable", "disable"])}"/></option><worldbody>{world}{flat}</worldbody>{exclude}</mujoco>'


@pytest.mark.parametrize("seed", range(6))
def test_pairs_and_friction_are_those_of_mujoco(seed):
    """All geoms overlap, so that MuJoCo finds a contact for each pair that its filters let through."""
    mujoco, rng = import_mujoco(), np.random.default_rng(seed)
    text = random_model(rng)
    found = {
        tuple(sorted((pair.first, pair.second))): pair.friction for pair in geom_pairs(CompiledModel(text, "m.xml"))
    }
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = 1e-3 * rng.normal(size=model.nq)
    mujoco.mj_forward(model, data)
    expected = {
        tuple(sorted(map(int, one.geom))): float(one.friction[0]) if one.dim > 1 else 0.0 for one in data.contact
    }
    assert found == expected


def test_a_floor_acts_when_it_is_asked_for():
    waiting = parse_mechanism(dog())
    assert not waiting.contacts and waiting.source.data["contacts"]["floor"]["active"] is False
    assert any("planes, which act with --floor" in note and "line 3" in note for note in waiting.source.notes)
    standing = on_floor(waiting)
    assert {contact.law.friction for contact in standing.contacts} == {0.8}  # the larger one
    assert standing.joints["base"].position[2] == pytest.approx(0.32, abs=1e-15)  # lifted from 0.2
    assert {contact.first.at.part for contact in standing.contacts} == {"trunk", *PLACES}
    assert parse_mechanism(mechanism_text(standing.source)).source.data["contacts"] == standing.source.data["contacts"]


def test_geoms_without_bits_are_only_drawn():
    trunk = parse_mechanism(dog()).parts["trunk"]
    assert [shape.kind for shape in trunk.shapes] == ["block", "sphere"]
    assert [shape.kind for shape in trunk.touching] == ["block"]


def test_floors_of_different_friction_name_their_shapes():
    text = dog().replace('name="left_foot"', 'name="left_foot" priority="1"')
    contacts = parse_mechanism(text).source.data["contacts"]
    assert {record["friction"]: record["parts"] for record in contacts.values()} == {
        0.8: ["trunk", "right", "back"],
        0.3: ["left"],
    }


def test_explicit_pairs_act():
    """The pair has its own friction, and two bodies meet at the distance of their radii."""
    rest = '<contact><pair geom1="left_foot" geom2="right_foot" friction="0.4 0.4 0 0 0"/></contact>'
    mechanism = parse_mechanism(dog(rest))
    (contact,) = mechanism.contacts
    assert contact.law.friction == 0.4 and contact.names == ("left.left_foot", "right.right_foot")


def test_what_is_solved_otherwise_is_noted():
    notes = "\n".join(parse_mechanism(dog().replace(' cone="elliptic"', "")).source.notes)
    for text in ("friction pyramids, in place of which friction is the same in all directions", "solref, solimp"):
        assert text in notes
    assert "friction pyramids" not in "\n".join(parse_mechanism(dog()).source.notes)


SCENE = """<mujoco><asset><mesh name="wedge" vertex="0 0 0 4 0 0 0 3 0 4 3 0 0 0 2 0 3 2" scale="0.1 0.1 0.1"/></asset>
<worldbody><geom name="table" type="box" size="0.3 0.3 0.1" pos="0 0 0.1" friction="0.7" BITS/>
<geom name="ramp" type="mesh" mesh="wedge" pos="1 -0.15 0" friction="0.2"/>
<body name="post" pos="-1 0 0"><geom name="pole" type="cylinder" size="0.05 0.5"/></body>
<body name="ball" pos="0.05 0 0.4"><freejoint name="b"/><geom name="g" size="0.05" friction="0.4" condim="1"/>
  <geom name="h" type="box" size="0.02 0.02 0.1" friction="0.4"/></body>
<body name="slider" pos="1.2 0 0.3"><freejoint name="s"/><geom name="c" type="sphere" size="0.05" friction="0.1"/></body>
</worldbody></mujoco>"""


def scene(bits=""):
    return parse_mechanism(SCENE.replace("BITS", bits))


def test_geoms_of_the_world_touch_what_mujoco_says():
    """They are parts of ground, with contacts for each shape that has a friction of its own."""
    mechanism = scene()
    assert not mechanism.contacts
    found = {tuple(one["between"]): one.get("friction", 0.0) for one in mechanism.source.data["contacts"].values()}
    assert found == {
        ("ball", "world_geoms.table"): 0.7,
        ("slider", "world_geoms.table"): 0.7,
        ("ball", "world_geoms.ramp"): 0.4,
        ("slider", "world_geoms.ramp"): 0.2,
        ("ball", "post.pole"): 1.0,
        ("slider", "post.pole"): 1.0,
    }
    assert scene('contype="0" conaffinity="0"').source.data["contacts"].keys() == {
        "ball_ramp", "slider_ramp", "ball_pole", "slider_pole",
    }  # fmt: skip


def test_what_falls_on_geoms_of_the_world_stays_on_them():
    """A box lands on the table; a sphere slides down the hull of a mesh whose vertices the MJCF has."""
    text = "\n".join(line for line in SCENE.replace("BITS", "").splitlines() if "post" not in line)
    text = text.replace('<geom name="g" size="0.05" friction="0.4" condim="1"/>', "")
    simulation = Simulation(on_floor(parse_mechanism(text)), method="tsitouras8")
    simulation.run(until=0.3)
    assert simulation.q[2] == pytest.approx(0.3, abs=1e-12)
    normal = np.array([1.0, 0.0, 2.0]) / 5.0**0.5  # of the side from (0, ., 0.2) to (0.4, ., 0)
    center = simulation.q[7:10] - [1.0, 0.0, 0.0]
    assert normal @ center - normal @ [0.4, 0.0, 0.0] == pytest.approx(0.05, abs=1e-10) and center[0] > 0.25


def test_arms_do_not_touch_the_base_that_carries_them_with_a_floor():
    """In MuJoCo, a body may collide with a parent that is welded to the world; --floor leaves that alone."""
    text = """<mujoco><worldbody><body name="stand"><geom name="s" size="0.1" pos="0 0 0.5"/>
      <body name="arm" pos="0 0 0.5"><joint axis="0 1 0"/><geom name="a" type="capsule" fromto="0 0 0 0.3 0 0" size="0.05"/>
      </body></body></worldbody></mujoco>"""
    mechanism = parse_mechanism(text)
    assert mechanism.source.data["contacts"]["arm_s"]["active"] is False
    assert [contact.name for contact in on_floor(mechanism).contacts] == ["floor"] * 2
