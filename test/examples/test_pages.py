"""The pages of the examples: their commands, links, launch files and code are there and run."""

import ast
import importlib
import re
from pathlib import Path

import pytest

from mbd_sim.files.text.library import shipped

ROOT = Path(__file__).resolve().parent.parent.parent
CONTROL = ROOT / "docs" / "control.md"
EXAMPLES = ROOT / "mbd_sim" / "examples"
PAGES = [CONTROL, *sorted(EXAMPLES.glob("*/README.md"))]
BLOCKS = [
    b for b in re.findall(r"```python\n(.*?)```", CONTROL.read_text(encoding="utf-8"), re.DOTALL) if "Lockstep" not in b
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.parent.name)
def test_what_a_page_names_is_there(page):
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        assert (page.parent / link).exists(), link
    for program in re.findall(r"\bexample_(\w+)", text):
        assert len(list(EXAMPLES.glob(f"*/{program}.py"))) == 1
    for launch in re.findall(r"launch mbd_sim (\S+?\.launch\.py)", text):
        assert (ROOT / "launch" / launch).exists()
    assert set(re.findall(r"mechanism:=(\w+)", text)) <= set(shipped())


@pytest.mark.parametrize("folder", sorted(path.parent.name for path in EXAMPLES.glob("*/__init__.py")))
def test_every_example_has_programs_a_page_a_picture_and_a_launch_file(folder):
    here = EXAMPLES / folder
    assert (here / "README.md").read_text(encoding="utf-8").count(f"({folder}.png)") == 1
    assert (here / f"{folder}.png").exists()
    assert f"examples/{folder}/README.md" in CONTROL.read_text(encoding="utf-8")
    launch = (ROOT / "launch" / f"{folder}.launch.py").read_text(encoding="utf-8")
    functions = {node.name for node in ast.walk(ast.parse(launch)) if isinstance(node, ast.FunctionDef)}
    assert "generate_launch_description" in functions
    modules = [path.stem for path in here.glob("*.py") if path.stem != "__init__"]
    assert all(callable(importlib.import_module(f"mbd_sim.examples.{folder}.{module}").main) for module in modules)
    assert set(re.findall(r'executable="example_(\w+)"', launch)) <= set(modules)


@pytest.mark.parametrize("block", BLOCKS)
def test_the_code_of_the_page_runs(block):
    values = {}
    exec(block.replace('"async"', '"sync"'), values)  # test/many/gym starts processes
    if "envs" in values:
        values["envs"].close()
