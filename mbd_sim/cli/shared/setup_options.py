"""The options that set up a run of a mechanism, `--set`, `--start` and `--effort`."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from mbd_sim.base.errors import InputError, MechanismError, nearest
from mbd_sim.cli.shared.command import Waiting
from mbd_sim.cli.shared.common import add_repeatable
from mbd_sim.files.load import load_mechanism, set_up
from mbd_sim.files.text.units import parse_value, split_unit
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import in_quotes, split_assignment

if TYPE_CHECKING:
    from mbd_sim.simulation.run.simulation import BaseSimulation


def add_set(parser: argparse._ActionsContainer) -> None:
    """Declare `--set`."""
    example = "joints.elbow.damping=0.2 or l='80 cm'"
    help_text = f"change a value of the mechanism file, such as {example}; repeatable"
    add_repeatable(parser, "--set", "KEY=VALUE", help_text, dest="changes")


BASES = ("fixed", "free")
INTERFACES = ("position", "velocity", "effort")


def add_robot(parser: argparse._ActionsContainer) -> None:
    """Declare `--base`, `--floor`, `--limits` and `--control`."""
    parser.add_argument(
        "--base",
        choices=BASES,
        help="how the root link of a URDF or SDF is attached to ground (default: fixed; SDF: as the file says)",
    )
    parser.add_argument(
        "--floor",
        action="store_true",
        help="put a floor at z = 0, and a free base where its lowest point touches it",
    )
    parser.add_argument("--limits", choices=["stops"], help="make the limits of joints rigid stops")
    parser.add_argument(
        "--control",
        choices=INTERFACES,
        help="make the <ros2_control> blocks of the robot act; of several command interfaces, a joint serves this one",
    )


def add_start_positions(parser: argparse._ActionsContainer) -> None:
    """Declare `--start`."""
    add_repeatable(
        parser,
        "--start",
        "JOINT=VALUE",
        "start position of a joint or coordinate, in rad or m or with a unit, such as elbow='30 deg'; repeatable",
    )


def add_start(parser: argparse._ActionsContainer) -> None:
    """Declare `--start` and `--effort`."""
    add_start_positions(parser)
    add_repeatable(
        parser, "--effort", "JOINT=VALUE", "constant effort on a joint, in N or N·m or with a unit; repeatable"
    )


def changed_mechanism(options: argparse.Namespace, *, starts: bool = False) -> Mechanism:
    """The mechanism with the values of `--set`, and, if the command `starts` it, with those of `--start`.

    :raises InputError: an option is not an assignment, or names a joint that does not exist.
    :raises MechanismError: with all problems of the file, or of the values.
    """
    Waiting.stage("read the mechanism")
    mechanism, changes = read_mechanism(options), changes_of(options.changes)
    if starts:
        changes |= _start_positions(mechanism, options)
    return set_up_by(options, mechanism, changes)


def set_up_by(options: argparse.Namespace, mechanism: Mechanism, changes: Mapping[str, Any]) -> Mechanism:
    """The mechanism with other values, and with what `--floor` and `--limits` say where a command has them."""
    limits, floor = (getattr(options, name, None) for name in ("limits", "floor"))
    return set_up(mechanism, {"limits": limits, **changes} if limits else changes, floor=bool(floor))


def read_mechanism(options: argparse.Namespace) -> Mechanism:
    """The mechanism of the file, with `--base` and `--control`; meshes touch as their hulls if there is a floor."""
    base, floor, control = (getattr(options, name, None) for name in ("base", "floor", "control"))
    return load_mechanism(options.mechanism, base, hulls=bool(floor), control=control)


def changes_of(assignments: Iterable[str]) -> dict[str, Any]:
    """The values of `--set` by key: numbers, or texts as in a file.

    :raises InputError: one is not of the form KEY=VALUE.
    """
    return {key: _value(text, f"--set {key}") for key, text in _pairs("--set", assignments, "joints.elbow.damping=0.2")}


def build_simulation(options: argparse.Namespace, *, with_changes: bool = True) -> BaseSimulation:
    """The simulation that the options describe, with its constant efforts.

    :param with_changes: whether `--set`, `--method` and `--step` are for this run.
    :raises InputError: an option is not an assignment, or names a joint that does not exist.
    :raises MechanismError: the mechanism cannot be built with these values.
    """
    from mbd_sim.simulation.run.simulation import BaseSimulation  # not for `check`, whose reports are kept

    Waiting.stage("read the mechanism")
    mechanism = read_mechanism(options)
    changes = changes_of(options.changes) if with_changes else {}
    changes |= _start_positions(mechanism, options)
    mechanism = set_up_by(options, mechanism, changes)
    Waiting.stage("derive and compile the equations")
    simulation = BaseSimulation(
        mechanism,
        method=options.method if with_changes else None,
        step=options.step if with_changes else None,
    )
    simulation.set_efforts(dict(_effort(text, mechanism) for text in options.effort))
    return simulation


def _pairs(option: str, assignments: Iterable[str], example: str) -> list[tuple[str, str]]:
    pairs = []
    for text in assignments:
        pair = split_assignment(text)
        if not all(pair):
            form = "KEY=VALUE" if option == "--set" else "JOINT=VALUE"
            raise InputError(f"{option} {text}: not of the form {form}", f"Write for example {example}.")
        pairs.append(pair)
    return pairs


def _value(text: str, option: str) -> Any:
    """The value of an option as a file has it: a number, a list or a mapping, or a text."""
    try:
        return float(text)
    except ValueError:
        if not text.lstrip().startswith(("[", "{")):
            return text
    from mbd_sim.files.text.yaml_text import parse_source  # a warm start reads no YAML

    source = parse_source(text, option)
    if source.problems:
        raise MechanismError(source.problems)
    return source.data


def _effort(text: str, mechanism: Mechanism) -> tuple[str, float]:
    ((name, value),) = _pairs("--effort", [text], "elbow=2.5")
    try:
        if not split_unit(value)[1]:
            return name, float(value)
        known = name in mechanism.coordinate_names
        unit = mechanism.coordinate(name).effort_unit.replace("·", "*") if known else None
        return name, parse_value(value, {}, unit)
    except InputError as error:
        raise InputError(f"--effort {text}: {error.message}", error.remedy) from None
    except ValueError:
        raise InputError(f"--effort {text}: '{value}' is not a number", "Write for example elbow=2.5.") from None


def _start_positions(mechanism: Mechanism, options: argparse.Namespace) -> dict[str, Any]:
    """The values of `--start`, by key of the file: of a joint with one coordinate, or of one of several coordinates."""
    lists: dict[str, list[Any]] = {}
    found: dict[str, Any] = {}
    for name, text in _pairs("--start", options.start, "elbow=0.5"):
        joint, number = _coordinate(mechanism, name)
        key = f"joints.{in_quotes(joint)}.position"
        if drive := mechanism.all_joints[joint].drive:
            if not isinstance(drive, CommandedDrive):
                message = f"--start {name}: an expression of time drives this joint, also at the start"
                raise InputError(message, f"Change it: --set joints.{in_quotes(joint)}.drive=…")
            key = f"joints.{in_quotes(joint)}.drive.position"
        if number is None:
            found[key] = _value(text, f"--start {name}")
            continue
        record = mechanism.all_joints[joint]
        values = lists.setdefault(key, record.position[: record.kind.quaternion].tolist())
        values[number] = _value(text, f"--start {name}")
    return found | lists


def _coordinate(mechanism: Mechanism, name: str) -> tuple[str, int | None]:
    """The joint, and the place of the coordinate in its list of positions if it has one."""
    found: dict[str, tuple[str, int | None]] = {}
    for joint in mechanism.all_joints.values():
        if joint.kind.nv == 1:
            found[joint.name] = joint.name, None
        else:
            labels = joint.kind.labels[: joint.kind.quaternion]  # an orientation has a key of its own
            found |= {f"{joint.name}{label}": (joint.name, number) for number, label in enumerate(labels)}
    if name not in found:
        raise InputError(f"--start {name}: there is no joint or position of this name", nearest(name, found))
    return found[name]
