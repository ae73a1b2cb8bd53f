"""The command `mbd_sim`: mechanisms checked and run without ROS."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from mbd_sim import __version__
from mbd_sim.cli.playback_arguments import add_export, add_plot, add_view
from mbd_sim.cli.recording_arguments import add_recover, add_rerun_with, add_verify
from mbd_sim.cli.sweep_arguments import add_sweep
from mbd_sim.errors import MbdSimError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code: 0, 1 for a problem that was reported, 2 for a wrong call."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except MbdSimError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="mbd_sim", description="Multibody mechanisms from a plain file.")
    parser.add_argument("--version", action="version", version=f"mbd_sim {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    check = commands.add_parser("check", help="say what was understood of a mechanism file")
    _add_mechanism(check)
    check.add_argument("--json", action="store_true", help="as JSON")
    check.add_argument(
        "--inertia",
        action="store_true",
        help="also mass centre, inertia and principal axes of each part and the whole",
    )
    check.add_argument("--draw", metavar="PICTURE", help="also draw it as it starts, into a .png or .svg file")
    check.add_argument(
        "--latex", action="store_true", help="print the equations of motion of a small mechanism as LaTeX instead"
    )
    check.add_argument("--cost", action="store_true", help="also the instructions that a step takes, by kind")
    check.set_defaults(command=_check)

    run = commands.add_parser("run", help="run a mechanism as fast as possible, without ROS")
    _add_mechanism(run)
    run.add_argument("--time", type=_positive, default=10.0, metavar="S", help="seconds to simulate (default 10)")
    run.add_argument("--method", help="integration method, instead of the file's")
    run.add_argument("--step", type=_positive, metavar="S", help="step in seconds, instead of the file's")
    run.add_argument(
        "--effort", action="append", default=[], metavar="JOINT=VALUE", help="constant effort on a joint, N or N·m"
    )
    run.add_argument("--rerun", metavar="SINK", help="show in Rerun: spawn, serve, connect, or a file.rrd")
    run.add_argument("--quiet", action="store_true", help="no progress bar")
    run.set_defaults(command=_run)

    add_sweep(commands)
    add_verify(commands)
    add_recover(commands)
    add_rerun_with(commands)
    for add in (add_view, add_plot, add_export):
        add(commands)

    urdf = commands.add_parser("urdf", help="print the mechanism's spanning tree as URDF")
    _add_mechanism(urdf)
    urdf.set_defaults(command=_urdf)

    convert = commands.add_parser("convert", help="print a URDF, or a file that begins from one, as one mechanism file")
    _add_mechanism(convert)
    convert.add_argument("--base", choices=["fixed", "free"], help="how the root link of the URDF is held")
    convert.set_defaults(command=_convert)

    shipped = commands.add_parser("list", help="list the mechanisms that ship")
    shipped.set_defaults(command=_list)

    schema = commands.add_parser("schema", help="print the JSON Schema of mechanism files, for editors")
    schema.set_defaults(command=_schema)
    return parser


def _add_mechanism(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("mechanism", metavar="FILE", help="a mechanism file, a URDF, or the name of a shipped one")


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def _check(options: argparse.Namespace) -> int:
    from mbd_sim.analysis.instruction_cost import cost, cost_text
    from mbd_sim.report.inertia_report import inertia_report, inertia_text
    from mbd_sim.report.mechanism_report import report
    from mbd_sim.report.report_text import report_text
    from mbd_sim.simulation.simulation import Simulation

    simulation = Simulation.from_file(options.mechanism)
    if options.draw:
        from mbd_sim.drawing import draw

        draw(simulation.mechanism, simulation.poses(), options.draw)
    if options.latex:
        from mbd_sim.symbolic import symbolic_equations, to_latex

        print(to_latex(symbolic_equations(simulation.mechanism)))
        return 0
    found = report(simulation)
    if options.inertia:
        found["inertia"] = inertia_report(simulation.mechanism.parts, simulation.poses())
    if options.cost:
        found["cost"] = cost(simulation.model.equations, simulation.model.method)
    if options.json:
        print(json.dumps(found, indent=2))
        return 0
    print(report_text(found))
    if options.inertia:
        print(f"\n{inertia_text(found['inertia'])}")
    if options.cost:
        print(f"\n{cost_text(found['cost'])}")
    return 0


def _run(options: argparse.Namespace) -> int:
    from mbd_sim.cli.run import run
    from mbd_sim.simulation.simulation import Simulation

    simulation = Simulation.from_file(options.mechanism, method=options.method, step=options.step)
    simulation.set_efforts(dict(_assignment(text) for text in options.effort))
    print(run(simulation, options.time, rerun=options.rerun, quiet=options.quiet))
    return 0


def _assignment(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise MbdSimError(f"--effort {text}: write JOINT=VALUE, for example elbow=2.5") from None


def _urdf(options: argparse.Namespace) -> int:
    from mbd_sim.load import load_mechanism
    from mbd_sim.urdf.export import to_urdf

    print(to_urdf(load_mechanism(options.mechanism)))
    return 0


def _convert(options: argparse.Namespace) -> int:
    from mbd_sim.load import load_mechanism

    print(load_mechanism(options.mechanism, options.base).source.text, end="")
    return 0


def _list(options: argparse.Namespace) -> int:
    from mbd_sim.load import load_mechanism
    from mbd_sim.mechanism_file.library import shipped

    for name, path in shipped().items():
        print(f"{name:24s} {load_mechanism(Path(path)).description.splitlines()[0]}")
    return 0


def _schema(options: argparse.Namespace) -> int:
    from mbd_sim.mechanism_file.validation import json_schema

    print(json.dumps(json_schema(), indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
