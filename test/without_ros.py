"""Where ROS 2 is not installed, as on a board with arm64, tests that import it are left out; the report says how many."""

import functools
import importlib.util
import re
from pathlib import Path

HERE = Path(__file__).parent
NODES = ("ros", "system", "examples")  # folders all tests of which need it
_USES = re.compile(
    r"^\s*(?:from|import) (?:rclpy|rosgraph|mbd_sim\.ros|mbd_sim\.examples|test\.(?:system|ros)|\w+_msgs|\w+_interfaces)\b",
    re.MULTILINE,
)


@functools.cache
def has_ros() -> bool:
    """Whether nodes can be started."""
    return importlib.util.find_spec("rclpy") is not None


@functools.cache
def needs_ros(path: Path) -> bool:
    """Whether the tests of a file need it."""
    inner = path.relative_to(HERE)
    return inner.parts[0] in NODES or _USES.search(path.read_text(encoding="utf-8")) is not None


def left_out() -> list[Path]:
    """The files of tests that are not collected."""
    return [] if has_ros() else [path for path in sorted(HERE.rglob("test_*.py")) if needs_ros(path)]
