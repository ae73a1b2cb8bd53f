"""The options that say about which state a mechanism is linearized, for several subcommands."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from mbd_sim.cli.common import add_mechanism, add_method_and_step
from mbd_sim.cli.setup_options import add_set, add_start, build_simulation

if TYPE_CHECKING:
    from mbd_sim.simulation.simulation import Simulation

ROUND_OFF = 1e-12  # of coordinates
EQUILIBRIUM, START = "equilibrium", "start"


def add_working_point(parser: argparse.ArgumentParser) -> None:
    """Declare the mechanism, its values and start, and `--at`."""
    add_mechanism(parser)
    add_set(parser, "a value of the file, such as joints.elbow.damping=0.2 or l=0.8; repeatable")
    add_start(parser)
    add_method_and_step(parser, "from the file")
    parser.add_argument(
        "--at",
        default=EQUILIBRIUM,
        metavar="STATE",
        help="the state about which it is linearized: equilibrium (at rest, near the start), start, or a time in s up "
        "to which it runs (default: equilibrium)",
    )


def simulation_at(options: argparse.Namespace) -> Simulation:
    """The simulation in the state that the options describe.

    :raises InputError: `--at` is something else, or there is no equilibrium.
    """
    from mbd_sim.errors import InputError
    from mbd_sim.linear_analysis.working_point import to_equilibrium

    time = None if options.at in (EQUILIBRIUM, START) else _time(options.at)
    simulation = build_simulation(options)
    if time is not None:
        simulation.run(until=time)
    elif options.at == EQUILIBRIUM:
        try:
            to_equilibrium(simulation)
        except InputError as error:
            raise InputError(error.args[0], "Give --at start, or --at with a time in s up to which it runs.") from None
    return simulation


def state_text(simulation: Simulation, at: str) -> str:
    """One line about the state."""
    where = {EQUILIBRIUM: "at the equilibrium", START: "at the start"}.get(at, f"at {simulation.time:g} s")
    names, values = simulation.coordinate_names, simulation.model.coordinates(simulation.state)
    place = ", ".join(f"{name} = {_rounded(value):.6g}" for name, value in zip(names, values.tolist(), strict=True))
    return f"{simulation.mechanism.name} {where}{': ' if place else ''}{place}"


def _rounded(value: float) -> float:
    return value if abs(value) > ROUND_OFF else 0.0


def _time(text: str) -> float:
    from mbd_sim.errors import InputError
    from mbd_sim.mechanism_file.value_parser import parse_value

    try:
        value = parse_value(text, {}, "s")
    except InputError:
        value = -1.0
    if value <= 0.0:
        raise InputError(
            f"--at {text}: neither equilibrium, start nor a positive time", "Write for example --at 2.5, or --at 20ms."
        )
    return value
