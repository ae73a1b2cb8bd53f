"""Outlines and points of mechanism files from DXF drawings: lines and arcs in any order, holes, units, what is refused."""

import math
import random

import numpy as np
import pytest

from mbd_sim import MechanismError, load_mechanism, parse_mechanism
from mbd_sim.files.text.yaml_text import mechanism_text

AREA = 120 * 60 - 20**2 * (1 - math.pi / 4) + math.pi * 60**2 / 2 - math.pi * 15**2  # mm²


@pytest.fixture
def plate(tmp_path):
    """A plate with a rounded corner, a half disc on top and a hole, drawn in any order and direction."""
    import ezdxf

    document = ezdxf.new("R2010")
    document.units = 4
    space, at = document.modelspace(), {"layer": "Outline"}
    space.add_lwpolyline(
        [(120, 60, 0), (120, 20, -math.tan(math.pi / 8)), (100, 0, 0), (0, 0, 0)], format="xyb", dxfattribs=at
    )
    space.add_circle((60, 40), 15, dxfattribs=at)
    space.add_arc((60, 60), 60, 0, 180, dxfattribs=at)
    space.add_line((0, 0), (0, 60), dxfattribs=at)
    space.add_text("a note", dxfattribs=at)
    space.add_circle((20, 20), 5, dxfattribs={"layer": "pin"})
    space.add_point((100, 20), dxfattribs={"layer": "far"})
    return document


def text(shape="", points="", extra=""):
    return f"""
mechanism: plate
parts:
  plate: {{{extra}shape: {{type: outline, profile: {{dxf: plate.dxf, layer: outline{shape}}}, plane: xz, thickness: 8 mm,
    density: 7850}}{points}}}
joints: {{pivot: {{type: revolute, between: [ground, plate], axis: [0, -1, 0]}}}}
"""


def loaded(folder, document, content):
    document.saveas(folder / "plate.dxf")
    (folder / "plate.yaml").write_text(content, encoding="utf-8")
    return load_mechanism(folder / "plate.yaml")


def test_a_profile_with_a_hole_and_points_by_layer(tmp_path, plate):
    points = ", points: {far: {dxf: plate.dxf, layer: far, origin: pin, plane: xz}}"
    mechanism = loaded(tmp_path, plate, text(", origin: pin", points))
    part = mechanism.parts["plate"]
    assert part.mass == pytest.approx(AREA * 1e-6 * 0.008 * 7850, rel=1e-12)
    assert np.allclose(part.points["far"].position, [0.08, 0.0, 0.0], atol=1e-15)
    assert [shape.kind for shape in part.shapes] == ["outline", "outline"]
    moved = loaded(tmp_path, plate, text(", origin: [20, 20]")).parts["plate"]
    assert np.allclose(moved.center, part.center, atol=1e-12)
    again = parse_mechanism(mechanism_text(mechanism.source))  # recordings need no drawing
    assert again.parts["plate"].mass == part.mass and "dxf" not in mechanism_text(mechanism.source)


def test_units_and_a_changed_drawing(tmp_path, plate):
    mass = loaded(tmp_path, plate, text()).parts["plate"].mass
    plate.units = 1
    assert loaded(tmp_path, plate, text()).parts["plate"].mass == pytest.approx(25.4**2 * mass)
    plate.units = 0
    assert loaded(tmp_path, plate, text(", unit: mm")).parts["plate"].mass == pytest.approx(mass)
    with pytest.raises(
        MechanismError, match=r"plate.yaml:4: parts.plate.shape.profile: plate.dxf does not say its unit"
    ):
        loaded(tmp_path, plate, text())


def test_random_outlines_come_back(tmp_path):
    """Polygons with bulges, cut into entities in any order and direction, keep their area and center."""
    import ezdxf

    for seed in range(6):
        rng = random.Random(seed)
        count = rng.randint(3, 9)
        corners = [(40 * math.cos(2 * math.pi * k / count) * rng.uniform(0.8, 1.2),
                    40 * math.sin(2 * math.pi * k / count) * rng.uniform(0.8, 1.2)) for k in range(count)]  # fmt: skip
        bulges = [rng.choice([0.0, 0.2, -0.15]) for _ in corners]
        document = ezdxf.new("R2010")
        document.units = 4
        line = document.modelspace().add_lwpolyline(
            [(*p, b) for p, b in zip(corners, bulges, strict=True)], format="xyb", close=True
        )
        parts = list(line.virtual_entities())
        line.destroy()
        rng.shuffle(parts)
        for part in parts:
            part.dxf.layer = "outline"
            if part.dxftype() == "LINE" and rng.random() < 0.5:
                part.dxf.start, part.dxf.end = part.dxf.end, part.dxf.start
            document.modelspace().add_entity(part)
        chords = sum(x * v - u * y for (x, y), (u, v) in zip(corners, [*corners[1:], corners[0]], strict=True)) / 2
        segments = 0.0
        for (x, y), (u, v), bulge in zip(corners, [*corners[1:], corners[0]], bulges, strict=True):
            if bulge:
                turn = 4 * math.atan(abs(bulge))
                radius = math.dist((x, y), (u, v)) / 2 / math.sin(turn / 2)
                segments += math.copysign(0.5 * radius**2 * (turn - math.sin(turn)), bulge)
        mass = loaded(tmp_path, document, text()).parts["plate"].mass
        assert mass == pytest.approx((chords + segments) * 1e-6 * 0.008 * 7850, rel=1e-9)


@pytest.mark.parametrize(
    "shape, points, change, message",
    [
        ("x", "", None, "has no layer 'outlinex' with anything on it. Did you mean 'Outline'"),
        (", unt: mm", "", None, "'unt' is not a key of a drawing"),
        ("", "", lambda space: space.query("ARC").first.destroy(), "is not closed: it ends at [0, 0.06] m|ends at [0.12, 0.06] m"),
        ("", "", lambda space: space.add_line((0, 0), (0, 60), dxfattribs={"layer": "Outline"}), "not closed|more than two lines"),
        ("", ", points: {a: {dxf: plate.dxf, layer: Outline}}", lambda space: space.add_circle((1, 1), 2, dxfattribs={"layer": "Outline"}),
         "layer 'Outline' has points at"),
        (", origin: [1]", "", None, "origin must be two numbers"),
        (", origin: far", ", points: {a: {dxf: other.dxf, layer: x}}", None, "there is no file"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_named_with_its_line(tmp_path, plate, shape, points, change, message):
    if change is not None:
        change(plate.modelspace())
    with pytest.raises(MechanismError) as error:
        loaded(tmp_path, plate, text(shape, points))
    assert any(one in str(error.value) for one in message.split("|")) and "plate.yaml:" in str(error.value)
