"""Packages that import their modules when a name is first used."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from mbd_sim import compiler, dynamics, integrators, simulation

PACKAGES = (compiler, dynamics, integrators, simulation)


def exported(package):
    """The modules and names of a package that exports lazily."""
    cells = [cell.cell_contents for cell in package.__getattr__.__closure__]
    (module_of,) = [content for content in cells if isinstance(content, dict)]
    return module_of


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_exported_names_exist_and_are_no_modules(package):
    modules = {path.stem for path in Path(package.__path__[0]).glob("*.py")}
    for name, module in exported(package).items():
        assert name not in modules  # importing that module would replace the name
        assert getattr(package, name) is getattr(importlib.import_module(f"{package.__name__}.{module}"), name)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_another_name_is_refused(package):
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'no_such_name'"):
        _ = package.no_such_name


FIRST_STEP = """
import sys
from mbd_sim import Simulation
simulation = Simulation.from_file({file!r}, live={live!r})
simulation.step()
print(*sys.modules)
"""


@pytest.mark.parametrize(("file", "live"), [("spherical_top", ()), ("four_bar", ("gravity[*]", "joints.*.damping"))])
def test_a_first_step_from_the_cache_traces_and_compiles_nothing(file, live, tmp_path, monkeypatch):
    """It needs the records, the data of the model and its machine code, but nothing that computes these."""
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "cache"))
    program = [sys.executable, "-c", FIRST_STEP.format(file=file, live=live)]
    cold, warm = (subprocess.run(program, check=True, capture_output=True, text=True).stdout.split() for _ in range(2))
    for heavy in ("casadi", "mbd_sim.dynamics.equations", "mbd_sim.compiler.kernel"):
        assert heavy in cold
    own = {name.removeprefix("mbd_sim.") for name in warm if name.startswith("mbd_sim.")}
    needed = {name for name in own if name.partition(".")[0] in ("dynamics", "compiler", "integrators")}
    assert needed == {
        "compiler", "compiler.bound_kernel", "compiler.external_symbols", "compiler.machine_code", "compiler.object_code",
        "compiler.python_callable", "dynamics", "dynamics.audit_states", "dynamics.coordinate_layout",
        "dynamics.input_layout", "integrators",
    }  # fmt: skip
    assert not {"casadi", "pydantic", "yaml", "pint", "logging"} & set(warm)
