"""Packages that only some functions need: an error that says which one is missing, and the line that installs it."""

from __future__ import annotations

import importlib.util

from mbd_sim.base.errors import InputError

ROS = "Source a ROS 2 environment, or install the wheels, in the source folder of mbd_sim: pip install '.[ros]'"
DISTRIBUTIONS = {  # by the name of the module, where it is another one
    "OCP": "cadquery-ocp-novtk",
    "PIL": "pillow",
    "collada": "pycollada",
    "dask": "'dask[distributed]'",
    "foxglove": "foxglove-sdk",
    "mujoco": "mujoco-core",
    "distributed": "'dask[distributed]'",
    "rerun": "rerun-sdk",
    "rerun_notebook": "'rerun-sdk[notebook]'",
    "lxml": "lxml networkx",  # which trimesh needs for 3MF
    "networkx": "networkx lxml",
    "trimesh": "trimesh pycollada",  # which it needs for COLLADA
    "yaml": "pyyaml",
}
NEEDED = (  # by this package; any of them may be missing where pip has not installed it
    *("av", "casadi", "control", "ezdxf", "gymnasium", "llvmlite", "matplotlib", "mcap", "numpy", "pandas", "plotly"),
    *("pyarrow", "pydantic", "rich", "rosbags", "scipy", "sympy", "viser", "xacro", "zstandard"),
    *DISTRIBUTIONS,
)
_ROS_MODULES = ("rclpy", "ament_index_python", "rosidl_runtime_py")


class MissingPackageError(InputError, ImportError):
    """A package that is needed is not installed; the message contains the line that installs it."""


def require_packages(*modules: str, purpose: str, otherwise: str = "") -> None:
    """Refuse to continue where a package is missing.

    :param modules: the names under which the packages are imported.
    :param purpose: what needs them: the first words of the message.
    :param otherwise: what the user can do instead, after the remedy.
    :raises MissingPackageError: one of them is not installed.
    """
    for module in modules:
        if not _is_installed(module):
            raise _missing(module, purpose, otherwise)


def _is_installed(module: str) -> bool:
    """Whether a module can be found; it is not imported, which may take long."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def missing_package(error: ModuleNotFoundError) -> MissingPackageError | None:
    """The error about a package that an import did not find; None if this package does not need one of that name."""
    name = (error.name or "").partition(".")[0]
    if name in NEEDED or name in _ROS_MODULES or name.endswith("_msgs"):
        return _missing(name, "This", "")
    return None


def _missing(name: str, purpose: str, otherwise: str) -> MissingPackageError:
    name = name.partition(".")[0]
    if name in _ROS_MODULES or name.endswith("_msgs"):
        message = f"{purpose} needs ROS 2 ({name}), which is not installed here"
        return MissingPackageError(message, ROS)
    remedy = f"Install it with: pip install {DISTRIBUTIONS.get(name, name)}"
    return MissingPackageError(
        f"{purpose} needs {name}, which is not installed", remedy + (otherwise and f"; {otherwise}")
    )
