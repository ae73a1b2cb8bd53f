"""`mbd_sim check`: report on a mechanism without running it."""

from __future__ import annotations

import argparse
import json
from typing import Any

from mbd_sim.base.errors import CommandError, NoInertiaError, listed
from mbd_sim.base.plain_output import print_file
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_mechanism
from mbd_sim.cli.shared.drawing import add_drawing, draw_requested, require_drawing
from mbd_sim.cli.shared.setup_options import add_robot, add_set, add_start_positions, changed_mechanism
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.report.text import cached_report, kinematic_text, report_text


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    add_set(parser)
    add_start_positions(parser)
    add_robot(parser)
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    parser.add_argument(
        "--inertia",
        action="store_true",
        help="add the center of mass, inertia tensor and principal axes of each part and of the whole mechanism",
    )
    add_drawing(parser)
    parser.add_argument(
        "--latex",
        action="store_true",
        help="print energies, equations, constraints and sensors as LaTeX instead of the report (small mechanisms)",
    )
    parser.add_argument(
        "--numbers", action="store_true", help="with --latex: numbers in place of the file's parameters"
    )
    parser.add_argument(
        "--symbols",
        metavar="KEY",
        nargs="+",
        help="with --latex: further numbers of the file as symbols, by their keys or patterns: 'parts.*.mass'",
    )
    parser.add_argument(
        "--no-linearization",
        action="store_true",
        help="with --latex: without the linearized equations about an equilibrium",
    )
    parser.add_argument("--cost", action="store_true", help="add the number of instructions per time step, by kind")


def _execute(options: argparse.Namespace) -> int:
    """Print the report, or the equations as LaTeX.

    :raises CommandError: options that have no effect.
    """
    if (options.numbers or options.symbols) and not (options.latex and not (options.numbers and options.symbols)):
        raise CommandError("--numbers and --symbols choose what --latex prints", "Give one of them, with --latex.")
    if options.no_linearization and not options.latex:
        raise CommandError("--no-linearization chooses what --latex prints", "Give it with --latex.")
    if options.latex and (unused := [name for name in ("json", "inertia", "cost") if getattr(options, name)]):
        names = ", ".join(f"--{name}" for name in unused)
        raise CommandError(f"{names}: --latex prints equations instead of the report", "Leave one of them out.")
    require_drawing(options)
    mechanism = changed_mechanism(options, starts=True)
    try:
        if not (options.draw or options.latex or options.inertia or options.cost):
            return _print_report(cached_report(mechanism), mechanism, options)
        return _report_with_more(mechanism, options)
    except NoInertiaError as error:
        return _without_dynamics(mechanism, error, options)


def _report_with_more(mechanism: Mechanism, options: argparse.Namespace) -> int:
    from mbd_sim.simulation.run.simulation import BaseSimulation

    simulation = BaseSimulation(mechanism)
    draw_requested(options, simulation.mechanism, simulation.poses(), simulation)
    if options.latex:
        print_file(_latex(simulation.mechanism, options))
        return 0

    from mbd_sim.studies.report.elements import cost, inertia_report
    from mbd_sim.studies.report.mechanism_report import report

    content = report(simulation)
    if options.inertia:
        content["inertia"] = inertia_report(simulation.mechanism.parts, simulation.poses())
    if options.cost:
        content["cost"] = cost(simulation.model.equations, simulation.model.method)
    return _print_report(content, simulation.mechanism, options)


def _print_report(content: dict[str, Any], mechanism: Mechanism, options: argparse.Namespace) -> int:
    if options.json:
        print(json.dumps(content, indent=2))
        return 0
    print(report_text(content))
    if options.start and content["constraints"]:
        print(_start_text(mechanism))
    if options.inertia:
        from mbd_sim.studies.report.elements import inertia_text

        print(f"\n{inertia_text(content['inertia'])}")
    if options.cost:
        from mbd_sim.studies.report.elements import cost_text

        print(f"\n{cost_text(content['cost'])}")
    if options.draw:
        print(f"wrote {options.draw}")
    return 0


def _start_text(mechanism: Mechanism) -> str:
    """Which positions of another start are those that were given, and which follow from them."""
    given, found = list[str](), list[str]()
    for joint in mechanism.joints.values():
        if not joint.drive:
            for name, fixed in zip(joint.motion_names, joint.fixed_in_assembly, strict=True):
                (given if fixed else found).append(name)
    told = [f"{listed(given)} as given"] if given else []
    told += [f"{listed(found)} found so that loops and constraints are closed"] if found else []
    return f"Start               {'; '.join(told)}"


def _latex(mechanism: Mechanism, options: argparse.Namespace) -> str:
    from mbd_sim.files.checks.override import matching
    from mbd_sim.studies.symbolic.equations import symbolic_equations
    from mbd_sim.studies.symbolic.latex import to_latex
    from mbd_sim.studies.symbolic.linearization import linearized

    parameters: list[str] | None = [] if options.numbers else None
    if options.symbols:
        found = {name: matching(mechanism, [name]) if "*" in name else [name] for name in options.symbols}
        if unmatched := [name for name, keys in found.items() if not keys]:
            raise CommandError(f"--symbols {listed(unmatched)}: no number of the file has such a key")
        further = [key for keys in found.values() for key in keys]
        parameters = [*mechanism.parameters, *further]
    equations = symbolic_equations(mechanism, parameters)
    return to_latex(equations, None if options.no_linearization else linearized(mechanism, equations))


def _without_dynamics(mechanism: Mechanism, error: NoInertiaError, options: argparse.Namespace) -> int:
    """Report what needs no masses; the status is 1, because the mechanism cannot be run.

    :raises NoInertiaError: more was requested.
    """
    from mbd_sim.analysis.mechanics.kinematics import Kinematics
    from mbd_sim.studies.report.elements import inertia_report, inertia_text
    from mbd_sim.studies.report.mechanism_report import kinematic_report

    if options.latex or options.cost:
        raise error
    kinematics = Kinematics(mechanism)
    draw_requested(options, mechanism, kinematics.poses())
    content = kinematic_report(kinematics, error.problems)
    if options.inertia:
        content["inertia"] = inertia_report(mechanism.parts, kinematics.poses())
    print(json.dumps(content, indent=2) if options.json else kinematic_text(content))
    if options.inertia and not options.json:
        print(f"\n{inertia_text(content['inertia'])}")
    return 1


COMMANDS = {
    "check": Command(
        "Validate and assemble a mechanism, and report its parts, joints, degrees of freedom and energies. The "
        "status is 1 if it has problems, or if its dynamics is not defined because something has no mass.",
        _add_arguments,
        _execute,
    ),
}
