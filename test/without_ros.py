"""Where ROS 2 is not installed, as on a board with arm64, tests that import it are left out; the report says how many."""

import functools
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).parent
NODES = ("ros", "system", "examples")  # folders all tests of which need it
_USES = re.compile(
    r"^\s*(?:from|import) (?:rclpy|rosgraph|mbd_sim\.ros|mbd_sim\.examples|test\.(?:system|ros)|\w+_msgs|\w+_interfaces)\b",
    re.MULTILINE,
)
_FROM_TESTS = re.compile(r"^\s*from test((?:\.\w+)*) import (\([^)]*\)|.*)", re.MULTILINE)


@functools.cache
def has_ros() -> bool:
    """Whether nodes can be started."""
    return importlib.util.find_spec("rclpy") is not None


@functools.cache
def needs_ros(path: Path) -> bool:
    """Whether a file of tests needs it, or another one that this imports."""
    if path.relative_to(HERE).parts[0] in NODES:
        return True
    text = path.read_text(encoding="utf-8")
    return _USES.search(text) is not None or any(map(needs_ros, _imported(text)))


def _imported(text: str) -> Iterator[Path]:
    """The modules in this folder that a module with this text imports."""
    for dotted, names in _FROM_TESTS.findall(text):
        module = HERE.joinpath(*dotted.split(".")[1:])
        files = (module.with_suffix(".py"), *(module / f"{name}.py" for name in re.findall(r"\w+", names)))
        yield from (file for file in files if file.is_file())


def left_out() -> list[Path]:
    """The files of tests that are not collected."""
    return [] if has_ros() else [path for path in sorted(HERE.rglob("test_*.py")) if needs_ros(path)]
