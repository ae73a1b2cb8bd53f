"""`mbd_sim verify`, `recover` and `rerun-with`: recordings are recomputed and compared, and repaired."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote

from mbd_sim.base.errors import InputError, counted, listed
from mbd_sim.cli.shared.command import Command, ProgressBar
from mbd_sim.cli.shared.common import (
    MCAP_OR_BAG,
    add_method_and_step,
    add_plot_style,
    add_quiet,
    add_recordings,
    chosen_style,
    pace,
    positive_number,
)
from mbd_sim.cli.shared.recorded_run import add_run, is_recording, recorded_run
from mbd_sim.cli.shared.setup_options import add_set, changes_of
from mbd_sim.recordings.run.changed_run import ChangedRun, ChangedRunFile, compute_changed_run
from mbd_sim.recordings.run.paths import RecordingError
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recomputation import Recomputation
from mbd_sim.recordings.run.recovery import damaged_original, recover, recover_bag
from mbd_sim.recordings.run.verification import Difference, Verification, verify
from mbd_sim.recordings.views.plots import (
    largest_deviations,
    plot_changed_run,
    require_plot,
)
from mbd_sim.recordings.views.table import coordinate_units

NOUNS = {  # singular and plural
    "joint_states": ("joint state", "joint states"),
    "energies": ("set of energies", "energies"),
    "constraint_violation": ("constraint violation", "constraint violations"),
    "accelerations": ("set of accelerations", "sets of accelerations"),
    "sensors": ("measurement", "measurements"),
    "applied_efforts": ("effort", "efforts"),
    "applied_commands": ("command", "commands"),
    "applied_wrenches": ("wrench", "wrenches"),
    "live_values": ("live value", "live values"),
    "new_states": ("new state", "new states"),
    "resets": ("reset", "resets"),
}


def _add_verify(parser: argparse.ArgumentParser) -> None:
    add_run(parser, several=True, recomputed=True)
    parser.add_argument(
        "--tolerance",
        type=positive_number,
        metavar="X",
        help="accept deviations up to X * (1 + the largest number of the message), comparing each recorded "
        "state with the one recomputed from the previous recorded state (default: bit for bit; 1e-9 for recordings "
        "from another machine or version whose bits differ)",
    )
    add_quiet(parser)


def _verify(options: argparse.Namespace) -> int:
    """Verify all recordings and print a report on each; returns 1 if a state differs or a file is damaged."""
    all_intact = True
    for run in options.recordings:
        with recorded_run(run, options) as path, ProgressBar(f"verify {path.name}", options.quiet) as progress:
            verifications = verify(path, options.tolerance, progress.show)
        for verification in verifications:
            if not is_recording(run):
                verification.path = Path(run)
            print(verify_text(verification))
            all_intact &= verification.is_intact
    return 0 if all_intact else 1


def verify_text(found: Verification) -> str:
    """Return the report on a file, a few lines."""
    comparison = "bit for bit" if found.tolerance is None else f"to {found.tolerance:g}"
    simulated = found.steps * found.step
    lines = [f"{found.path}: {_verdict(found, comparison)}"]
    lines += [f"  recorded with    {text}" for text in found.environment_differences]
    if found.environment_differences and found.tolerance is None:
        lines.append("                   All bits are the same here.")
    elif found.environment_differences:
        lines.append("                   Bits may differ there, so each recorded state is compared with the one")
        lines.append("                   recomputed from the previous recorded state.")
    lines.append(f"  mechanism        {found.mechanism} ({found.method}, {found.step * 1e3:g} ms)")
    lines.append(f"  compared         {_counted(found.compared)}; commands: {_counted(found.commands) or 'none'}")
    lines.append(
        f"  computed         {counted(found.steps, 'step')}, {simulated:.6g} s simulated in {found.wall_time:.3g} s: "
        f"{pace(simulated, found.wall_time)} × real time"
    )
    if found.problem:
        lines.append(f"  file             {found.problem}; its readable part is compared")
    if found.index_problem:
        lines.append(
            f"  DAMAGED INDEX    {found.index_problem}; to repair it: mbd_sim recover {quote(str(found.path))}"
        )
    if found.content_problem:
        lines.append(f"  DAMAGED          {found.content_problem}")
    if found.failure:
        lines.append(f"  ENDS EARLY       {found.failure}")
    if found.first is not None:
        lines += _differences(found, found.first)
    return "\n".join(lines)


def _verdict(found: Verification, comparison: str) -> str:
    if found.first is not None:
        return f"DIFFERS from step {found.first.tick} on (t = {found.first.time:.9g} s)"
    if found.failure:
        return f"agrees {comparison} as far as it can be read"
    if not found.compared:
        return "contains no state to compare"
    if found.index_problem:
        return f"the states are right, {comparison}, but the index of the file is damaged"
    if found.content_problem:
        return f"the states are right, {comparison}, but the file is damaged"
    return f"verified, {comparison}"


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {NOUNS[role][count != 1]}" for role, count in counts.items())


def _differences(found: Verification, first: Difference) -> list[str]:
    lines = [f"  first            {_difference_text(first)}"]
    if found.largest is not None and found.largest is not first:
        lines.append(f"  largest          {_difference_text(found.largest)}")
    lines.append(f"  differ           {found.differing} of {counted(sum(found.compared.values()), 'message')}")
    return [*lines, f"  likely cause     {_likely_cause(found)}"]


def _likely_cause(found: Verification) -> str:
    if found.differing == 1 and (count := found.agreeing_since):
        after = "the message after it agrees" if count == 1 else f"the {count} messages after it agree"
        return f"this record is damaged: {after}"
    if found.suspected_commands:
        return f"an earlier command: {listed(found.suspected_commands[::-1], 4)}"
    return "the start of the run or an earlier state: there is no command after the last state that agrees"


def _difference_text(difference: Difference) -> str:
    recorded, computed = difference.recorded, difference.computed
    return (
        f"{difference.topic}, {difference.name}, step {difference.tick}, t = {difference.time:.9g} s: "
        f"recorded {recorded!r} ({recorded.hex()}), computed {computed!r} ({computed.hex()})"
    )


def _recover(options: argparse.Namespace) -> int:
    """Recover the recordings and print the contents of each.

    :raises RecordingError: one cannot be read or written, or is not a recording.
    """
    for path in options.recordings:
        try:
            for file, counts in recover_bag(path) if path.is_dir() else [(path, recover(path))]:
                print(_report(file, counts))
        except FileNotFoundError as error:
            raise RecordingError(f"{path}: there is no such file", "Check the path.") from error
        except InputError as error:
            raise RecordingError(f"{path}: {error.message}", error.remedy) from error
        except (OSError, ValueError, LookupError) as error:
            raise RecordingError(f"{path}: {error}") from error
    return 0


def _report(path: Path, counts: dict[str, int] | None) -> str:
    if counts is None:
        return f"{path}: is complete, nothing to repair"
    by_topic = ", ".join(f"{count} of {topic}" for topic, count in counts.items() if count)
    original = damaged_original(path)
    kept = f"; the damaged file is kept as {original}" if original.exists() else ""
    return f"{path}: {counted(sum(counts.values()), 'message')} kept{': ' if by_topic else ''}{by_topic}{kept}"


SHOWN = 8  # rows of each table


def _add_rerun_with(parser: argparse.ArgumentParser) -> None:
    add_run(parser, changes=False, recomputed=True)
    add_set(parser)
    add_method_and_step(parser, "as recorded")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="plot both runs: .png, .svg, .pdf or .html")
    add_plot_style(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the changed run to an .mcap file")
    add_quiet(parser)


def _rerun_with(options: argparse.Namespace) -> int:
    """Recompute, plot and write the run, and print the largest deviations."""
    changes = changes_of(options.changes)
    if not (changes or options.method or options.step):
        raise InputError("rerun-with: no change is given", "Give --set KEY=VALUE, --method or --step.")
    chosen_style(options, options.plot)
    require_plot(options.plot)
    with recorded_run(options.recording, options, with_changes=False) as path:
        _recompute(path, options, changes)
    return 0


def _recompute(path: Path, options: argparse.Namespace, changes: dict[str, float | str]) -> None:
    files = open_recording(path).files
    file = files[0]
    recomputation = Recomputation(file, method=options.method, step=options.step, changes=changes)
    out = ChangedRunFile(options.out, recomputation) if options.out is not None else None
    with ProgressBar("rerun", options.quiet) as progress:
        try:
            run = compute_changed_run(recomputation, progress.show, out.add if out is not None else None)
        finally:
            if out is not None:
                out.close()
    change = ", ".join(_descriptions(options, changes))
    units = coordinate_units(recomputation.simulation.mechanism)
    if options.plot is not None:
        title = f"{recomputation.simulation.mechanism.name}: {Path(options.recording).name}"
        plot_changed_run(options.plot, run, title, change, units, chosen_style(options, options.plot))
    written = [path for path in (options.plot, options.out) if path is not None]
    name = options.recording if len(files) == 1 else str(file.path)
    print(_summary(run, name, file.problem, change, units, written))
    if len(files) > 1:
        print(f"  This is the first of {len(files)} files. To recompute another one, give its path.")


def _descriptions(options: argparse.Namespace, changes: dict[str, float | str]) -> list[str]:
    """Return a few words on each change."""
    found = [f"{name} = {value}" for name, value in changes.items()]
    if options.method:
        found.append(f"method {options.method}")
    if options.step:
        found.append(f"step {options.step:g} s")
    return found


def _summary(
    run: ChangedRun, name: str, problem: str, change: str, units: Mapping[str, str], written: Sequence[Path]
) -> str:
    lines = [f"{name}: with {change}"]
    if problem:
        lines.append(f"  file             {problem}")
    if run.ended:
        lines.append(f"  ENDS EARLY       {run.ended}")
    if run.left_out:
        step = run.recomputation.simulation.step_size
        lines.append(f"  not compared     {counted(run.left_out, 'state')} between two steps of {step:g} s")
    lines.append("  largest deviations")
    for series, rate in ((run.coordinates["position"], ""), (run.coordinates["velocity"], "/s"), (run.energies, "J")):
        rows = largest_deviations(series)
        for name, size, time in rows[:SHOWN]:
            unit = rate if series is run.energies else f"{units[name.rpartition(' ')[0]]}{rate}"
            lines.append(f"    {name:24s}  {f'{size:.6g} {unit}':18s}  t = {time:.6g} s")
        if len(rows) > SHOWN:
            lines.append(f"    … and {len(rows) - SHOWN} more")
    return "\n".join([*lines, *(f"  wrote {path}" for path in written)])


COMMANDS = {
    "verify": Command(
        "Recompute recorded runs from the mechanism, initial state and commands that they contain, and compare "
        "every recorded state. If RUN is a mechanism, it is run and recorded first. Checksums, offsets and indexes "
        "of the files are also checked. The exit code is 1 if any state differs or a file is damaged. A file that "
        "was merely truncated by a kill is compared up to its end.",
        _add_verify,
        _verify,
    ),
    "recover": Command(
        "Repair recordings: remove everything after the last complete, undamaged record of each file, and write the"
        " summary and the indexes that MCAP tools need. If more than an incomplete end is removed, the original is "
        "kept as FILE.damaged.",
        lambda parser: add_recordings(parser, MCAP_OR_BAG),
        _recover,
    ),
    "rerun-with": Command(
        "Recompute a recorded run under the same commands, but with other values, integration method or time step, "
        "and report the deviations. If RUN is a mechanism, it is first run without these changes.",
        _add_rerun_with,
        _rerun_with,
    ),
}
