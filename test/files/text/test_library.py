"""Mechanisms found by path and by shipped name."""

import os
import pkgutil
from pathlib import Path

import pytest

import mbd_sim.files
from mbd_sim.base.errors import MechanismError
from mbd_sim.cli.mechanisms import convert
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.library import READ_SUFFIXES, config_directory, find, shipped
from test.generators.mechanisms import KINDS, SHIPPED
from test.generators.shipped_features import features


def refusal(mechanism):
    with pytest.raises(MechanismError) as caught:
        find(mechanism)
    (problem,) = caught.value.problems
    assert problem.key == "mechanism" and problem.value and problem.remedy
    return problem


def test_everything_below_config_ships_under_the_name_of_its_file():
    files = list(config_directory().rglob("*.yaml"))
    assert files and sorted(shipped().values()) == sorted(files)
    assert all(path.stem == name for name, path in shipped().items())


@pytest.mark.parametrize("name", sorted(shipped()))
def test_every_shipped_mechanism_loads_and_bears_the_name_of_its_file(name):
    mechanism = load_mechanism(name)
    assert mechanism.name == name and mechanism.description
    assert set(mechanism.tree) == set(mechanism.joints) and len(mechanism.tree) == len(mechanism.parts)


def test_the_mechanisms_of_each_kind_have_every_feature_of_the_smooth_ones():
    few, all_smooth = ({one for name in names for one in features(load_mechanism(name))} for names in (KINDS, SHIPPED))
    assert all_smooth - few == set()


def test_a_mechanism_is_found_by_name_and_by_path(tmp_path):
    assert find("rod_pendulum") == config_directory() / "open_chains" / "rod_pendulum.yaml"
    own = tmp_path / "own.yaml"
    own.write_text("x")
    assert find(own) == find(str(own)) == own


def test_a_misspelt_name_is_answered_with_the_nearest():
    problem = refusal("duble_rod")
    assert problem.message == "there is no shipped mechanism of this name" and problem.value == "'duble_rod'"
    assert (
        problem.remedy.startswith("Did you mean 'double_rod'?")
        and "path of a .yaml, .urdf, .xacro, .xml or .sdf file" in problem.remedy
    )


def test_a_misspelt_file_in_this_folder_is_answered_with_the_nearest_file(tmp_path, monkeypatch):
    """Whatever its ending: no shipped mechanism has one."""
    (tmp_path / "arm.urdf.xacro").write_text("x")
    monkeypatch.chdir(tmp_path)
    problem = refusal("arm.urdf.xarco")
    assert problem.message == "there is no such file"
    assert problem.remedy.startswith("Did you mean 'arm.urdf.xacro'?")


def test_a_misspelt_path_is_answered_with_the_nearest_file(tmp_path):
    (tmp_path / "pendulum.yaml").write_text("x")
    problem = refusal(tmp_path / "pendulun.yaml")
    assert problem.message == "there is no such file"
    assert problem.remedy == f"Did you mean '{tmp_path / 'pendulum.yaml'}'?"
    assert refusal(tmp_path / "none" / "pendulum.yaml").remedy == "Check the path."


def test_what_is_there_but_no_mechanism_file_is_not_said_to_be_missing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.txt").write_text("x")
    (tmp_path / "link.yaml").symlink_to("nowhere.yaml")
    assert "a file of this name is here" in refusal("text.txt").message
    assert refusal("text.txt").remedy == "Rename it, for example to 'text.yaml'."
    assert refusal("link.yaml").message == "is a link to 'nowhere.yaml', where there is no file"
    assert refusal("/dev/null").message == "is not a regular file"
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "pipe.yaml").symlink_to("pipe")  # as /dev/stdin is a link to what feeds it
    assert refusal("pipe.yaml").message == "is not a regular file"
    for folder in (".", "./", "..", str(tmp_path)):  # the first two were said to be a shipped name without letters
        assert refusal(folder).message == "is a folder"
    assert refusal("").message == "there is no shipped mechanism of this name"


@pytest.mark.parametrize(
    "name", ["", ".", "a\x00.yaml", "x" * 5000, "x" * 5000 + ".yaml", "~nobody-has-this-name/x.yaml"]
)
def test_what_can_be_no_path_is_refused(name):
    refusal(name)


def test_an_assembly_of_a_cad_program_is_refused_with_the_line_that_imports_it(tmp_path, monkeypatch):
    (tmp_path / "my engine.STEP").write_text("ISO-10303-21;")
    monkeypatch.chdir(tmp_path)
    for path in (tmp_path / "my engine.STEP", "my engine.STEP"):
        assert refusal(path).remedy == f"Import it: mbd_sim import '{path}' --density steel --lab"


def test_a_folder_is_refused(tmp_path, monkeypatch):
    assert refusal(tmp_path).remedy == "Give a mechanism file in it."
    folder = tmp_path / "folder.yaml"
    folder.mkdir()
    assert refusal(folder).message == "is a folder"
    (tmp_path / "rigs").mkdir()
    monkeypatch.chdir(tmp_path)
    assert refusal("rigs").message == "is a folder"


ROOT = Path(mbd_sim.files.__file__).parents[2]
FOLDERS = [Path(folder.module_finder.path) / folder.name for folder in pkgutil.iter_modules(mbd_sim.files.__path__)]
IMPORTED, EXPORTED = (
    [path.name for path in FOLDERS if (path / f"{name}.py").exists()] for name in ("reader", "writer")
)


@pytest.mark.parametrize("name", IMPORTED)
def test_the_suffix_the_help_and_the_pages_name_each_format_that_is_read(name):
    """A new importer fails here until it is complete."""
    assert f".{name}" in READ_SUFFIXES
    assert name.upper() in convert.COMMANDS["convert"].description
    assert any(name in page.stem for page in (ROOT / "docs").glob("*.md"))
    assert (ROOT / "test" / "files" / name / "test_reader.py").exists()


@pytest.mark.parametrize("name", EXPORTED)
def test_each_format_that_is_written_can_be_chosen(name):
    assert name in convert.WRITERS
    assert (ROOT / "test" / "files" / name / "test_writer.py").exists()


def test_three_formats_are_read_and_written():
    assert IMPORTED == EXPORTED == ["mjcf", "sdf", "urdf"]
