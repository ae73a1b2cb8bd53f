"""How the code is built: imports without circles, functions that fit on a screen. The order of folders: test_docs."""

import ast
import functools
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LONGEST = 60  # lines of a function
LONGEST_DERIVE = 40  # lines of code of `derive`, the table of contents of the equations of motion


@functools.cache
def modules():
    """The syntax tree of each module of the package, by name."""
    found = {}
    for path in (ROOT / "mbd_sim").rglob("*.py"):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def imports_of(name):
    """The modules of the package that one imports anywhere, in functions too, but not for type checking alone."""
    tree = modules()[name]
    skipped = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules())
        elif isinstance(node, ast.ImportFrom) and node.module in modules():
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in modules() else node.module


def functions(tree):
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def length(function):
    return function.end_lineno - function.lineno + 1


def test_no_module_imports_itself_over_others():
    graph = {name: set(imports_of(name)) - {name, "mbd_sim"} for name in modules()}  # mbd_sim itself imports lazily
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" → ".join(error.args[1]))


def test_functions_fit_on_a_screen():
    long = {
        f"{name}.{function.name}": length(function)
        for name, tree in modules().items()
        for function in functions(tree)
        if length(function) > LONGEST
    }
    assert not long


def test_derive_is_a_table_of_contents():
    (derive,) = (one for one in functions(modules()["mbd_sim.dynamics.equations"]) if one.name == "derive")
    code = derive.body[1:]  # after the docstring
    assert code[-1].end_lineno - code[0].lineno + 1 <= LONGEST_DERIVE
