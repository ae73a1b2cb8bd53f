import re
from pathlib import Path

import pytest

from mbd_sim import InputError
from mbd_sim.mechanism.values.materials import ALSO, MATERIALS, density_of

PAGE = Path(__file__).parents[3] / "docs" / "mechanism_file.md"


def test_the_page_lists_every_material():
    section = PAGE.read_text("utf-8").partition("### Materials")[2].partition("\n## ")[0]
    listed = {name: float(number) for name, number in re.findall(r"`(\w+)`\s(\d+)[,.]", section)}
    assert listed == MATERIALS
    assert dict(re.findall(r"`(\w+)` is `(\w+)`", section)) == ALSO


def test_materials_of_a_file_come_first():
    assert density_of("steel", {"steel": 8000.0}) == 8000.0
    assert density_of("aluminium") == MATERIALS["aluminum"]
    with pytest.raises(InputError, match="Did you mean 'pmma'"):
        density_of("pmmma")
