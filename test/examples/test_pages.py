"""The pages of the examples: their commands, links, launch files and code are there and run."""

import ast
import re
from pathlib import Path

import pytest

from mbd_sim.mechanism_file.library import shipped

ROOT = Path(__file__).resolve().parent.parent.parent
CONTROL = ROOT / "docs" / "control.md"
PAGES = [CONTROL, *sorted((ROOT / "examples").glob("*/README.md"))]
BLOCKS = [
    b for b in re.findall(r"```python\n(.*?)```", CONTROL.read_text(encoding="utf-8"), re.DOTALL) if "Lockstep" not in b
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.parent.name)
def test_what_a_page_names_is_there(page):
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        assert (page.parent / link).exists(), link
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    for program in re.findall(r"\bexample_(\w+)", text):
        assert f'"{program}"' in setup
        assert (ROOT / "scripts" / f"example_{program}").resolve() == ROOT / "scripts" / "sim_node"
    for launch in re.findall(r"launch mbd_sim (\S+?\.launch\.py)", text):
        assert len(list((ROOT / "examples").rglob(launch))) == 1
    assert set(re.findall(r"mechanism:=(\w+)", text)) <= set(shipped())


@pytest.mark.parametrize("folder", sorted(path.name for path in (ROOT / "examples").iterdir()))
def test_every_example_has_a_page_a_picture_and_a_launch_file(folder):
    here = ROOT / "examples" / folder
    assert (here / "README.md").read_text(encoding="utf-8").count(f"({folder}.png)") == 1
    assert f"examples/{folder}/README.md" in CONTROL.read_text(encoding="utf-8")
    launch = here / f"{folder}.launch.py"
    tree = ast.parse(launch.read_text(encoding="utf-8"))
    assert "generate_launch_description" in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("block", BLOCKS)
def test_the_code_of_the_page_runs(block):
    values = {}
    exec(block.replace('"async"', '"sync"'), values)  # test/gym starts processes
    if "envs" in values:
        values["envs"].close()
