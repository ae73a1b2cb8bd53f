"""Without ROS, the package needs nothing that only POSIX systems have; imitated by hiding what Windows and macOS lack."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import mbd_sim
from mbd_sim.base import operating_system

PACKAGE = Path(mbd_sim.__file__).parent
POSIX_MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "readline", "resource", "select", "syslog", "termios", "tty"}
WITHOUT_MACOS = {
    "fdatasync", "memfd_create", "posix_fallocate", "sched_getaffinity", "sched_param", "sched_setscheduler",
}  # fmt: skip
WITHOUT_WINDOWS = WITHOUT_MACOS | {
    "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "chown", "fchmod", "fchown", "fork", "forkpty", "fstatvfs",
    "getegid", "geteuid", "getgid", "getloadavg", "getpgid", "getuid", "killpg", "mkfifo", "nice", "pread", "pwrite",
    "register_at_fork", "sendfile", "setpriority", "setsid", "statvfs", "sysconf", "uname", "wait3", "wait4",
}  # fmt: skip
NEEDS_ROS = ("ros", "examples")


MAY_USE = re.compile(rf"\bos\.({'|'.join(WITHOUT_WINDOWS)})\b|\b(import|from)\b.*\b({'|'.join(POSIX_MODULES)})\b")


def modules():
    """Paths and texts of those that run without ROS, but for the one in which systems may differ."""
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.relative_to(PACKAGE).parts[0] not in NEEDS_ROS and path.name != "operating_system.py":
            yield path, path.read_text(encoding="utf-8")


def test_no_other_module_uses_what_some_systems_lack():
    found = []
    for path, text in modules():
        for node in ast.walk(ast.parse(text)) if MAY_USE.search(text) else ():
            used = []
            if isinstance(node, ast.Import):
                used = [alias.name for alias in node.names if alias.name in POSIX_MODULES]
            elif isinstance(node, ast.ImportFrom) and node.module in POSIX_MODULES:
                used = [node.module]
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "os":
                used = [f"os.{node.attr}"] if node.attr in WITHOUT_WINDOWS else []
            found += [f"{path.relative_to(PACKAGE)}:{node.lineno} {name}" for name in used]
    allowed = [place for place in found if place.startswith("base/disk_cache.py") and "os.O_" in place]
    assert sorted(set(found) - set(allowed)) == []


PREAMBLE = """
import builtins, os, sys, types
LACKING, MODULES = {lacking!r}, {modules!r}
shown = types.ModuleType("os")
shown.__dict__.update({{name: value for name, value in vars(os).items() if name not in LACKING}})
if "O_DIRECTORY" in LACKING:
    shown.supports_dir_fd, shown.supports_fd = set(), set()
    def replace(source, target):
        held = {{os.path.realpath(f"/proc/self/fd/{{number}}") for number in os.listdir("/proc/self/fd")}}
        if os.path.realpath(source) in held:
            raise PermissionError(13, "Windows does not rename open files", str(source))
        os.rename(source, target)
    import pathlib
    pathlib.Path.replace = lambda self, target: replace(self, target)
real = builtins.__import__
def hiding(name, globals=None, *rest, **more):
    ours = (globals or {{}}).get("__name__", "").startswith("mbd_sim")
    if ours and name in MODULES:
        raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
    return shown if ours and name == "os" else real(name, globals, *rest, **more)
builtins.__import__ = hiding
"""
WINDOWS = PREAMBLE.format(lacking=WITHOUT_WINDOWS, modules=POSIX_MODULES - {"select"})  # macOS lacks nothing else
COMMANDS = (
    "run rod_pendulum --time 0.3 --out run.mcap",
    "verify run.mcap",
    "check rod_pendulum --draw drawn.svg",
)
PROGRAM = """
from mbd_sim.compiler.code import machine_code
machine_code.LEVEL = 0
from mbd_sim.cli.main import main
for arguments in {commands!r}:
    assert main(arguments.split()) == 0, arguments
from mbd_sim import Ensemble
Ensemble.from_file("rod_pendulum", 3).run(0.1)
from mbd_sim.base import disk_cache
assert disk_cache.load(disk_cache.folder() and sorted(disk_cache.folder().iterdir())[0].name)
"""


def test_the_command_line_without_what_a_system_lacks(tmp_path):
    environment = os.environ | {"MBD_SIM_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(PACKAGE.parent)}
    ran = subprocess.run(
        [sys.executable, "-c", WINDOWS + PROGRAM.format(commands=COMMANDS)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=environment,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "Warning" not in ran.stderr
    assert {path.name for path in tmp_path.iterdir()} >= {arguments.split()[-1] for arguments in COMMANDS}


def test_processors_are_those_that_may_be_used(monkeypatch):
    assert operating_system.processors() == len(os.sched_getaffinity(0))
    monkeypatch.delattr(os, "sched_getaffinity")
    assert operating_system.processors() == os.cpu_count()
