"""Runs launch files without ROS's `launch` and `launch_ros`, which are not on PyPI.

Only what the launch files of this package use is here, with the meaning that it has in ROS 2 Jazzy: arguments with
defaults, substitutions, included files, functions, conditions, and nodes, whose parameters go into a YAML file.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.metadata
import os
import runpy
import signal
import subprocess
import sys
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import yaml

from test.system.forked_programs import ForkedProcess
from test.waiting import PATIENCE

ROOT = Path(__file__).resolve().parent.parent.parent
TYPES: dict[type, Callable[[str], Any]] = {bool: lambda text: text.lower() == "true", float: float, int: int, str: str}


@dataclasses.dataclass
class Context:
    """What a launch file is read with, and what comes of it."""

    folder: Path
    configurations: dict[str, str]
    commands: list[list[str]] = dataclasses.field(default_factory=list)
    messages: list[str] = dataclasses.field(default_factory=list)


def text_of(value: Any, context: Context) -> str:
    """A text, a substitution, or several of them, as text."""
    if isinstance(value, str):
        return value
    if isinstance(value, Iterable):
        return "".join(text_of(one, context) for one in value)
    return str(value.perform(context))


@dataclasses.dataclass
class LaunchConfiguration:
    name: str

    def perform(self, context: Context) -> str:
        return context.configurations[self.name]


@dataclasses.dataclass
class PathJoinSubstitution:
    parts: Sequence[Any]

    def perform(self, context: Context) -> str:
        return str(Path(*(text_of(part, context) for part in self.parts)))


@dataclasses.dataclass
class FindPackageShare:
    package: str

    def perform(self, context: Context) -> str:
        assert self.package == "mbd_sim"
        return str(ROOT)  # its folders are those of an installed package's share


@dataclasses.dataclass
class ParameterValue:
    value: Any
    value_type: type

    def evaluate(self, context: Context) -> Any:
        return TYPES[self.value_type](text_of(self.value, context))


@dataclasses.dataclass
class IfCondition:
    value: Any

    def evaluate(self, context: Context) -> bool:
        return text_of(self.value, context).lower() in ("true", "1")


@dataclasses.dataclass
class LaunchDescription:
    entities: Sequence[Any]

    def visit(self, context: Context) -> None:
        for entity in self.entities:
            entity.visit(context)


@dataclasses.dataclass
class DeclareLaunchArgument:
    name: str
    default_value: str | None = None
    description: str = ""

    def visit(self, context: Context) -> None:
        assert self.description
        if self.name not in context.configurations:
            assert self.default_value is not None, f"the argument {self.name} is required"
            context.configurations[self.name] = self.default_value


@dataclasses.dataclass
class IncludeLaunchDescription:
    source: Any
    launch_arguments: Iterable[tuple[str, str]] = ()

    def visit(self, context: Context) -> None:
        context.configurations.update({name: text_of(value, context) for name, value in self.launch_arguments})
        read(Path(text_of(self.source, context))).visit(context)


@dataclasses.dataclass
class OpaqueFunction:
    function: Callable[[Context], Sequence[Any]]
    condition: IfCondition | None = None

    def visit(self, context: Context) -> None:
        if self.condition is None or self.condition.evaluate(context):
            LaunchDescription(self.function(context)).visit(context)


@dataclasses.dataclass
class LogInfo:
    msg: Any

    def visit(self, context: Context) -> None:
        context.messages.append(text_of(self.msg, context))


@dataclasses.dataclass
class Node:
    package: str
    executable: str
    name: str = ""
    namespace: Any = ""
    output: str = "log"
    prefix: Any = ""
    parameters: Sequence[Any] = ()
    remappings: Sequence[tuple[str, str]] = ()
    arguments: Sequence[Any] = ()

    def visit(self, context: Context) -> None:
        command = [*text_of(self.prefix, context).split(), str(Path(sys.executable).with_name(self.executable))]
        command += [text_of(argument, context) for argument in self.arguments]
        namespace = text_of(self.namespace, context)
        namespace = f"/{namespace.lstrip('/')}" if namespace else ""
        renames = {"__node": self.name, "__ns": namespace, **dict(self.remappings)}
        options = [word for name, value in renames.items() if value for word in ("-r", f"{name}:={value}")]
        for number, given in enumerate(self.parameters):
            file = context.folder / f"{self.executable}_{number}.yaml" if isinstance(given, Mapping) else Path(given)
            if isinstance(given, Mapping):
                values = {
                    name: value.evaluate(context) if isinstance(value, ParameterValue) else value
                    for name, value in given.items()
                }
                file.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}), encoding="utf-8")
            options += ["--params-file", str(file)]
        context.commands.append([*command, *(["--ros-args", *options] if options else [])])


MODULES: dict[str, Sequence[type]] = {
    "launch": (LaunchDescription,),
    "launch.actions": (DeclareLaunchArgument, IncludeLaunchDescription, LogInfo, OpaqueFunction),
    "launch.conditions": (IfCondition,),
    "launch.substitutions": (LaunchConfiguration, PathJoinSubstitution),
    "launch_ros": (),
    "launch_ros.actions": (Node,),
    "launch_ros.parameter_descriptions": (ParameterValue,),
    "launch_ros.substitutions": (FindPackageShare,),
}


def read(file: Path) -> LaunchDescription:
    """The description that a launch file gives."""
    modules = {name: types.ModuleType(name) for name in MODULES}
    for name, classes in MODULES.items():
        vars(modules[name]).update({one.__name__: one for one in classes})
    with mock.patch.dict(sys.modules, modules):
        description: LaunchDescription = runpy.run_path(str(file))["generate_launch_description"]()
    return description


def launched(file: Path, folder: Path, **arguments: str) -> Context:
    """What a launch file starts, without starting it."""
    context = Context(folder, dict(arguments))
    read(file).visit(context)
    return context


Process = ForkedProcess | subprocess.Popen[bytes]


@contextlib.contextmanager
def launching(
    file: Path, folder: Path, domain: int, *, forked: bool = False, **arguments: str
) -> Iterator[list[Process]]:
    """The running processes of a launch file; at the end each is interrupted, and must end without an error.

    :param forked: whether they are forked from a process that has imported the package, which takes a third of the time.
    """
    variables = os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    start = _forked if forked else _started
    processes: list[Process] = []
    try:
        for command in launched(file, folder, **arguments).commands:
            processes.append(start(command, folder, variables))  # so that those before one that is missing are ended
        yield processes
        for process in processes:
            process.send_signal(signal.SIGINT)
        assert [process.wait(PATIENCE) for process in processes] == [0] * len(processes)
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()


def _started(command: Sequence[str], folder: Path, variables: Mapping[str, str]) -> Process:
    return subprocess.Popen(command, cwd=folder, env=variables, stdin=subprocess.DEVNULL, start_new_session=True)


def _forked(command: Sequence[str], folder: Path, variables: Mapping[str, str]) -> Process:
    """The function that an installed program calls, in a process of its own."""
    program = Path(command[0])
    assert os.access(program, os.X_OK)
    (entry,) = importlib.metadata.entry_points(group="console_scripts", name=program.name)
    module = f"mbd_sim.{entry.attr.removeprefix('node.').removesuffix('.main')}"
    return ForkedProcess(module, command[1:], folder, variables, folder / f"{program.name}.log")
