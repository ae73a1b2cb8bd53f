"""Robots of the package example-robot-data against Pinocchio: read, written, and read again.

Both come with the extra 'robots' (130 MB, most of it meshes). Without them these tests are skipped.
"""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.files.urdf.writer import to_urdf
from test.generators.mechanisms import accelerations, random_state

pin = pytest.importorskip("pinocchio", reason="needs the extra 'robots': pip install '.[robots]'")
FOLDERS = [Path(place) / "cmeel.prefix" / "share" / "example-robot-data" / "robots" for place in sys.path]
ROBOTS = next((folder for folder in FOLDERS if folder.is_dir()), None)
if ROBOTS is None:
    pytest.skip("needs the extra 'robots': pip install '.[robots]'", allow_module_level=True)

from test.oracles.urdf_oracle import Oracle  # noqa: E402

CASES = [
    ("panda_description/urdf/panda.urdf", "fixed"),
    ("ur_description/urdf/ur5_robot.urdf", "fixed"),
    ("kinova_description/robots/kinova.urdf", "fixed"),
    ("xarm_description/urdf/xarm7.urdf", "fixed"),
    ("go2_description/urdf/go2.urdf", "free"),
    ("a1_description/urdf/a1.urdf", "free"),
    ("anymal_c_simple_description/urdf/anymal.urdf", "free"),
    ("solo_description/robots/solo12.urdf", "free"),
    ("talos_data/robots/talos_full_v2.urdf", "free"),
]


def text_of(path):
    """A robot's URDF, without `<mimic>`, which Pinocchio does not read unless asked to."""
    return re.sub(r"<mimic[^>]*/>", "", (ROBOTS / path).read_text(encoding="utf-8"))


def close(mechanism, oracle, rng, tolerance):
    equations = derive(mechanism)
    for _ in range(5):
        state = random_state(mechanism, rng)
        exact = oracle.accelerations(*state)
        assert np.max(np.abs(accelerations(equations, *state) - exact)) <= tolerance * np.max(np.abs(exact))


@pytest.mark.parametrize(("path", "base"), CASES, ids=[Path(path).stem for path, _ in CASES])
def test_accelerations_of_a_robot(path, base):
    mechanism = parse_mechanism(text_of(path), path, base)
    close(mechanism, Oracle(pin, text_of(path), mechanism, base == "free"), np.random.default_rng(1), 1e-9)


def test_a_mimic_is_a_constraint_on_what_pinocchio_finds_without_it():
    """With G = ∂(q₂ - q₁)/∂q, the accelerations a change by -M⁻¹ Gᵀ (G M⁻¹ Gᵀ)⁻¹ G a."""
    path = CASES[0][0]
    mechanism = parse_mechanism((ROBOTS / path).read_text(encoding="utf-8"), path)
    (coupling,) = mechanism.constraints
    first, second = (mechanism.coordinate_names.index(name) for name in coupling.factors)
    oracle = Oracle(pin, text_of(path), mechanism, free=False)
    q, u, efforts = random_state(mechanism, np.random.default_rng(3))
    q[first], u[first] = q[second], u[second]
    free = oracle.accelerations(q, u, efforts)
    unit = np.eye(len(u))
    inverse = np.column_stack([oracle.accelerations(q, u, efforts + force) - free for force in unit])
    gradient = unit[second] - unit[first]
    exact = free - inverse @ gradient * (gradient @ free) / (gradient @ inverse @ gradient)
    found = accelerations(derive(mechanism), q, u, efforts)
    assert np.max(np.abs(found - exact)) <= 1e-9 * np.max(np.abs(exact))


@pytest.mark.parametrize(("path", "base"), CASES[:1] + CASES[4:5], ids=["panda", "go2"])
def test_pinocchio_takes_the_urdf_that_is_written(path, base):
    mechanism = parse_mechanism(text_of(path), path, base)
    oracle = Oracle(pin, to_urdf(mechanism), mechanism, free=False)
    close(mechanism, oracle, np.random.default_rng(2), 1e-9)


@pytest.mark.parametrize("path", sorted(ROBOTS.rglob("*.urdf")), ids=lambda path: path.stem)
def test_every_robot_loads_or_is_refused_with_a_reason(path):
    refused = {
        "alex_psyonic_hands": "there is no joint 'index_q1'",
        "ur3": "has no <link>",
    }
    text = path.read_text(encoding="utf-8")
    if path.stem in refused:
        with pytest.raises(MechanismError, match=refused[path.stem]):
            parse_mechanism(text)
    else:
        mechanism = parse_mechanism(text)
        assert parse_mechanism(mechanism_text(mechanism.source)).source.data == mechanism.source.data
