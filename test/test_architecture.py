"""How the code is built: imports without circles and downward only, small folders, functions that fit on a screen."""

import ast
import functools
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

from test import without_ros

ROOT = Path(__file__).resolve().parent.parent
LARGEST_FOLDER = 12  # modules
LONGEST = 60  # lines of a function
LONGEST_DERIVE = 40  # lines of code of `derive`, the table of contents of the equations of motion
# From above to below; a module imports only from its own folder and from those after it.
ORDER = (
    "__main__", "programs", "cli", "examples", "ros", "many", "exports", "notebook", "lab", "recordings", "imports", "studies", "pictures", "simulation",
    "files", "analysis", "dynamics", "compiler", "integrators", "mechanism", "base",
)  # fmt: skip
TEXT = re.compile(r"\bmbd_sim(?:\.\w+)+")


class Module(NamedTuple):
    text: str
    tree: ast.Module


def parsed(text):
    return Module(text, ast.parse(text))


@functools.cache
def modules():
    """Each module of the package by name, without `mbd_sim.`; a folder has its __init__."""
    found = {}
    for path in sorted((ROOT / "mbd_sim").rglob("*.py")):
        name = ".".join(path.relative_to(ROOT / "mbd_sim").with_suffix("").parts)
        found[name.removesuffix("__init__").removesuffix(".")] = parsed(path.read_text(encoding="utf-8"))
    return found


@functools.cache
def statements(tree):
    """Those of a syntax tree at any depth, in no order: to walk through all expressions takes longer than everything else."""
    found, left = [], [tree]
    while left:
        node = left.pop()
        found.append(node)
        for field in ("body", "orelse", "finalbody", "handlers", "cases"):
            left += getattr(node, field, ())
    return found


@functools.cache
def folders():
    return {name.rpartition(".")[0] for name in modules()} | {""}


def module_of(dotted):
    """The module that a dotted name such as `mbd_sim.base.errors.InputError` is in, or None."""
    parts = dotted.split(".")[1:]
    while parts and ".".join(parts) not in modules():
        parts.pop()
    return ".".join(parts) or None


def exporter(folder, name):
    """The module from which a folder's __init__ exports a name, or the folder itself."""
    for node in statements(modules()[folder].tree):
        if isinstance(node, ast.ImportFrom) and any((alias.asname or alias.name) == name for alias in node.names):
            return module_of(node.module) or folder
    return folder


@functools.cache
def imports_of(name):
    """The modules that one imports: at the top, in functions, for type checking alone, and by names in texts."""
    (text, tree), found = modules()[name], set()
    for node in statements(tree):
        if isinstance(node, ast.Import):
            found |= {module_of(alias.name) for alias in node.names if alias.name.startswith("mbd_sim.")}
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "mbd_sim":
            for alias in node.names:
                inner = module_of(f"{node.module}.{alias.name}")
                if inner in folders():
                    inner = exporter(inner, alias.name)
                elif inner is None and node.module == "mbd_sim":
                    inner = exporter("", alias.name)
                found.add(inner)
    if TEXT.search(re.sub(r"(?m)^ *(from|import) .*", "", text)):
        documentation = {id(node.value) for node in statements(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
                found |= {module_of(text) for text in TEXT.findall(node.value)}
    return found - {name, None, ""}


def graph():
    """The imports of all modules but those of the folders' __init__, which export what is below them."""
    return {name: imports_of(name) for name in modules() if name and name not in folders()}


def fail_at_a_circle(edges):
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        pytest.fail(" → ".join(error.args[1]))


def test_no_module_imports_itself_over_others():
    fail_at_a_circle(graph())


def test_no_folder_imports_itself_over_others():
    edges = {}
    for name, imported in graph().items():
        here = name.rpartition(".")[0]
        there = {other if other in folders() else other.rpartition(".")[0] for other in imported}
        edges.setdefault(here, set()).update(there - {here})
    fail_at_a_circle(edges)


def test_imports_go_downward_only():
    wrong = [
        f"{name} imports {other}"
        for name in modules()
        if name
        for other in imports_of(name)
        if ORDER.index(other.split(".")[0]) < ORDER.index(name.split(".")[0])
    ]
    assert not wrong


@pytest.mark.parametrize(
    "text",
    [
        "from mbd_sim.cli.main import main",
        "import mbd_sim.cli.main",
        "from mbd_sim.cli import main",
        "def late():\n    from mbd_sim.cli import main",
        "if TYPE_CHECKING:\n    from mbd_sim.cli.main import main",
        "import_module('mbd_sim.cli.main')",
    ],
)
def test_every_kind_of_import_is_seen(text, monkeypatch):
    monkeypatch.setitem(modules(), "base.invented", parsed(text))
    assert imports_of.__wrapped__("base.invented") == {"cli.main"}


def test_names_of_the_public_interface_count_as_their_modules(monkeypatch):
    monkeypatch.setitem(modules(), "base.invented", parsed("from mbd_sim import Simulation"))
    assert imports_of.__wrapped__("base.invented") == {"notebook.simulation"}


def test_folders_are_small():
    sizes = {}
    for name in modules():
        if name and name not in folders():
            sizes.setdefault(name.rpartition(".")[0], []).append(name)
    assert not {folder: len(names) for folder, names in sizes.items() if len(names) > LARGEST_FOLDER}
    assert set(sizes[""]) == {"__main__", "programs"}


def test_overviews_of_folders_name_their_modules():
    """The first column of a table in the docstring of a folder's __init__."""
    found = [
        (folder, name)
        for folder in sorted(folders() - {""})
        for row in re.findall(r"^\| (`.*?`) \|", ast.get_docstring(modules()[folder].tree) or "", re.MULTILINE)
        for name in re.findall(r"`(\w+)`", row)
    ]
    assert len(found) > 40
    assert not [f"{folder}: {name}" for folder, name in found if f"{folder}.{name}" not in modules()]


def test_tests_mirror_the_folders_of_the_package():
    own = {"benchmarks", "docs", "generators", "oracles", "physics", "ros_interfaces", "system"}
    tested = {path.parent.relative_to(ROOT / "test") for path in (ROOT / "test").rglob("test_*.py")}
    strange = [
        str(folder)
        for folder in sorted(tested)
        if folder.parts and folder.parts[0] not in own and ".".join(folder.parts) not in folders()
    ]
    assert not strange


def test_no_two_classes_have_one_name():
    """A name that a reader has met once must not mean another thing elsewhere."""
    places = {}
    for name, module in modules().items():
        for node in statements(module.tree):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(name)
    assert not {name: found for name, found in places.items() if len(found) > 1}


def functions(tree):
    return [node for node in statements(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def length(function):
    return function.end_lineno - function.lineno + 1


def test_functions_fit_on_a_screen():
    long = {
        f"{name}.{function.name}": length(function)
        for name, module in modules().items()
        for function in functions(module.tree)
        if length(function) > LONGEST
    }
    assert not long


def bound_in_comprehensions(tree):
    """Names of variables of comprehensions anywhere in a tree."""
    found = [node for node in ast.walk(tree) if isinstance(node, ast.ListComp | ast.SetComp | ast.DictComp)]
    targets = [one.target for node in found for one in node.generators]
    return {node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)}


def test_variables_of_comprehensions_are_not_functions_that_are_called_beside_them():
    """Python 3.12.1 takes such a function for the variable, and ends with an UnboundLocalError."""
    for name, (text, tree) in modules().items():
        imported = [alias for node in statements(tree) if isinstance(node, ast.ImportFrom) for alias in node.names]
        top = {alias.asname or alias.name for alias in imported} | {node.name for node in functions(tree)}
        targets = {word for target in re.findall(r"\bfor\s(.+?)\sin\b", text) for word in re.findall(r"\w+", target)}
        if not targets & top or not bound_in_comprehensions(tree) & top:
            continue
        for function in functions(tree):
            called = {getattr(node.func, "id", "") for node in ast.walk(function) if isinstance(node, ast.Call)}
            assert not bound_in_comprehensions(function) & top & called, f"{name}.{function.name}"


def test_pictures_are_drawn_without_the_state_of_pyplot_or_a_display():
    assert not [name for name, module in modules().items() if "pyplot" in module.text]


def test_derive_is_a_table_of_contents():
    (derive,) = (one for one in functions(modules()["dynamics.equations"].tree) if one.name == "derive")
    code = derive.body[1:]  # after the docstring
    assert code[-1].end_lineno - code[0].lineno + 1 <= LONGEST_DERIVE


def test_files_of_tests_that_reach_ros_over_others_are_left_out_without_it():
    """`make test` on a board collects all others."""
    recordings = without_ros.HERE / "recordings" / "run"
    assert without_ros.needs_ros(recordings / "test_verification.py")
    assert not without_ros.needs_ros(recordings / "test_recorded_accelerations.py")
