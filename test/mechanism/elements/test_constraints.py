"""Every kind of constraint has all that the package needs to know of it: a new one fails here until it is complete."""

import dataclasses
from pathlib import Path
from typing import get_args

import pytest

from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.schema.constraints import AnyConstraintSpec
from mbd_sim.files.sdf.writer import to_sdf
from mbd_sim.files.urdf.writer import left_out
from mbd_sim.mechanism.elements.constraints import Constraint, ContactLaw, Play, is_one_sided
from mbd_sim.mechanism.values.expression import TimeExpression
from test.generators.loops import ROWS

ROOT = Path(__file__).parents[3]
KEYS = {
    "distance": "between: [ground.peg, rod], length: 0.5",
    "on_plane": "point: rod",
    "on_line": "point: rod, direction: [1, 0, 0]",
    "on_surface": "point: rod, equation: z",
    "on_curve": "point: rod, equations: [y, z]",
    "gear": "joints: [hinge, pin], radii: [1, 2]",
    "rack": "pinion: hinge, rack: slide, radius: 1",
    "coupling": "terms: {hinge: 1, slide: 2, pin: 3}",
    "rolling": "wheel: rod, radius: 0.1, axis: [0, 1, 0]",
    "knife_edge": "at: rod, direction: [1, 0, 0]",
    "cable": "through: [ground.peg, rod, disc.rim], length: 2",
    "clutch": "terms: {hinge: 1}, capacity: 2",
}
FILE = """
mechanism: constrained
ground: {{points: {{peg: [0.3, 0, 0.4]}}}}
parts:
  rod: {{mass: 2, inertia: [0.1, 0.2, 0.3]}}
  disc: {{mass: 1, inertia: [1, 1, 1], points: {{rim: [1, 0, 0]}}}}
  cart: {{mass: 1, inertia: [1, 1, 1]}}
  arm: {{mass: 1, inertia: [1, 1, 1]}}
joints:
  flight: {{type: free, between: [ground, rod], position: [0, 0, 0.1], guess: true}}
  hinge: {{type: revolute, between: [ground, disc], axis: [0, 1, 0]}}
  slide: {{type: prismatic, between: [ground, cart], axis: [1, 0, 0]}}
  pin: {{type: revolute, between: [ground, arm], axis: [0, 1, 0]}}
constraints: {{one: {{type: {type}, {keys}}}}}
"""


def constrained(kind):
    return parse_mechanism(FILE.format(type=kind, keys=KEYS[kind]))


def test_the_schema_the_records_the_oracles_and_these_tests_have_the_same_kinds():
    in_files = [get_args(spec.model_fields["type"].annotation) for spec in get_args(get_args(AnyConstraintSpec)[0])]
    assert sorted(kind for kinds in in_files for kind in kinds) == sorted(KEYS)
    assert {type(constrained(kind).constraints[0]) for kind in KEYS} == set(get_args(Constraint))
    assert set(KEYS) - {"clutch"} <= set(ROWS), "random loops lack it"


@pytest.mark.parametrize("kind", KEYS)
def test_the_exports_and_the_page_name_it(kind):
    """An export contains it, or says that it does not."""
    mechanism = constrained(kind)
    assert mechanism.constraints[0].kind == kind
    assert f"\n| `{kind}` |" in (ROOT / "docs" / "mechanism_file.md").read_text(encoding="utf-8")
    mjcf = to_mjcf(mechanism)
    for text, missing in ((mjcf.text, mjcf.left_out), ("", left_out(mechanism))):
        mimicked = kind in ("gear", "rack")
        assert 'name="one"' in text or mimicked or any("one" in one.split(": ")[-1] for one in missing)
    assert kind in ("gear", "rack") or any("one" in one.split(": ")[-1] for one in to_sdf(mechanism).left_out)


LAWS = {
    "ContactLaw | None": ContactLaw(),
    "Play | None": Play(0.1, 0.0),
    "TimeExpression | None": TimeExpression("1", {}),
}
ONE_SIDED = [
    (kind, field.name, LAWS[str(field.type)])
    for kind in get_args(Constraint)
    for field in dataclasses.fields(kind)
    if str(field.type) in LAWS
]


@pytest.mark.parametrize(("kind", "key", "value"), ONE_SIDED)
def test_one_with_a_law_a_play_or_a_capacity_is_one_sided(kind, key, value):
    """Otherwise it would act both ways."""
    required = {
        field.name: None
        for field in dataclasses.fields(kind)
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    }
    assert not is_one_sided(kind(**required))
    assert is_one_sided(kind(**required | {key: value}))
