"""Drawings to scale: their numbers, their sizes on the paper, their texts, and DXF as `ezdxf` reads it."""

import re

import numpy as np
import pytest

from mbd_sim import InputError, Kinematics, load_mechanism, parse_mechanism
from mbd_sim.cli.main import main
from mbd_sim.pictures.technical import draw_plan, make_plan
from mbd_sim.pictures.technical.dxf import circle_of
from mbd_sim.pictures.technical.paper import POINT

LINKAGE = """
mechanism: press
description: A linkage of LINKS
parameters: {a: 40 mm, b: 121.5 mm, c: 90 mm, d: 110 mm, up: 35 mm, start: 63 deg}
ground: {points: {right: [d, 0, up]}}
parts:
  crank: {mass: 1, shape: {type: rod, to: [a, 0, 0]}, points: {tip: [a, 0, 0]}}
  coupler: {mass: 1, shape: {type: rod, to: [b, 0, 0]}, points: {tip: [b, 0, 0], pen: [50 mm, 0, 30 mm]}}
  rocker: {mass: 1, shape: {type: disc, radius: c, axis: [0, 1, 0]}, points: {tip: [c, 0, 0]}}
joints:
  motor: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: start}
  pin: {type: revolute, between: [crank.tip, coupler], axis: [0, -1, 0], position: -40 deg, guess: true}
  pivot: {type: revolute, between: [ground.right, rocker], axis: [0, -1, 0], position: 80 deg, guess: true}
  top: {type: revolute, between: [coupler.tip, rocker.tip], axis: [0, -1, 0], cut: true}
"""
EXPECTED = {"40", "121.5", "90", "110", "35", "63°", "58.31"}


@pytest.fixture(scope="module")
def linkage():
    mechanism = parse_mechanism(LINKAGE)
    return mechanism, Kinematics(mechanism).poses()


def test_dimensions_are_the_numbers_of_the_file(linkage):
    plan = make_plan(*linkage, dimensions=["auto"])
    assert {dimension.text for dimension, _ in plan.dimensions} == EXPECTED
    more = make_plan(
        *linkage, dimensions=["motor,pivot", "angle:pin,motor,pivot", "y:motor,pin", "coupler.pen,coupler.tip"]
    )
    lengths = [dimension.value for dimension, _ in more.dimensions]
    between = np.radians(63) - np.arctan2(35, 110)
    assert lengths == pytest.approx(
        [np.hypot(0.11, 0.035), between, 0.04 * np.sin(np.radians(63)), np.hypot(0.0715, 0.03)]
    )


def test_the_scale_is_true_on_the_paper(linkage):
    plan = make_plan(*linkage, sheet="A3", at_scale="1:2", dimensions=["pivot,motor"])
    assert np.allclose(plan.picture.size, np.array([420, 297]) * POINT)
    rims = [found for path in plan.content.paths if path.group == "PARTS" and (found := circle_of(path.points))]
    assert max(radius for _, radius, _, _ in rims) == pytest.approx(45 * POINT)  # of the disc
    low, high = plan.picture.sheet.bounds()
    assert np.all(low > 0) and np.all(high < plan.picture.size)
    with pytest.raises(InputError, match="at 10:1, and A4 has room for"):
        make_plan(*linkage, at_scale="10:1")
    for wrong, message in (("1:0", "not a scale"), ("half", "not a scale")):
        with pytest.raises(InputError, match=message):
            make_plan(*linkage, at_scale=wrong)
    with pytest.raises(InputError, match="there is no sheet 'B9'"):
        make_plan(*linkage, sheet="B9")


@pytest.mark.parametrize("text", ["motor", "motor,nowhere", "diameter:motor,pin", "angle:motor", "coupler.pan,motor"])
def test_wrong_dimensions_are_refused(linkage, text):
    with pytest.raises(InputError):
        make_plan(*linkage, dimensions=[text])


def test_spatial_mechanisms_have_no_true_lengths():
    mechanism = load_mechanism("six_axis_arm")
    with pytest.raises(InputError, match="not planar"):
        make_plan(mechanism, Kinematics(mechanism).poses(), dimensions=["auto"])


def test_texts_are_texts_in_svg_and_pdf(linkage, tmp_path):
    from pypdf import PdfReader

    plan = make_plan(*linkage, dimensions=["auto"], title="Presse Größe 5")
    draw_plan(plan, tmp_path / "plan.svg")
    svg = set(re.findall(r">([^<>\n]+)</text>", (tmp_path / "plan.svg").read_text(encoding="utf-8")))
    assert {*EXPECTED, "Presse Größe 5", "A linkage of LINKS", "coupler"} <= svg
    draw_plan(plan, tmp_path / "plan.pdf")
    text = PdfReader(tmp_path / "plan.pdf").pages[0].extract_text()
    assert all(word in text for word in (*EXPECTED, "coupler", "Presse Größe 5", "A linkage of LINKS"))


def test_dxf_has_no_errors_and_measures_the_numbers_of_the_file(linkage, tmp_path):
    import ezdxf

    plan = make_plan(*linkage, dimensions=["auto"])
    draw_plan(plan, tmp_path / "plan.dxf")
    document = ezdxf.readfile(tmp_path / "plan.dxf")
    assert not document.audit().errors and document.units == 4
    space = document.modelspace()
    measured = sorted(round(one.get_measurement(), 9) for one in space.query("DIMENSION"))
    assert measured == pytest.approx(sorted([40, 121.5, 90, 110, 35, 63, np.hypot(50, 30)]))
    radii = {round(one.dxf.radius, 6) for one in space.query('CIRCLE[layer=="PARTS"]')}
    assert 90.0 in radii  # the disc is a circle of its true size
    (pen,) = space.query('POINT[layer=="coupler.pen"]')
    assert np.allclose(list(pen.dxf.location)[:2], 1e3 * plan.places("coupler.pen"))
    layers = {one.dxf.layer for one in space}
    assert {"PARTS", "JOINTS", "NAMES", "DIMENSIONS", "SHEET"} <= layers


def test_texts_of_dimensions_in_dxf_are_read_from_below_or_from_the_right(linkage, tmp_path):
    import ezdxf

    pairs = ["motor,pin", "pin,top", "pivot,top", "motor,pivot", "ground,coupler.pen"]
    plan = make_plan(*linkage, dimensions=[*pairs, *(",".join(pair.split(",")[::-1]) for pair in pairs)])
    draw_plan(plan, tmp_path / "plan.dxf")
    dimensions = ezdxf.readfile(tmp_path / "plan.dxf").modelspace().query("DIMENSION")
    texts = [text for one in dimensions for text in one.get_geometry_block().query("MTEXT")]
    assert len(texts) == 10
    for text in texts:
        assert -90.0 < (text.get_rotation() + 180.0) % 360.0 - 180.0 <= 90.0


def test_coupler_curves_as_dxf(tmp_path, monkeypatch, capsys):
    import ezdxf

    monkeypatch.chdir(tmp_path)
    command = ["kinematics", "four_bar", "--drive", "crank_pivot=0:360deg:37", "--out", "curve.dxf"]
    assert main(command) == 1 and "there are no paths to draw" in capsys.readouterr().err
    assert main([*command, "--point", "coupler.tip"]) == 0
    document = ezdxf.readfile("curve.dxf")
    (curve,) = document.modelspace().query('LWPOLYLINE[layer=="coupler.tip"]')
    points = np.array([point[:2] for point in curve.get_points()])
    assert curve.closed and len(points) == 36 and not document.audit().errors
    assert np.allclose(np.hypot(*(points - [1500.0, 0.0]).T), 1200.0)  # on the rocker's circle
