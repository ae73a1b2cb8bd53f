"""A mechanism file that begins from a URDF: what is merged, what it may add, and where its problems stand."""

import re
from pathlib import Path

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.files.text.yaml_text import mechanism_text
from test.generators.urdf_robots import arm, quadruped

FIVE_BAR = """<robot name="five_bar">
  <link name="world"/>
  <link name="left_crank">{inertial}<visual><geometry><box size="0.1 0.1 0.4"/></geometry></visual></link>
  <link name="left_rod">{inertial}</link>
  <link name="right_crank">{inertial}</link>
  <link name="right_rod">{inertial}</link>
  <joint name="left_hip" type="revolute">
    <parent link="world"/><child link="left_crank"/><origin xyz="-0.2 0 0"/>
    <axis xyz="0 -1 0"/><limit lower="-2" upper="2" effort="5" velocity="9"/><dynamics damping="0.1" friction="0.2"/>
  </joint>
  <joint name="right_hip" type="continuous">
    <parent link="world"/><child link="right_crank"/><origin xyz="0.2 0 0"/><axis xyz="0 -1 0"/>
  </joint>
  <joint name="left_knee" type="continuous">
    <parent link="left_crank"/><child link="left_rod"/><origin xyz="0 0 -0.4"/><axis xyz="0 -1 0"/>
  </joint>
  <joint name="right_knee" type="continuous">
    <parent link="right_crank"/><child link="right_rod"/><origin xyz="0 0 -0.4"/><axis xyz="0 -1 0"/>
  </joint>
</robot>""".format(
    inertial='<inertial><origin xyz="0 0 -0.2"/><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.001"/></inertial>'
)

PAGE = (Path(__file__).parents[3] / "docs" / "urdf.md").read_text(encoding="utf-8")


@pytest.fixture
def overlay(tmp_path):
    """Writes the file beside its URDFs, and returns its path."""
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "five.urdf").write_text(FIVE_BAR)
    (tmp_path / "robots" / "arm.urdf").write_text(arm())
    (tmp_path / "four.urdf").write_text(quadruped())

    def write(text):
        path = tmp_path / "robot.yaml"
        path.write_text(text)
        return path

    return write


def problems_of(path):
    with pytest.raises(MechanismError) as caught:
        load_mechanism(path)
    return [str(problem).removeprefix(f"{path.parent}/") for problem in caught.value.problems]


def test_the_urdf_is_looked_for_beside_the_file(overlay, monkeypatch, tmp_path_factory):
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    mechanism = load_mechanism(overlay("urdf: robots/arm.urdf"))
    assert mechanism.name == "seven_axes" and mechanism.joints["base"].type == "fixed"
    assert load_mechanism(overlay("urdf: robots/arm.urdf\nmechanism: mine\ndescription: an arm")).name == "mine"


def test_a_loop_is_closed_between_links(overlay):
    path = overlay("""
urdf: robots/five.urdf
gravity: [0, 0, -1.62]
integrator: {method: rk4, step: 2 ms}
parameters: {l: 0.4, k: 50}
parts:
  left_rod: {points: {foot: [0, 0, -l]}}
  right_rod: {points: {foot: [0, 0, -l]}}
joints:
  foot: {type: revolute, between: [left_rod.foot, right_rod.foot], axis: [0, -1, 0]}
  left_hip: {position: 20 deg, stiffness: 3, limits: {stiffness: 1e3}}
  right_hip: {position: -20 deg}
  left_knee: {position: -30 deg, guess: true}
  right_knee: {position: 30 deg, guess: true}
forces:
  rope: {type: spring, between: [ground, left_rod.foot], stiffness: k, length: l}
""")
    simulation = Simulation.from_file(path, method="rk4")
    mechanism = simulation.mechanism
    hip = mechanism.joints["left_hip"]
    assert list(mechanism.closing) == ["foot"] and simulation.model.degrees_of_freedom == 2
    assert (hip.limits[0].lower, hip.limits[0].upper, hip.limits[0].stiffness) == (-2.0, 2.0, 1e3)
    assert (hip.damping[0], hip.friction.coulomb, hip.effort_limit, hip.stiffness[0]) == (0.1, 0.2, 5.0, 3.0)
    assert (mechanism.gravity[2], mechanism.method, mechanism.step) == (-1.62, "rk4", 2e-3)
    simulation.run(until=0.2)
    assert simulation.violation.position < 1e-12
    again = Simulation(parse_mechanism(mechanism_text(mechanism.source)))
    again.run(until=0.2)
    assert again.state.tobytes() == simulation.state.tobytes()


def test_a_free_base_starts_where_it_is_put(overlay):
    path = overlay("urdf: four.urdf\nbase: free\njoints:\n  base: {position: [0, 0, 0.4], velocity: [1, 0, 0]}\n")
    simulation = Simulation.from_file(path, method="rk4")
    assert simulation.q[:3].tolist() == [0, 0, 0.4] and simulation.u[0] == 1.0


def test_the_base_may_be_fixed_to_a_point_of_ground(overlay):
    path = overlay("""
urdf: robots/arm.urdf
ground: {points: {table: [0, 0, 0.8]}}
joints: {base: {between: [ground.table, base_link]}}
""")
    assert Simulation.from_file(path, method="rk4").poses()["base_link"].position.tolist() == [0, 0, 0.8]


def test_ground_points_are_merged(overlay):
    mechanism = load_mechanism(overlay("urdf: robots/five.urdf\nground: {points: {wall: [1, 0, 0]}}"))
    assert set(mechanism.ground_points) == {"left_hip", "right_hip", "wall"}


def test_parts_and_their_keys_are_replaced_or_added(overlay):
    mechanism = load_mechanism(
        overlay("""
urdf: robots/five.urdf
parts:
  left_crank: {mass: 7, points: {bolt: [0.1, 0, 0]}, shape: {type: sphere, radius: 0.1}}
  load: {mass: 3, shape: {type: sphere, radius: 0.05}}
joints:
  hold: {type: fixed, between: [left_rod, load]}
""")
    )
    crank = mechanism.parts["left_crank"]
    assert crank.mass == 7.0 and set(crank.points) == {"left_knee", "bolt"} and crank.inertia[0, 0] == 0.01
    assert [shape.kind for shape in crank.shapes] == ["sphere"]
    assert mechanism.joints["hold"].child == "load"


def test_shapes_with_a_mass_make_a_body_of_a_frame(overlay):
    tool = "urdf: robots/arm.urdf\nparts:\n  tool0: {shape: {type: sphere, radius: 0.1, mass: 2}}\n  link1: {shapes: [{type: sphere, radius: 1}]}"
    mechanism = load_mechanism(overlay(tool))
    assert mechanism.parts["tool0"].mass == 2.0 and mechanism.parts["tool0"].inertia[0, 0] == pytest.approx(0.008)
    assert mechanism.parts["link1"].mass == 4.9 and len(mechanism.parts["link1"].shapes) == 1


def test_damaged_overlays_are_answered_with_a_mechanism_error(overlay):
    rng = np.random.default_rng(6)
    whole = """urdf: robots/five.urdf
base: fixed
ground: {points: {wall: [1, 0, 0]}}
parts: {left_rod: {mass: 3, points: {foot: [0, 0, -1]}, shapes: [{type: sphere, radius: 1, mass: 3}]}}
joints: {left_hip: {type: revolute, limits: {upper: 3}, friction: {coulomb: 1}, position: 1}, right_hip: {drive: t}}
constraints: {rod: {type: distance, between: [left_rod, right_rod], length: 1}}
"""
    words = list(re.finditer(r"[\w.]+|\{[^{}]*\}|\[[^\[\]]*\]", whole))
    for _ in range(40):
        word = words[rng.integers(len(words))]
        put = str(rng.choice(["", "3", "[]", "{}", "x", "[1, x]", "{a: {}}", "base", "left_rod"]))
        try:
            load_mechanism(overlay(whole[: word.start()] + put + whole[word.end() :]))
        except MechanismError as error:
            assert str(error)


def test_a_joint_is_given_another_type_a_drive_or_no_limits(overlay):
    mechanism = load_mechanism(
        overlay("""
urdf: robots/five.urdf
joints:
  left_hip: {drive: 0.3*sin(2*t)}
  right_hip: {type: fixed}
  left_knee: {type: spherical, damping: 0.1}
""")
    )
    assert mechanism.driven_names == ("left_hip",) and mechanism.joints["left_hip"].limits == ()
    assert mechanism.joints["right_hip"].type == "fixed"
    assert mechanism.joints["left_knee"].parent_pose.position.tolist() == [0, 0, -0.4]
    free = load_mechanism(
        overlay("urdf: robots/five.urdf\njoints:\n  left_hip:\n    limits:\n    friction:\n    damping: 0\n")
    )
    assert free.joints["left_hip"].limits == () and free.joints["left_hip"].friction is None


def test_entries_without_a_value_change_nothing(overlay):
    plain, empty = (
        load_mechanism(overlay(text))
        for text in ("urdf: robots/five.urdf", "urdf: robots/five.urdf\njoints: {left_hip: }\nparts:\nforces:\n")
    )
    assert plain.source.data == empty.source.data


def test_problems_name_the_file_that_has_them(overlay):
    path = overlay("""urdf: robots/five.urdf
base: loose
joints:
  left_hpi: {position: 1}
  left_hip: {limits: {upper: -3}}
  right_hip: {dampng: 3}
  new: {type: revolute, between: [right_rod.tip, left_rod], axis: [0, 1, 0]}
parts:
  left_rod: {mass: -1}
""")
    bad = path.parent / "robots" / "five.urdf"
    bad.write_text(FIVE_BAR.replace('izz="0.001"', 'izz="x"', 1))
    found = problems_of(path)
    for begin in (
        "robots/five.urdf:3: link[left_crank].inertial.inertia.izz: 'x' is not a number",
        "robot.yaml:2: base: unknown word (got 'loose'). Write fixed or free.",
        "robot.yaml:4: joints.left_hpi: the URDF has no joint 'left_hpi', and 'type' is missing. Did you mean 'left_hip'?",
        "robot.yaml:5: joints.left_hip.limits: lower -2 is not below upper -3.",
        "robot.yaml:6: joints.right_hip.dampng: unknown key 'dampng'. Did you mean 'damping'?",
        "robot.yaml:7: joints.new.between[0]: 'right_rod' has no point 'tip'",
        "robot.yaml:9: parts.left_rod.mass: must be at least 0",
    ):
        assert any(problem.startswith(begin) for problem in found), begin


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("urdf: robots/fiv.urdf", "urdf: there is no such file"),
        ("urdf: robots/fiv.urdf", "Did you mean 'five.urdf'?"),
        ("urdf: robots", "there is no such file"),
        ("urdf: [1]\nmechanism: a", "urdf: must be text"),
        ('urdf: "a\\0b"', "there is no such file"),
        ("urdf: robot.yaml", "not valid XML"),
        ("base: free\nmechanism: a", "base: 'base' needs a URDF, but 'urdf' is missing"),
        ("mechanism: a\nurd: x", "unknown key 'urd'. Did you mean 'urdf'?"),
        ("urdf: robots/five.urdf\nparts: 3", "robot.yaml:2: parts: must be a mapping"),
        ("urdf: robots/five.urdf\njoints: {left_hip: 3}", "joints.left_hip"),
        ("urdf: robots/five.urdf\nbase: free", "five.urdf:2: link[world]: stands for ground"),
        ("urdf: robots/five.urdf\nbase: [1]", "base: unknown word"),
    ],
)
def test_mistakes(overlay, text, expected):
    assert any(expected in problem for problem in problems_of(overlay(text)))


def test_the_json_schema_lets_a_file_with_a_urdf_leave_out_what_the_urdf_has():
    import jsonschema

    from mbd_sim.files.checks.json_schema import json_schema
    from mbd_sim.files.text.yaml_text import parse_source

    validator = jsonschema.Draft202012Validator(json_schema())
    text = "urdf: a.urdf\nbase: free\njoints: {elbow: {position: 30 deg}}"
    assert validator.is_valid(parse_source(text).data)
    assert not validator.is_valid(parse_source(text.replace("urdf: a.urdf", "mechanism: a")).data)
    assert not validator.is_valid(parse_source(text.replace("free", "loose")).data)


def test_a_mimic_of_the_urdf_can_be_replaced(overlay):
    path = overlay("urdf: robots/m.urdf\nconstraints: {right_knee_mimic: {terms: {right_knee: 1, left_knee: 1}}}")
    (path.parent / "robots" / "m.urdf").write_text(
        FIVE_BAR.replace(
            '<axis xyz="0 -1 0"/>\n  </joint>\n</robot>',
            '<axis xyz="0 -1 0"/><mimic joint="left_knee"/></joint></robot>',
        )
    )
    (coupling,) = load_mechanism(path).constraints
    assert coupling.factors == {"right_knee": 1.0, "left_knee": 1.0}
    simulation = Simulation.from_file(path, method="rk4")
    simulation.run(until=0.1)
    q = dict(zip(simulation.coordinate_names, simulation.q, strict=True))
    assert np.isclose(q["right_knee"], -q["left_knee"], atol=1e-12)


def test_the_example_of_the_page_runs(overlay):
    text = next(block for block in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL) if "five_bar" in block)
    simulation = Simulation.from_file(overlay(text.replace("five_bar.urdf", "robots/five.urdf")), method="rk4")
    simulation.run(until=0.1)
    assert (
        simulation.model.degrees_of_freedom == 2
        and simulation.mechanism.joints["left_hip"].limits[0].stiffness == 1000.0
    )


@pytest.mark.parametrize("value", ["[null]", "[[]]", "[1, null]", "[{}]"])
@pytest.mark.parametrize(
    "key", ["parts", "joints", "parts.left_rod", "parts.left_rod.points", "joints.left_hip.limits", "ground", "gravity"]
)
def test_lists_in_place_of_mappings_are_reported(overlay, key, value):
    *outer, last = key.split(".")
    text = "mechanism: odd\nurdf: robots/five.urdf\n"
    text += "".join("  " * depth + f"{name}:\n" for depth, name in enumerate(outer))
    assert problems_of(overlay(text + "  " * len(outer) + f"{last}: {value}\n"))
