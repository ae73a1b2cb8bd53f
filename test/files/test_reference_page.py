"""The reference page: its examples load, and its errors are those that the program prints."""

import re
from pathlib import Path

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from mbd_sim.integrators.methods import METHODS
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS

PAGE = (Path(__file__).parents[2] / "docs" / "mechanism_file.md").read_text(encoding="utf-8")
FILES = re.findall(r"```yaml\n(mechanism:.*?)```", PAGE, re.DOTALL)
BROKEN = next(text for text in FILES if text.startswith("mechanism: arm\n"))


@pytest.mark.parametrize("text", [text for text in FILES if text != BROKEN])
def test_its_examples_load(text):
    equations = derive(parse_mechanism(text))
    rates = equations.rates.call([0.0, equations.start_state, equations.inputs_without_commands])[0]
    assert np.all(np.isfinite(np.array(rates)))


def test_its_errors_are_those_of_its_broken_example():
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(BROKEN, "arm.yaml")
    assert re.findall(r"^arm\.yaml:.*$", PAGE, re.MULTILINE) == str(caught.value).splitlines()


@pytest.mark.parametrize("name", METHODS)
def test_it_names_every_integration_method(name):
    assert f"`{name}` (" in PAGE


@pytest.mark.parametrize("kind", JOINT_KINDS)
def test_it_names_the_coordinates_of_every_joint_type(kind):
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{kind}` |"))
    assert re.findall(r"`name([.\w]*)`", row) == list(JOINT_KINDS[kind].labels)
