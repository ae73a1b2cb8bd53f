"""No result depends on the order of parts, joints, constraints, contacts, forces, or the parts of a contact."""

from __future__ import annotations

import random
from importlib.resources import files

import numpy as np
import pytest
import yaml

from mbd_sim import Simulation

TIME = 0.3
SECTIONS = "parts", "joints", "constraints", "contacts", "forces"
NAMES = [
    "newtons_cradle",
    "slider_crank_friction",
    "woodpecker",
]


class Loader(yaml.SafeLoader):
    """Leaves words such as `on` as they are."""


Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != "tag:yaml.org,2002:bool"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def permuted(data, chance):
    """The same mechanism, written in another order."""
    changed = dict(data)
    for section in SECTIONS:
        if isinstance(entries := changed.get(section), dict):
            items = list(entries.items())
            chance.shuffle(items)
            changed[section] = dict(items)
    if "contacts" in changed:
        changed["contacts"] = {name: with_shuffled_lists(spec, chance) for name, spec in changed["contacts"].items()}
    return changed


def with_shuffled_lists(spec, chance):
    spec = dict(spec)
    for key in ("parts", "among", "between"):
        if isinstance(spec.get(key), list) and not (key == "between" and spec.get("inside")):
            spec[key] = chance.sample(spec[key], len(spec[key]))
    return spec


def poses_after(data):
    simulation = Simulation.from_text(yaml.safe_dump(data, sort_keys=False), method="tsitouras8")
    simulation.run(until=TIME)
    return {name: np.column_stack([pose.position, pose.rotation]) for name, pose in simulation.poses().items()}


@pytest.mark.parametrize("name", NAMES)
def test_a_mechanism_with_contacts_moves_alike_in_any_order(name):
    path = next((files("mbd_sim").joinpath("..", "config", "contacts")).resolve().glob(f"{name}.yaml"))
    data = yaml.load(path.read_text(), Loader)
    given, other = poses_after(data), poses_after(permuted(data, random.Random(name)))
    for part, pose in given.items():
        assert other[part] == pytest.approx(pose, abs=1e-11), part
