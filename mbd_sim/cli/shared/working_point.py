"""The options that say about which state a mechanism is linearized, for several subcommands."""

from __future__ import annotations

import argparse
import math
import sys

import numpy as np

from mbd_sim.analysis.equilibria.equilibrium import Equilibrium
from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.cli.shared.command import SECONDS, ProgressBar, Waiting
from mbd_sim.cli.shared.common import add_mechanism, add_method_and_step, rounded
from mbd_sim.cli.shared.setup_options import add_set, add_start, build_simulation
from mbd_sim.files.text.units import parse_value
from mbd_sim.mechanism.natural_units import coordinate_sizes
from mbd_sim.recordings.views.table import coordinate_units
from mbd_sim.simulation.run.simulation import BaseSimulation
from mbd_sim.studies.linear_analysis.loci import set_to_equilibrium

SOLVED = 1e-12  # error of a coordinate at an equilibrium, relative to 1 rad or the size of the mechanism
MOVED = 1e-9  # up to which a coordinate counts as that of the start, relative to the same
EQUILIBRIUM, START = "equilibrium", "start"
AT_REST = "the start, but at rest; for small motions about its motion, give --at start"


def add_working_point(parser: argparse.ArgumentParser) -> None:
    """Declare the mechanism, its values and start, and `--at`."""
    add_mechanism(parser)
    add_set(parser)
    add_start(parser)
    add_method_and_step(parser, "from the file")
    parser.add_argument(
        "--at",
        default=EQUILIBRIUM,
        metavar="STATE",
        help="the state about which it is linearized: equilibrium (the one nearest to the start, stable or not), "
        "equilibrium:2 (the second one that is found near the start), start, or a time in s up to which it runs "
        "(default: equilibrium)",
    )


def simulation_at(options: argparse.Namespace) -> tuple[BaseSimulation, str]:
    """The simulation in the state that the options describe, and one line about this state.

    :raises InputError: `--at` is something else, or there is no equilibrium.
    """
    number = _number(options.at)
    time = None if number or options.at == START else _time(options.at)
    simulation = build_simulation(options)
    if time is not None:
        quiet = getattr(options, "quiet", False) or sys.stdout is None or not sys.stdout.isatty()
        with ProgressBar(simulation.mechanism.name, quiet, total=time, amount=SECONDS) as progress:
            simulation.run(until=time, progress=progress.show)
        return simulation, _state_text(simulation, f"at {simulation.time:g} s")
    if not number:
        return simulation, _state_text(simulation, "at the start")
    Waiting.stage("search the equilibrium")
    try:
        found = set_to_equilibrium(simulation, number=number)
    except InputError as error:
        remedy = "Give --at start, or --at with a time in s up to which it runs."
        raise InputError(f"--at {options.at}: {error.message.removeprefix(f'{number}: ')}", remedy) from None
    return simulation, f"{_state_text(simulation, 'at the equilibrium')}\n{equilibrium_text(simulation, found)}"


def equilibrium_text(simulation: BaseSimulation, found: Equilibrium) -> str:
    """How far an equilibrium is from the start, by coordinate, and whether it is stable."""
    units, names = coordinate_units(simulation.mechanism), simulation.coordinate_names
    stability = "stable" if found.stable else f"unstable: motions grow with {found.growth:.4g} 1/s"
    if math.isnan(found.growth):
        stability = "a contact is about to change"
    moved = [
        f"{name} {value:+.4g} {units[name]}"
        for name, value, size in zip(names, found.displacement.tolist(), _sizes(simulation), strict=True)
        if abs(value) > MOVED * size
    ]
    model = simulation.model
    moving = bool(np.any(model.start[model.u_range]))
    where = f"moved from the start by {', '.join(moved)}" if moved else AT_REST if moving else "the start itself"
    return f"  {stability}; {where}"


def place_text(simulation: BaseSimulation, q: Array) -> str:
    """The coordinates q (nq,) by name, those of rotations as rotation vectors."""
    y = simulation.model.start.copy()
    y[simulation.model.q_range] = q
    values = simulation.model.coordinates(y).tolist()
    return ", ".join(
        f"{name} = {rounded(value, size, SOLVED):.6g}"
        for name, value, size in zip(simulation.coordinate_names, values, _sizes(simulation), strict=True)
    )


def _sizes(simulation: BaseSimulation) -> list[float]:
    return coordinate_sizes(simulation.mechanism, simulation.step_size)


def _state_text(simulation: BaseSimulation, where: str) -> str:
    place = place_text(simulation, simulation.q)
    return f"{simulation.mechanism.name} {where}{': ' if place else ''}{place}"


def _number(text: str) -> int:
    """The number of the equilibrium that `--at` names, 0 if it names something else."""
    name, _, number = text.partition(":")
    if name != EQUILIBRIUM or (number and not number.isdecimal()):
        return 0
    return int(number or 1)


def _time(text: str) -> float:
    try:
        value = parse_value(text, {}, "s")
    except InputError:
        value = -1.0
    if value <= 0.0:
        raise InputError(
            f"--at {text}: neither equilibrium, start nor a positive time",
            "Write for example --at 2.5, --at 20ms, or --at equilibrium:2.",
        )
    return value
